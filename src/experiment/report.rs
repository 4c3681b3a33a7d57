//! The sweep as table, CSV and plot.

use super::SweepRow;
use crate::report::{Dot, ReportError, dot_plot};
use std::fmt::Write;

/// One line a setting.
pub fn table(rows: &[SweepRow]) -> String {
    let mut text = String::from(
        "property         setting                found  false   loss/dB  expected/dB  theory/dB   code/m  Doppler/Hz  direction  fixes  position/m\n",
    );
    for r in rows {
        let found = format!("{}/{}", r.found, r.satellites);
        let fixes = format!("{}/{}", r.fixes, r.runs);
        let _ = writeln!(
            text,
            "{:16} {:20} {found:>7} {:6} {} {} {} {} {} {} {fixes:>6} {}",
            r.property,
            r.setting,
            r.false_ones,
            number(r.loss_db, 9, 2),
            number(r.expected_loss_db, 12, 2),
            number(r.theory_loss_db, 10, 2),
            number(r.code_m, 8, 2),
            number(r.doppler_hz, 11, 2),
            number(r.direction, 10, 3),
            number(r.position_m, 11, 1),
        );
    }
    text
}

/// A number, or a dash for none.
fn number(value: Option<f64>, width: usize, digits: usize) -> String {
    value.map_or(format!("{:>width$}", "-"), |v| format!("{v:width$.digits$}"))
}

/// The rows with a header; absent values are empty.
pub fn csv(rows: &[SweepRow]) -> String {
    let mut text = String::from(
        "property,setting,satellites,found,false,loss_db,expected_loss_db,theory_loss_db,code_rms_m,doppler_rms_hz,direction_rms,runs,fixes,position_rms_m\n",
    );
    let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.4}"));
    for r in rows {
        let _ = writeln!(
            text,
            "{},\"{}\",{},{},{},{},{},{},{},{},{},{},{},{}",
            r.property,
            r.setting,
            r.satellites,
            r.found,
            r.false_ones,
            number(r.loss_db),
            number(r.expected_loss_db),
            number(r.theory_loss_db),
            number(r.code_m),
            number(r.doppler_hz),
            number(r.direction),
            r.runs,
            r.fixes,
            number(r.position_m)
        );
    }
    text
}

/// Loss of C/N0 as SVG: measured as discs, what is expected as rings.
///
/// # Errors
/// When the drawing fails.
pub fn plot(rows: &[SweepRow]) -> Result<String, ReportError> {
    let dots: Vec<Dot> = rows
        .iter()
        .filter(|r| r.loss_db.is_some())
        .map(|r| Dot {
            label: format!("{} {}", r.property, r.setting),
            disc: r.loss_db,
            ring: r.expected_loss_db,
        })
        .collect();
    dot_plot("loss of C/N0 / dB (disc: measured, ring: expected)", &dots)
}
