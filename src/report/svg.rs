//! Plots as SVG. No other file uses the drawing library.

use super::{HeatMap, LinePlot, ReportError, SatelliteInView, Summary};
use crate::array::{ArraySky, Bearing, SkyEpoch};
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::error::Error;
use std::f64::consts::{FRAC_PI_2, TAU};

const FONT: &str = "sans-serif";
const GRID: RGBColor = RGBColor(200, 200, 200);
const INK: RGBColor = RGBColor(31, 90, 160);

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Drawn = Result<(), Box<dyn Error + Send + Sync>>;

fn draw(
    plot: &'static str,
    size: (u32, u32),
    body: impl FnOnce(&Area) -> Drawn,
) -> Result<String, ReportError> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        let drawn = area.fill(&WHITE).map_err(Into::into).and_then(|()| body(&area));
        let shown = drawn.and_then(|()| Ok(area.present()?));
        shown.map_err(|e| ReportError::Plot { plot, problem: e.to_string() })?;
    }
    Ok(svg)
}

/// A row of a [`dot_plot`].
#[derive(Clone, Debug, PartialEq)]
pub struct Dot {
    /// Label.
    pub label: String,
    /// Value of the disc, if any.
    pub disc: Option<f64>,
    /// Value of the ring, if any.
    pub ring: Option<f64>,
}

/// One row for each label, from the top down: a disc for what was measured, a ring for what was expected.
pub fn dot_plot(description: &str, dots: &[Dot]) -> Result<String, ReportError> {
    let values = dots.iter().flat_map(|d| [d.disc, d.ring]).flatten();
    let (low, high) = values.fold((0f64, 1f64), |(a, b), v| (a.min(v), b.max(v)));
    let reach = 1.05 * (high - low);
    let left = low - 0.45 * reach;
    let rows = dots.len() as f64;
    draw("dot plot", (640, 60 + 18 * dots.len() as u32), |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .x_label_area_size(36)
            .build_cartesian_2d(left..low + reach, rows..-0.5)?;
        chart
            .configure_mesh()
            .disable_y_mesh()
            .light_line_style(WHITE)
            .x_desc(description)
            .draw()?;
        for (k, dot) in dots.iter().enumerate() {
            let (y, label) = (k as f64, dot.label.clone());
            chart.draw_series([Text::new(label, (left, y - 0.3), (FONT, 12))])?;
            let disc = dot.disc.map(|x| Circle::new((x, y), 3, INK.filled()));
            let ring = dot.ring.map(|x| Circle::new((x, y), 6, INK));
            chart.draw_series(disc.into_iter().chain(ring))?;
        }
        Ok(())
    })
}

/// Sky plot: zenith in the middle, horizon at the edge, north up; colour from red (30 dB-Hz) to green (50).
pub fn sky_plot(satellites: &[SatelliteInView]) -> Result<String, ReportError> {
    draw("sky plot", (420, 420), |area| {
        let chart =
            ChartBuilder::on(area).margin(10).build_cartesian_2d(-1.15f64..1.15, -1.15f64..1.15)?;
        let plane = chart.plotting_area();
        let at = |radius: f64, azimuth: f64| (radius * azimuth.sin(), radius * azimuth.cos());
        for elevation_deg in [0, 30, 60] {
            let radius = 1.0 - f64::from(elevation_deg) / 90.0;
            let ring =
                (0..=120).map(|k| at(radius, TAU * f64::from(k) / 120.0)).collect::<Vec<_>>();
            plane.draw(&PathElement::new(ring, GRID))?;
            let label = Text::new(
                format!("{elevation_deg}°"),
                at(radius, 0.05),
                (FONT, 11).into_font().color(&GRID),
            );
            plane.draw(&label)?;
        }
        for (k, name) in ["N", "E", "S", "W"].into_iter().enumerate() {
            let azimuth = FRAC_PI_2 * k as f64;
            plane.draw(&PathElement::new(vec![at(0.0, 0.0), at(1.0, azimuth)], GRID))?;
            let (x, y) = at(1.08, azimuth);
            plane.draw(&Text::new(name, (x - 0.02, y + 0.03), (FONT, 14)))?;
        }
        for s in satellites {
            let point = at((1.0 - s.elevation / FRAC_PI_2).clamp(0.0, 1.0), s.azimuth);
            let colour = s.cn0_dbhz.map_or(RGBColor(128, 128, 128), |cn0| {
                let hue = ((cn0 - 30.0) / 20.0).clamp(0.0, 1.0);
                let (r, g, b) = HSLColor(hue / 3.0, 0.8, 0.4).to_backend_color().rgb;
                RGBColor(r, g, b)
            });
            plane.draw(&Circle::new(point, 7, colour.filled()))?;
            let cn0 = s.cn0_dbhz.map_or(String::new(), |c| format!(" {c:.0}"));
            plane.draw(&Text::new(
                format!("{}{cn0}", s.sv),
                (point.0 + 0.04, point.1 + 0.07),
                (FONT, 12),
            ))?;
        }
        Ok(())
    })
}

