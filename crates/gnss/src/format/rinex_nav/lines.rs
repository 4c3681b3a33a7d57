//! The lines of a RINEX navigation file and the records that they make up.

use crate::GpsTime;
use crate::format::records::{Line, ReadError, whole_fields};

/// The lines of a file without its comments, with their numbers for error messages.
pub struct Lines<'a> {
    pub file: &'a str,
    pub lines: Vec<&'a str>,
    /// From 1.
    numbers: Vec<usize>,
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
    /// The lines of a text; without a field that the end of the text cuts.
    pub fn new(file: &'a str, text: &'a str) -> Self {
        let mut lines: Vec<&str> = text.lines().map(str::trim_end).collect();
        let version: f64 =
            lines.first().and_then(|line| line.get(..9)?.trim().parse().ok()).unwrap_or(3.0);
        if let Some(last) = lines.last_mut().filter(|_| !text.ends_with('\n')) {
            let is_header = last.get(60..).is_some_and(|label| label.contains("HEADER"));
            if last.starts_with("   ") && !is_header {
                *last = whole_fields(last, if version < 3.0 { 3 } else { 4 }, 19);
            }
        }
        let is_comment = |line: &str| {
            line.get(60..).is_some_and(|label| label.trim().eq_ignore_ascii_case("COMMENT"))
        };
        let (numbers, lines) = (1..).zip(lines).filter(|(_, line)| !is_comment(line)).unzip();
        Self { file, lines, numbers }
    }

    /// The line at index `at`, empty beyond the last.
    pub fn line(&self, at: usize) -> Line<'a> {
        let text = self.lines.get(at).copied().unwrap_or("");
        // Beyond the last it is the line after it.
        let number = self.numbers.get(at).or(self.numbers.last().map(|n| n + 1).as_ref()).copied();
        Line { format: "RINEX", file: self.file, number: number.unwrap_or(1), text }
    }

    fn label_is(&self, at: usize, label: &str) -> bool {
        self.columns(at, 60, 20).eq_ignore_ascii_case(label)
    }

    /// Whether a header starts at a line.
    pub fn is_header(&self, at: usize) -> bool {
        self.label_is(at, "RINEX VERSION / TYPE")
    }

    /// Whether a line, of a header that lacks its end, starts a record.
    pub fn starts_record(&self, at: usize, version: f64) -> bool {
        match version {
            4.0.. => self.line(at).text.starts_with("> "),
            3.0.. => self.epoch(at, 4, 4).is_ok(),
            _ => self.epoch(at, 3, 2).is_ok(),
        }
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
            if self.is_header(*at) {
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
