//! The lines of a RINEX navigation file and the records that they make up.

use crate::GpsTime;
use crate::format::records::{Line, ReadError};

/// The lines of a file, with their numbers for error messages.
pub struct Lines<'a> {
    pub file: &'a str,
    pub lines: Vec<&'a str>,
}

/// First line of a version 4 record: `> EPH G01 LNAV`.
pub struct Frame<'a> {
    pub kind: &'a str,
    pub satellite: &'a str,
    pub message: &'a str,
}

impl Frame<'_> {
    /// Letter of the satellite's system.
    pub fn system(&self) -> char {
        self.satellite.chars().next().unwrap_or(' ')
    }
}

impl<'a> Lines<'a> {
    /// The line at index `at`, empty beyond the last.
    pub fn line(&self, at: usize) -> Line<'a> {
        let text = self.lines.get(at).copied().unwrap_or("");
        Line { format: "RINEX", file: self.file, number: at + 1, text }
    }

    fn label_is(&self, at: usize, label: &str) -> bool {
        self.columns(at, 60, 20).eq_ignore_ascii_case(label)
    }

    /// Whether a header starts at a line.
    pub fn is_header(&self, at: usize) -> bool {
        self.label_is(at, "RINEX VERSION / TYPE")
    }

    pub fn is_comment(&self, at: usize) -> bool {
        self.label_is(at, "COMMENT")
    }

    pub fn malformed(
        &self,
        at: usize,
        problem: impl Into<String>,
        right: impl Into<String>,
    ) -> ReadError {
        self.line(at).malformed(problem, right)
    }

    pub fn columns(&self, at: usize, start: usize, width: usize) -> &'a str {
        self.line(at).columns(start, width)
    }

    pub fn real(&self, at: usize, start: usize, width: usize) -> Result<Option<f64>, ReadError> {
        self.line(at).real(start, width)
    }

    pub fn frame(&self, at: usize) -> Result<Frame<'a>, ReadError> {
        let mut words = self.lines[at].split_whitespace();
        match (words.next(), words.next(), words.next(), words.next()) {
            (Some(">"), Some(kind), Some(satellite), message) => {
                Ok(Frame { kind, satellite, message: message.unwrap_or("") })
            }
            _ => Err(self.malformed(
                at,
                format!("'{}' starts no record", self.lines[at]),
                "a version 4 record starts as in '> EPH G01 LNAV'",
            )),
        }
    }

    /// The line after the record that starts at `first`: the next that is not indented, in version 4 the
    /// next that begins with `>`.
    pub fn record_end(&self, first: usize, version: f64) -> usize {
        let indent = if version < 3.0 { 3 } else { 4 };
        let continues = |at: &usize| {
            let line = self.lines[*at];
            if self.is_header(*at) || self.is_comment(*at) {
                return false;
            }
            if version >= 4.0 {
                !line.starts_with('>')
            } else {
                line.is_empty() || self.columns(*at, 0, indent).is_empty()
            }
        };
        (first + 1..self.lines.len()).find(|at| !continues(at)).unwrap_or(self.lines.len())
    }

    /// Calendar date and time at column `start`, of a year of 2 or 4 digits.
    pub fn epoch(&self, at: usize, start: usize, year_digits: usize) -> Result<GpsTime, ReadError> {
        self.line(at).epoch(start, year_digits, if year_digits == 2 { 5 } else { 3 })
    }
}