/// Directions by an array, in direction cosines: of a plane east and north at the edge and the zenith in the
/// middle, of a linear array on the half circle, broadside up. Circles are satellites (hollow: by the orbits),
/// lines their tracks, crosses the sources without codes, triangles jammers.
pub fn arrival_plot(sky: &ArraySky, later: &[SkyEpoch]) -> Result<String, ReportError> {
    let at = |bearing: Bearing| match bearing {
        Bearing::Cone(angle) => angle.sin_cos(),
        Bearing::Direction { azimuth, elevation } => {
            (elevation.cos() * azimuth.sin(), elevation.cos() * azimuth.cos())
        }
    };
    let ink = |hue: f64| {
        let (r, g, b) = HSLColor(hue, 0.8, 0.4).to_backend_color().rgb;
        RGBColor(r, g, b)
    };
    draw("plot of directions", (460, 460), |area| {
        let chart =
            ChartBuilder::on(area).margin(10).build_cartesian_2d(-1.15f64..1.15, -1.15f64..1.15)?;
        let plane = chart.plotting_area();
        for elevation_deg in [0, 30, 60] {
            let radius = f64::from(elevation_deg).to_radians().cos();
            let around = (0..=120).map(|k| TAU * f64::from(k) / 120.0);
            let ring = around.map(|a| (radius * a.sin(), radius * a.cos())).collect::<Vec<_>>();
            plane.draw(&PathElement::new(ring, GRID))?;
        }
        for satellite in &sky.satellites {
            if let Some(predicted) = satellite.predicted {
                plane.draw(&Circle::new(at(predicted.bearing), 8, INK))?;
            }
            if let Some(arrival) = satellite.arrival {
                let point = at(arrival.bearing);
                let seen = |epoch: &SkyEpoch| {
                    let same = epoch.sky.satellites.iter().find(|s| s.sv == satellite.sv)?;
                    Some(at(same.arrival?.bearing))
                };
                let way: Vec<_> =
                    [point].into_iter().chain(later.iter().filter_map(seen)).collect();
                plane.draw(&PathElement::new(way, INK))?;
                let agrees = satellite.predicted.is_none_or(|p| p.agrees);
                let colour = if agrees { ink(0.33) } else { ink(0.0) };
                plane.draw(&Circle::new(point, 5, colour.filled()))?;
                let label = (point.0 + 0.04, point.1 + 0.05);
                plane.draw(&Text::new(satellite.sv.to_string(), label, (FONT, 12)))?;
            }
        }
        if let Some(picture) = &sky.picture {
            for source in picture.sources.iter().filter_map(|s| s.direction.as_ref()) {
                plane.draw(&Cross::new(at(source.bearing), 6, INK))?;
            }
            for bearing in picture.jammers.iter().filter_map(|j| j.bearing) {
                plane.draw(&TriangleMarker::new(at(bearing), 8, ink(0.0).filled()))?;
            }
        }
        Ok(())
    })
}

