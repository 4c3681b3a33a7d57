//! The fields of a record of a RINEX navigation file.

use super::lines::Lines;
use crate::format::records::ReadError;
use crate::{GpsTime, Sv};
use std::ops::Range;

/// The record of a satellite: lines of four fields, the first of which hold its epoch.
pub struct RecordFields<'a> {
    pub lines: &'a Lines<'a>,
    pub range: Range<usize>,
    pub sv: Sv,
    /// Of the file.
    pub version: f64,
}

impl RecordFields<'_> {
    /// Column where the fields of a line begin.
    fn column(&self) -> usize {
        if self.version < 3.0 { 3 } else { 4 }
    }

    /// Calendar date and time of its first line.
    pub fn epoch(&self) -> Result<GpsTime, ReadError> {
        let (start, digits) = if self.version < 3.0 { (3, 2) } else { (4, 4) };
        self.lines.epoch(self.range.start, start, digits)
    }

    /// Lines that are not empty, at most `most`.
    pub fn count(&self, most: usize) -> Result<usize, ReadError> {
        let count = self.range.clone().filter(|at| !self.lines.lines[*at].is_empty()).count();
        if count <= most {
            return Ok(count);
        }
        let problem = format!("the record of {} has {count} lines", self.sv);
        Err(self.malformed(0, problem, format!("it has {most}")))
    }

    /// A complaint about its line `row`.
    pub fn malformed(&self, row: usize, problem: String, right: impl Into<String>) -> ReadError {
        let at = (self.range.start + row).min(self.range.end - 1);
        self.lines.malformed(at, problem, right)
    }

    /// Field `k`, of which four are on a line and 0 is in place of the epoch; none where it is blank or missing.
    pub fn field(&self, k: usize) -> Result<Option<f64>, ReadError> {
        let at = self.range.start + k / 4;
        match self.range.contains(&at) {
            true => self.lines.real(at, self.column() + 19 * (k % 4), 19),
            false => Ok(None),
        }
    }

    /// Field `k`, which must be there and between two numbers.
    pub fn within(&self, k: usize, name: &str, min: f64, max: f64) -> Result<f64, ReadError> {
        let value = self.field(k)?;
        value.filter(|v| (min..=max).contains(v)).ok_or_else(|| {
            let sv = self.sv;
            let problem = match value {
                Some(v) => format!("{name} of {sv} is {v:e}"),
                None if self.range.start + k / 4 >= self.range.end => {
                    let count = self.range.len();
                    format!("the record of {sv} ends after {count} lines, before {name}")
                }
                None => format!("{name} of {sv} is blank"),
            };
            self.malformed(k / 4, problem, format!("it lies in {min:e} to {max:e}"))
        })
    }

    /// Field `k`, which must be there.
    pub fn any(&self, k: usize, name: &str) -> Result<f64, ReadError> {
        self.within(k, name, -1e9, 1e9)
    }
}
