//! The header of a RINEX navigation file.

use super::lines::Lines;
use crate::format::records::ReadError;
use crate::message::lnav::resolve_week;
use crate::navigation_data::UtcParameters;
use crate::time::SECONDS_PER_WEEK;
use crate::{GpsTime, Sv};

/// Leap seconds now; then after the change, its week and day.
type LeapSeconds = (i32, Option<(i32, i32, u8)>);

/// Contents of the header.
pub(super) struct Header {
    pub version: f64,
    /// File type: N (GPS, or any by version 3), or the system of version 2.
    pub system: char,
    pub alpha: Option<[f64; 4]>,
    pub beta: Option<[f64; 4]>,
    pub utc: Option<UtcParameters>,
    /// Leap seconds.
    pub leap: Option<LeapSeconds>,
}

impl Header {
    /// Reads up to END OF HEADER and gives the line after it.
    pub fn read(lines: &Lines) -> Result<(Self, usize), ReadError> {
        let label = |at: usize| lines.columns(at, 60, 20).to_ascii_uppercase();
        if label(0) != "RINEX VERSION / TYPE" {
            let right = "a RINEX file starts with a line that ends in 'RINEX VERSION / TYPE'";
            return Err(lines.malformed(0, "this is no RINEX file", right));
        }
        let version = lines.real(0, 0, 9)?.unwrap_or(0.0);
        let kind = lines.columns(0, 20, 20).to_owned();
        let system = kind.chars().next().unwrap_or(' ').to_ascii_uppercase();
        if !(2.0..5.0).contains(&version) {
            let problem = format!("version {version} is not known");
            return Err(lines.malformed(0, problem, "versions 2.10 to 4.99 are read"));
        }
        if !matches!((system, version < 3.0), ('N', _) | ('G' | 'H' | 'J' | 'E', true)) {
            let problem = format!("the file holds '{kind}'");
            return Err(lines.malformed(0, problem, "a navigation file has N in column 21"));
        }
        let mut header = Self { version, system, alpha: None, beta: None, utc: None, leap: None };
        for at in 1..lines.lines.len() {
            match label(at).as_str() {
                "END OF HEADER" => return Ok((header, at + 1)),
                // Of GPS; QZSS sends coefficients of its own region.
                "ION ALPHA" if system == 'N' => header.alpha = four(lines, at, 2)?,
                "ION BETA" if system == 'N' => header.beta = four(lines, at, 2)?,
                "IONOSPHERIC CORR" => match lines.columns(at, 0, 4) {
                    "GPSA" => header.alpha = four(lines, at, 5)?,
                    "GPSB" => header.beta = four(lines, at, 5)?,
                    _ => {}
                },
                "DELTA-UTC: A0,A1,T,W" => header.utc = utc_line(lines, at, [3, 22, 41, 50, 59])?,
                "TIME SYSTEM CORR" if lines.columns(at, 0, 4) == "GPUT" => {
                    header.utc = utc_line(lines, at, [5, 22, 38, 45, 50])?;
                }
                "LEAP SECONDS" => header.leap = leap_seconds(lines, at)?,
                _ => {}
            }
        }
        let last = lines.lines.len().saturating_sub(1);
        Err(lines.malformed(last, "the header does not end", "it ends with 'END OF HEADER'"))
    }

    /// The satellite of the record at line `at`, none for a system that is skipped.
    pub fn satellite(&self, lines: &Lines, at: usize) -> Result<Option<Sv>, ReadError> {
        let (letter, number) = if self.version < 3.0 {
            // Version 2 names the system once, in the header: N is GPS, G is GLONASS.
            match self.system {
                'N' => ("G", lines.columns(at, 0, 2)),
                'J' => ("J", lines.columns(at, 0, 2)),
                _ => return Ok(None),
            }
        } else {
            (lines.columns(at, 0, 1), lines.columns(at, 1, 2))
        };
        if matches!(letter, "R" | "E" | "C" | "S" | "I") {
            return Ok(None);
        }
        let sv = if matches!(letter, "G" | "J") {
            format!("{letter}{number}").parse().ok()
        } else {
            None
        };
        sv.map(Some).ok_or_else(|| {
            let text = lines.columns(at, 0, 4);
            lines.malformed(
                at,
                format!("'{text}' starts no record"),
                "a satellite such as G07 stands there (7 in version 2)",
            )
        })
    }

    /// UTC parameters with the header's leap seconds, or those of the built-in table.
    pub fn with_leap_seconds(&self, utc: UtcParameters) -> UtcParameters {
        // A count of 0 ended in 1981: it stands where none is known.
        let leap = self.leap.filter(|leap| leap.0 > 0);
        let now = leap.map_or(utc.tot.leap_seconds(), |leap| leap.0);
        let (delta_t_lsf, week, day) =
            leap.and_then(|leap| leap.1).unwrap_or((now, utc.tot.week(), 1));
        let wn_lsf = if week < 256 { resolve_week(week as u32, 8, utc.tot.week()) } else { week };
        UtcParameters { delta_t_ls: now, delta_t_lsf, wn_lsf, day, ..utc }
    }
}

/// Four coefficients of 12 columns each, none if all are blank.
fn four(lines: &Lines, at: usize, start: usize) -> Result<Option<[f64; 4]>, ReadError> {
    let mut values = [0.0; 4];
    for (k, value) in values.iter_mut().enumerate() {
        match lines.real(at, start + 12 * k, 12)? {
            Some(v) => *value = v,
            None if k == 0 => return Ok(None),
            None => {
                return Err(lines.malformed(
                    at,
                    "a coefficient is missing",
                    "four of 12 columns each stand there",
                ));
            }
        }
    }
    Ok(Some(values))
}

/// A0, A1, reference time and week, at the columns given; none if the week is blank or zero.
fn utc_line(lines: &Lines, at: usize, c: [usize; 5]) -> Result<Option<UtcParameters>, ReadError> {
    let field = |k: usize| lines.real(at, c[k], c[k + 1] - c[k]);
    let (Some(a0), Some(a1), Some(tot), Some(week)) = (field(0)?, field(1)?, field(2)?, field(3)?)
    else {
        return Ok(None);
    };
    // Polynomial and reference are zeros where none is known.
    let known = (a0, a1, tot) != (0.0, 0.0, 0.0)
        && (1.0..1e4).contains(&week)
        && (0.0..=SECONDS_PER_WEEK as f64).contains(&tot);
    Ok(known.then(|| utc_parameters(a0, a1, GpsTime::from_week_tow(week as i32, tot))))
}

/// UTC parameters whose leap seconds are still to be filled in.
pub fn utc_parameters(a0: f64, a1: f64, tot: GpsTime) -> UtcParameters {
    UtcParameters { a0, a1, tot, delta_t_ls: 0, delta_t_lsf: 0, wn_lsf: 0, day: 1 }
}

/// One integer, or four: now, after the change, week, day.
fn leap_seconds(lines: &Lines, at: usize) -> Result<Option<LeapSeconds>, ReadError> {
    let text = lines.columns(at, 0, 24);
    let values: Vec<i32> = text.split_whitespace().map_while(|w| w.parse().ok()).collect();
    match values[..] {
        [] if text.is_empty() => Ok(None),
        [now] => Ok(Some((now, None))),
        [now, future, week, day, ..] if week >= 0 && (0..=7).contains(&day) => {
            Ok(Some((now, Some((future, week, day as u8)))))
        }
        _ => Err(lines.malformed(
            at,
            format!("'{text}' is no count of leap seconds"),
            "one whole number or four (now, after the change, week, day) stand there",
        )),
    }
}