/// East and north of the fixes around their median, m, both axes alike.
pub fn east_north_plot(summary: &Summary) -> Result<String, ReportError> {
    let points = summary.offsets_m.iter().map(|o| (o.x, o.y));
    let reach = points.clone().fold(0.5f64, |m, (e, n)| m.max(e.abs()).max(n.abs())) * 1.1;
    draw("east/north plot", (420, 420), |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(48)
            .build_cartesian_2d(-reach..reach, -reach..reach)?;
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .x_desc("east / m")
            .y_desc("north / m")
            .draw()?;
        chart.draw_series(points.map(|p| Circle::new(p, 2, INK.filled())))?;
        Ok(())
    })
}

/// Height of the fixes over the time since the first, m above the median; `times_s` has one entry a fix.
pub fn height_plot(summary: &Summary, times_s: &[f64]) -> Result<String, ReportError> {
    let points = times_s.iter().copied().zip(summary.offsets_m.iter().map(|o| o.z));
    let reach = points.clone().fold(0.5f64, |m, (_, up)| m.max(up.abs())) * 1.1;
    let end = times_s.last().copied().unwrap_or(0.0).max(1e-3);
    draw("height plot", (640, 260), |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..end, -reach..reach)?;
        let description = "up from the median / m";
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .x_desc("time since the first fix / s")
            .y_desc(description)
            .draw()?;
        chart.draw_series(LineSeries::new(points.clone(), INK))?;
        chart.draw_series(points.map(|p| Circle::new(p, 2, INK.filled())))?;
        Ok(())
    })
}

const INKS: [RGBColor; 8] = [
    INK,
    RGBColor(200, 60, 40),
    RGBColor(40, 140, 70),
    RGBColor(150, 80, 170),
    RGBColor(220, 150, 20),
    RGBColor(90, 90, 90),
    RGBColor(20, 160, 170),
    RGBColor(180, 60, 120),
];

impl LinePlot {
    /// As SVG: curves with a legend.
    ///
    /// # Errors
    /// When it cannot be drawn.
    pub fn svg(&self) -> Result<String, ReportError> {
        draw_lines(self)
    }
}

impl HeatMap {
    /// As SVG: a cell for each row and column, white where there is no value, and a colour bar.
    ///
    /// # Errors
    /// When it cannot be drawn.
    pub fn svg(&self) -> Result<String, ReportError> {
        draw_cells(self)
    }
}

fn draw_lines(plot: &LinePlot) -> Result<String, ReportError> {
    let points = || plot.curves.iter().flat_map(|curve| plot.drawable(curve));
    let range = |values: &mut dyn Iterator<Item = f64>, log: bool| {
        let (low, high) = values.fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
        match (low < high, log) {
            (false, _) => 0.5..1.5,
            (true, true) => low / 1.2..high * 1.2,
            // A linear axis of non-negative values starts at 0.
            (true, false) if low >= 0.0 => 0.0..1.03 * high,
            (true, false) => low..high,
        }
    };
    let x = range(&mut points().map(|p| p.0), plot.log[0]);
    let y = range(&mut points().map(|p| p.1), plot.log[1]);
    draw("line plot", (640, 420), |area| match plot.log {
        [false, false] => lines(area, plot, x, y),
        [true, false] => lines(area, plot, x.log_scale(), y),
        [false, true] => lines(area, plot, x, y.log_scale()),
        [true, true] => lines(area, plot, x.log_scale(), y.log_scale()),
    })
}

fn lines<X, Y>(area: &Area, plot: &LinePlot, x: X, y: Y) -> Drawn
where
    X: AsRangedCoord<Value = f64>,
    Y: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64>,
    Y::CoordDescType: ValueFormatter<f64>,
{
    let mut chart = ChartBuilder::on(area)
        .caption(&plot.title, (FONT, 15))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .bold_line_style(RGBColor(230, 230, 230))
        .x_desc(&plot.axes[0])
        .y_desc(&plot.axes[1])
        .draw()?;
    for (curve, ink) in plot.curves.iter().zip(INKS.into_iter().cycle()) {
        let points = plot.drawable(curve);
        chart
            .draw_series(LineSeries::new(points.iter().copied(), ink.stroke_width(2)))?
            .label(&curve.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], ink.stroke_width(2)));
        chart.draw_series(points.into_iter().map(|p| Circle::new(p, 2, ink.filled())))?;
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .border_style(GRID)
        .label_font((FONT, 12))
        .draw()?;
    Ok(())
}

