//! The header of a RINEX navigation file.

use super::lines::Lines;
use crate::format::records::{LeftOut, ReadError};
use crate::galileo_data::GalileoGpsOffset;
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
    /// Time of Galileo against that of GPS.
    pub galileo: Option<GalileoGpsOffset>,
    /// Leap seconds.
    pub leap: Option<LeapSeconds>,
}

impl Header {
    /// Reads from line `start` up to END OF HEADER and gives the line after it. What no position needs may be malformed:
    /// it is left out.
    pub fn read(
        lines: &Lines,
        start: usize,
        left_out: &mut LeftOut,
    ) -> Result<(Self, usize), ReadError> {
        if !lines.is_header(start) {
            let right = "a RINEX file starts with a line that ends in 'RINEX VERSION / TYPE'";
            return Err(lines.malformed(start, "this is no RINEX file", right));
        }
        let version = lines.real(start, 0, 9)?.unwrap_or(0.0);
        let kind = lines.columns(start, 20, 20).to_owned();
        let system = kind.chars().next().unwrap_or(' ').to_ascii_uppercase();
        if !(2.0..5.0).contains(&version) {
            let problem = format!("version {version} is not known");
            return Err(lines.malformed(start, problem, "versions 2.10 to 4.99 are read"));
        }
        if !matches!((system, version < 3.0), ('N', _) | ('G' | 'H' | 'J' | 'E', true)) {
            let problem = format!("the file holds '{kind}'");
            return Err(lines.malformed(start, problem, "a navigation file has N in column 21"));
        }
        let mut header =
            Self { version, system, alpha: None, beta: None, utc: None, galileo: None, leap: None };
        for at in start + 1..lines.lines.len() {
            if lines.columns(at, 60, 20).eq_ignore_ascii_case("END OF HEADER") {
                return Ok((header, at + 1));
            }
            if lines.is_header(at) {
                let right = "it ends with 'END OF HEADER'";
                let problem = "a header starts before the last one ended";
                return Err(lines.malformed(at, problem, right));
            }
            if lines.starts_record(at, version) {
                let right = "'END OF HEADER' stands before it";
                let error = lines.malformed(at, "a record follows the header", right);
                left_out.add("headers without an end", &error);
                return Ok((header, at));
            }
            if let Err(error) = header.take(lines, at) {
                left_out.add("lines of the header left out", &error);
            }
        }
        let last = lines.lines.len().saturating_sub(1);
        Err(lines.malformed(last, "the header does not end", "it ends with 'END OF HEADER'"))
    }

    fn take(&mut self, lines: &Lines, at: usize) -> Result<(), ReadError> {
        match lines.columns(at, 60, 20).to_ascii_uppercase().as_str() {
            // Of GPS; QZSS sends coefficients of its own region.
            "ION ALPHA" if self.system == 'N' => self.alpha = four(lines, at, 2)?,
            "ION BETA" if self.system == 'N' => self.beta = four(lines, at, 2)?,
            "IONOSPHERIC CORR" => match lines.columns(at, 0, 4) {
                "GPSA" => self.alpha = four(lines, at, 5)?,
                "GPSB" => self.beta = four(lines, at, 5)?,
                _ => {}
            },
            "DELTA-UTC: A0,A1,T,W" => self.utc = utc_line(lines, at, [3, 22, 41, 50, 59])?,
            "TIME SYSTEM CORR" if lines.columns(at, 0, 4) == "GPUT" => {
                self.utc = utc_line(lines, at, [5, 22, 38, 45, 50])?;
            }
            // GAGP until version 3.03, with the same sign.
            "TIME SYSTEM CORR" if ["GAGP", "GPGA"].contains(&lines.columns(at, 0, 4)) => {
                let sent = utc_line(lines, at, [5, 22, 38, 45, 50])?;
                self.galileo =
                    sent.map(|sent| GalileoGpsOffset { a0: sent.a0, a1: sent.a1, t0: sent.tot });
            }
            "LEAP SECONDS" => self.leap = leap_seconds(lines, at)?,
            _ => {}
        }
        Ok(())
    }

    /// The satellite of the record at line `at`, none for a system that is skipped.
    pub fn satellite(&self, lines: &Lines, at: usize) -> Result<Option<Sv>, ReadError> {
        let (letter, number) = if self.version < 3.0 {
            // Version 2 names the system once, in the header: N is GPS, G is GLONASS.
            match self.system {
                'N' => ("G", lines.columns(at, 0, 2)),
                'J' => ("J", lines.columns(at, 0, 2)),
                'G' => ("R", lines.columns(at, 0, 2)),
                _ => return Ok(None),
            }
        } else {
            (lines.columns(at, 0, 1), lines.columns(at, 1, 2))
        };
        if matches!(letter, "S" | "I") {
            return Ok(None);
        }
        let sv = if matches!(letter, "G" | "J" | "R" | "E" | "C") {
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

/// One integer of six columns, or four: now, after the change, week, day. What of the change is missing or impossible is
/// not known.
fn leap_seconds(lines: &Lines, at: usize) -> Result<Option<LeapSeconds>, ReadError> {
    let field = |k: usize| lines.columns(at, 6 * k, 6).parse::<i32>().ok();
    let text = lines.columns(at, 0, 24);
    let now = field(0).or_else(|| text.split_whitespace().next()?.parse().ok());
    let change = match (field(1), field(2), field(3)) {
        (Some(future), Some(week), Some(day)) if week >= 0 && (0..=7).contains(&day) => {
            Some((future, week, day as u8))
        }
        _ => None,
    };
    match now {
        Some(now) => Ok(Some((now, change))),
        None if text.is_empty() => Ok(None),
        None => Err(lines.malformed(
            at,
            format!("'{text}' is no count of leap seconds"),
            "one whole number or four (now, after the change, week, day) stand there",
        )),
    }
}
