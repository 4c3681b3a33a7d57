//! Plots as SVG. The drawing library is named in this file only.

use super::{LinePlot, ReportError, SkyEntry, Summary};
use crate::array::{ArraySky, Bearing};
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
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
    /// What it is.
    pub label: String,
    /// Where its disc lies, if anywhere.
    pub disc: Option<f64>,
    /// Where its ring lies, if anywhere.
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

/// The sky: zenith in the middle, horizon at the edge, north up; colour from red (30 dB-Hz) to green (50).
pub fn sky_plot(sky: &[SkyEntry]) -> Result<String, ReportError> {
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
        for s in sky {
            let place = at((1.0 - s.elevation / FRAC_PI_2).clamp(0.0, 1.0), s.azimuth);
            let colour = s.cn0_dbhz.map_or(RGBColor(128, 128, 128), |cn0| {
                let share = ((cn0 - 30.0) / 20.0).clamp(0.0, 1.0);
                let (r, g, b) = HSLColor(share / 3.0, 0.8, 0.4).to_backend_color().rgb;
                RGBColor(r, g, b)
            });
            plane.draw(&Circle::new(place, 7, colour.filled()))?;
            let cn0 = s.cn0_dbhz.map_or(String::new(), |c| format!(" {c:.0}"));
            plane.draw(&Text::new(
                format!("{}{cn0}", s.sv),
                (place.0 + 0.04, place.1 + 0.07),
                (FONT, 12),
            ))?;
        }
        Ok(())
    })
}

/// Directions as an array sees them, in direction cosines: of a plane east and north at the edge and the zenith
/// in the middle, of a linear array on the half circle, broadside up. Circles are satellites (hollow where they
/// should be), crosses the sources found without a code, triangles jammers.
pub fn arrival_plot(sky: &ArraySky) -> Result<String, ReportError> {
    let at = |bearing: Bearing| match bearing {
        Bearing::Cone(angle) => angle.sin_cos(),
        Bearing::Direction { azimuth, elevation } => {
            (elevation.cos() * azimuth.sin(), elevation.cos() * azimuth.cos())
        }
    };
    let ink = |share: f64| {
        let (r, g, b) = HSLColor(share, 0.8, 0.4).to_backend_color().rgb;
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
                let place = at(arrival.bearing);
                let agrees = satellite.predicted.is_none_or(|p| p.agrees);
                let colour = if agrees { ink(0.33) } else { ink(0.0) };
                plane.draw(&Circle::new(place, 5, colour.filled()))?;
                let label = (place.0 + 0.04, place.1 + 0.05);
                plane.draw(&Text::new(satellite.sv.to_string(), label, (FONT, 12)))?;
            }
        }
        if let Some(picture) = &sky.picture {
            for source in &picture.sources {
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

/// Curves with a legend.
pub(super) fn draw_lines(plot: &LinePlot) -> Result<String, ReportError> {
    let points = || plot.curves.iter().flat_map(|curve| plot.drawable(curve));
    let range = |values: &mut dyn Iterator<Item = f64>, log: bool| {
        let (low, high) = values.fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
        match (low < high, log) {
            (false, _) => 0.5..1.5,
            (true, true) => low / 1.2..high * 1.2,
            // A linear axis of what is never negative starts at 0.
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