/// Colours from the smallest to the largest value: lightness grows evenly (viridis, five of its colours).
const SCALE: [[f64; 3]; 5] = [
    [68.0, 1.0, 84.0],
    [59.0, 82.0, 139.0],
    [33.0, 145.0, 140.0],
    [94.0, 201.0, 98.0],
    [253.0, 231.0, 37.0],
];

/// The colour of a value from 0 to 1.
fn colour(value: f64) -> RGBColor {
    let point = value.clamp(0.0, 1.0) * (SCALE.len() - 1) as f64;
    let below = (point as usize).min(SCALE.len() - 2);
    let [r, g, b] = std::array::from_fn(|k| {
        let (a, b) = (SCALE[below][k], SCALE[below + 1][k]);
        (a + (b - a) * (point - below as f64)).round() as u8
    });
    RGBColor(r, g, b)
}

/// Steps of the colour bar beside a heat map.
const BAR_STEPS: usize = 32;

fn draw_cells(map: &HeatMap) -> Result<String, ReportError> {
    let (columns, rows) = (map.x.len(), map.rows.len());
    let [low, high] = map.range;
    let bar = columns as f64 * 1.04;
    let width = columns as f64 * 0.04;
    let height = (110 + 26 * rows as u32).max(200);
    draw("heat map", (860, height), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(&map.title, (FONT, 15))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(185)
            .build_cartesian_2d(0.0..columns as f64 * 1.16, rows as f64..0.0)?;
        chart.configure_mesh().disable_mesh().disable_axes().draw()?;
        let cell = |x: [f64; 2], y: [f64; 2], value: f64| {
            Rectangle::new([(x[0], y[0]), (x[1], y[1])], colour(value).filled())
        };
        for (y, values) in map.values.iter().enumerate() {
            let y = y as f64;
            let known = values.iter().enumerate().filter(|(_, v)| !v.is_nan());
            chart.draw_series(known.map(|(x, v)| {
                cell([x as f64, x as f64 + 1.0], [y, y + 1.0], (v - low) / (high - low))
            }))?;
        }
        chart.draw_series((0..BAR_STEPS).map(|k| {
            let value = |k: usize| k as f64 / BAR_STEPS as f64;
            let y = [1.0 - value(k), 1.0 - value(k + 1)].map(|y| y * rows as f64);
            cell([bar, bar + width], y, value(k))
        }))?;

        let at = |x: f64, y: f64| chart.backend_coord(&(x, y));
        let text = |text: &str, point: (i32, i32), h: HPos, v: VPos| {
            let style = (FONT, 12).into_text_style(area).pos(Pos::new(h, v));
            area.draw_text(text, &style, point)
        };
        let ticks = columns.saturating_sub(1).div_ceil(8).max(1);
        for k in (0..columns).step_by(ticks) {
            let (x, y) = at(k as f64 + 0.5, rows as f64);
            text(&short(map.x[k]), (x, y + 5), HPos::Center, VPos::Top)?;
        }
        let (x, y) = at(columns as f64 / 2.0, rows as f64);
        text(&map.x_axis, (x, y + 22), HPos::Center, VPos::Top)?;
        for (k, row) in map.rows.iter().enumerate() {
            let (x, y) = at(0.0, k as f64 + 0.5);
            text(row, (x - 6, y), HPos::Right, VPos::Center)?;
        }
        let (x, y) = at(bar + width, 0.0);
        text(&short(high), (x + 4, y), HPos::Left, VPos::Top)?;
        let (x, y) = at(bar + width, rows as f64);
        text(&short(low), (x + 4, y), HPos::Left, VPos::Bottom)?;
        text(&map.value, (x, y + 5), HPos::Center, VPos::Top)?;
        Ok(())
    })
}

/// A number with the digits of a label.
fn short(value: f64) -> String {
    if value.abs() >= 10.0 || value.fract() == 0.0 {
        format!("{value:.0}")
    } else {
        format!("{value:.2}")
    }
}
