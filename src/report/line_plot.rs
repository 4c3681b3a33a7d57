//! Curves over one variable: as a plot and as a table of comma-separated values.

use std::fmt::Write;

/// One curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// Its points (x, y), x ascending.
    pub points: Vec<(f64, f64)>,
}

/// Some curves over the same axes.
#[derive(Clone, Debug, PartialEq)]
pub struct LinePlot {
    /// The file's name without its suffix.
    pub name: String,
    /// Title.
    pub title: String,
    /// Quantities of x and y, with their units.
    pub axes: [String; 2],
    /// Whether x and y are logarithmic: then only points above 0 are drawn.
    pub log: [bool; 2],
    /// The curves.
    pub curves: Vec<Curve>,
}

impl LinePlot {
    /// As CSV, one line a point: curve, x, y.
    pub fn csv(&self) -> String {
        let [x, y] = self.axes.each_ref().map(|axis| axis.replace(',', ";"));
        let mut text = format!("curve,{x},{y}\n");
        for curve in &self.curves {
            let name = curve.name.replace(',', ";");
            for (x, y) in &curve.points {
                let _ = writeln!(text, "{name},{x},{y:.6e}");
            }
        }
        text
    }

    /// The points that can be drawn.
    pub(super) fn drawable(&self, curve: &Curve) -> Vec<(f64, f64)> {
        let fits = |value: f64, log: bool| value.is_finite() && (value > 0.0 || !log);
        let points = curve.points.iter().copied();
        points.filter(|p| fits(p.0, self.log[0]) && fits(p.1, self.log[1])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_drawn_on_every_kind_of_axes_and_listed() {
        for log in [[false, false], [true, false], [false, true], [true, true]] {
            let points = vec![(0.0, 1.0), (1.0, 0.1), (10.0, f64::NAN), (100.0, 1e-4)];
            let plot = LinePlot {
                name: "name".into(),
                title: "title".into(),
                axes: ["SNR / dB".into(), "NMSE".into()],
                log,
                curves: vec![Curve { name: "LDA-l1,1".into(), points }],
            };
            let svg = plot.svg().unwrap();
            assert!(svg.starts_with("<svg") && svg.contains("LDA-l1,1") && svg.contains("NMSE"));
            assert!(plot.csv().starts_with("curve,SNR / dB,NMSE\nLDA-l1;1,0,1.000000e0\n"));
        }
    }
}
