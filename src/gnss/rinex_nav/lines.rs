//! Lines, columns and numbers of a RINEX file, with their places for error messages.

use super::RinexError;
use super::header::Header;
use crate::gnss::GpsTime;

/// The lines of a file, with their places for error messages.
pub struct Lines<'a> {
    pub file: &'a str,
    pub lines: Vec<&'a str>,
}

/// First line of a version 4 record: `> EPH G01 LNAV`.
pub struct Frame<'a> {
    pub kind: &'a str,
    pub message: &'a str,
}

impl<'a> Lines<'a> {
    pub fn malformed(
        &self,
        at: usize,
        problem: impl Into<String>,
        right: impl Into<String>,
    ) -> RinexError {
        let (problem, right) = (problem.into(), right.into());
        RinexError::Malformed { file: self.file.to_owned(), line: at + 1, problem, right }
    }

    pub fn columns(&self, at: usize, start: usize, width: usize) -> &'a str {
        let line = self.lines.get(at).copied().unwrap_or("");
        line.get(start.min(line.len())..(start + width).min(line.len())).unwrap_or("").trim()
    }

    /// A real number in fixed columns (Fortran's D exponent or E), none when they are blank.
    pub fn real(&self, at: usize, start: usize, width: usize) -> Result<Option<f64>, RinexError> {
        let text = self.columns(at, start, width);
        if text.is_empty() {
            return Ok(None);
        }
        let value: Option<f64> = text.replace(['D', 'd'], "e").parse().ok();
        value.filter(|v| v.is_finite()).map(Some).ok_or_else(|| {
            let last = start + width;
            self.malformed(
                at,
                format!("'{text}' in columns {} to {last} is no number", start + 1),
                "a number such as 0.469126738608D-03 stands there",
            )
        })
    }

    pub fn integer<T: std::str::FromStr>(
        &self,
        at: usize,
        start: usize,
        width: usize,
    ) -> Result<T, RinexError> {
        let text = self.columns(at, start, width);
        text.parse().map_err(|_| {
            let last = start + width;
            let problem = format!("'{text}' in columns {} to {last} is no whole number", start + 1);
            self.malformed(at, problem, "digits stand there")
        })
    }

    pub fn frame(&self, at: usize) -> Result<Frame<'a>, RinexError> {
        let mut words = self.lines[at].split_whitespace();
        match (words.next(), words.next(), words.next(), words.next()) {
            (Some(">"), Some(kind), Some(_), message) => {
                Ok(Frame { kind, message: message.unwrap_or("") })
            }
            _ => Err(self.malformed(
                at,
                format!("'{}' starts no record", self.lines[at]),
                "a version 4 record starts as in '> EPH G01 LNAV'",
            )),
        }
    }

    /// The line after the record that starts at `first`: the next that is not indented.
    pub fn record_end(&self, first: usize, header: &Header) -> usize {
        let indent = if header.version < 3.0 { 3 } else { 4 };
        let continues = |at: &usize| {
            let line = self.lines[*at];
            if header.version >= 4.0 {
                !line.starts_with('>')
            } else {
                line.is_empty() || self.columns(*at, 0, indent).is_empty()
            }
        };
        (first + 1..self.lines.len()).find(|at| !continues(at)).unwrap_or(self.lines.len())
    }

    /// Calendar date and time at column `start`, of a year of 2 or 4 digits.
    pub fn epoch(
        &self,
        at: usize,
        start: usize,
        year_digits: usize,
    ) -> Result<GpsTime, RinexError> {
        let mut year: i32 = self.integer(at, start, year_digits)?;
        if year_digits == 2 {
            year += if year < 80 { 2000 } else { 1900 };
        }
        let rest = start + year_digits;
        let two = |k: usize| self.integer::<u32>(at, rest + 3 * k, 3);
        let (month, day, hour, minute) = (two(0)?, two(1)?, two(2)?, two(3)?);
        let seconds_width = if year_digits == 2 { 5 } else { 3 };
        let second = self.real(at, rest + 12, seconds_width)?.unwrap_or(f64::NAN);
        let possible = (1980..2200).contains(&year)
            && (1..=12).contains(&month)
            && (1..=31).contains(&day)
            && hour <= 24
            && minute <= 60
            && (0.0..=60.0).contains(&second);
        if !possible {
            let text = self.columns(at, start, year_digits + 17);
            return Err(self.malformed(
                at,
                format!("'{text}' is no date"),
                "year, month, day, hour, minute and second stand there",
            ));
        }
        Ok(GpsTime::from_calendar(year, month, day, hour, minute, second))
    }
}
