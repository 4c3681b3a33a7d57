//! Lines with fixed columns, as in RINEX, SP3 and element sets, and their errors.

use super::unpack::{MOST_TEXT_BYTES, bounded, is_damage, unpack};
use crate::GpsTime;
use std::fmt;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Why a file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("reading the {format} file {path}: {source}")]
    Io {
        /// Expected format, such as RINEX.
        format: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A line does not follow the format.
    #[error("reading {format} {file}, line {line}: {problem}; {right}")]
    Malformed {
        /// Expected format, such as RINEX.
        format: &'static str,
        /// The file.
        file: String,
        /// Line number, from 1.
        line: usize,
        /// The fault.
        problem: String,
        /// What is valid.
        right: String,
    },
}

/// Records of a file that were left out because they do not follow the format, by kind.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeftOut {
    kinds: Vec<LeftOutKind>,
}

/// Records of one kind that were left out.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOutKind {
    /// What they are, in the plural, such as `epochs left out`.
    pub what: &'static str,
    /// How many.
    pub count: usize,
    /// The first: file, line, what is wrong, and what would be right.
    pub first: String,
}

impl fmt::Display for LeftOutKind {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} {}; the first: {}", self.count, self.what, self.first)
    }
}

/// What is left out where a packed file ends early or is damaged.
pub(crate) const NOT_UNPACKED: &str = "ends of packed files left out";

impl LeftOut {
    pub(crate) fn add(&mut self, what: &'static str, error: &ReadError) {
        match self.kinds.iter_mut().find(|kind| kind.what == what) {
            Some(kind) => kind.count += 1,
            None => self.kinds.push(LeftOutKind { what, count: 1, first: error.to_string() }),
        }
    }

    /// Adds what cannot be unpacked.
    pub(crate) fn add_damage(&mut self, damage: Option<&ReadError>) {
        damage.into_iter().for_each(|error| self.add(NOT_UNPACKED, error));
    }

    /// Each kind, in the order of their first lines.
    pub fn kinds(&self) -> &[LeftOutKind] {
        &self.kinds
    }
}

/// Text with lines that end in a line feed, without byte order marks, and without NUL and end-of-file characters (^Z) at
/// the end of lines and before headers. Elsewhere they are '?', as anything beyond ASCII is, so that columns stay in place.
pub(crate) fn plain(text: &str) -> String {
    let text = text.replace("\r\n", "\n").replace('\r', "\n");
    let lines: Vec<String> = text.split('\n').map(plain_line).collect();
    lines.join("\n")
}

fn plain_line(line: &str) -> String {
    const ENDS: [char; 2] = ['\0', '\u{1a}'];
    let line = line.trim_start_matches('\u{feff}').trim_end_matches(ENDS);
    let rest = line.trim_start_matches(ENDS).trim_start_matches('\u{feff}');
    let line = if rest.contains("VERSION / TYPE") || rest.starts_with("#") { rest } else { line };
    line.chars().map(|c| if c.is_ascii() && !ENDS.contains(&c) { c } else { '?' }).collect()
}

/// The text of a file.
pub(crate) struct Text {
    /// Anything beyond ASCII (names in comments) is one '?', so that columns can be counted in bytes.
    pub text: String,
    /// Why the rest of the file cannot be unpacked.
    pub damage: Option<ReadError>,
}

/// The whole text of a file, unpacked, as far as it can be.
pub(crate) fn read_text(format: &'static str, path: &Path) -> Result<Text, ReadError> {
    let io = |source| ReadError::Io { format, path: path.to_owned(), source };
    let file = BufReader::new(File::open(path).map_err(io)?);
    let unpacked = unpack(file, MOST_TEXT_BYTES).map_err(io)?;
    let mut bytes = Vec::new();
    let read = bounded(unpacked, MOST_TEXT_BYTES).read_to_end(&mut bytes);
    let damage = match read {
        Ok(_) => None,
        Err(error) if is_damage(&error) && !bytes.is_empty() => Some(io(error)),
        Err(error) => return Err(io(error)),
    };
    Ok(Text { text: plain(&String::from_utf8_lossy(&bytes)), damage })
}

/// A line in fields of `width` columns from `start` without a field that the end of the file cuts: numbers end at
/// the last column of their field.
pub(crate) fn whole_fields(text: &str, start: usize, width: usize) -> &str {
    let fields = text.len().saturating_sub(start) / width;
    text.get(..start + width * fields).unwrap_or("")
}

/// A line and its number for error messages.
#[derive(Clone, Copy)]
pub(crate) struct Line<'a> {
    pub format: &'static str,
    pub file: &'a str,
    /// From 1.
    pub number: usize,
    pub text: &'a str,
}

impl<'a> Line<'a> {
    pub fn malformed(&self, problem: impl Into<String>, right: impl Into<String>) -> ReadError {
        ReadError::Malformed {
            format: self.format,
            file: self.file.to_owned(),
            line: self.number,
            problem: problem.into(),
            right: right.into(),
        }
    }

    /// The text of `width` columns from `start` (from 0), without blanks around it.
    pub fn columns(&self, start: usize, width: usize) -> &'a str {
        let text = self.text;
        text.get(start.min(text.len())..(start + width).min(text.len())).unwrap_or("").trim()
    }

    /// A real number in fixed columns (Fortran's D exponent or E), none when they are blank.
    pub fn real(&self, start: usize, width: usize) -> Result<Option<f64>, ReadError> {
        let text = self.columns(start, width);
        if text.is_empty() {
            return Ok(None);
        }
        let value: Option<f64> = match text.parse() {
            Ok(value) => Some(value),
            Err(_) => text.replace(['D', 'd'], "e").parse().ok(),
        };
        value.filter(|v| v.is_finite()).map(Some).ok_or_else(|| {
            self.malformed(
                format!("'{text}' in columns {} to {} is no number", start + 1, start + width),
                "a number such as 0.469126738608D-03 stands there",
            )
        })
    }

    pub fn integer<T: std::str::FromStr>(
        &self,
        start: usize,
        width: usize,
    ) -> Result<T, ReadError> {
        let text = self.columns(start, width);
        text.parse().map_err(|_| {
            let (first, last) = (start + 1, start + width);
            let problem = format!("'{text}' in columns {first} to {last} is no whole number");
            self.malformed(problem, "digits stand there")
        })
    }

    /// Calendar date and time at column `start`, of a year of 2 or 4 digits and seconds in `seconds_width`
    /// columns.
    pub fn epoch(
        &self,
        start: usize,
        year_digits: usize,
        seconds_width: usize,
    ) -> Result<GpsTime, ReadError> {
        let mut year: i32 = self.integer(start, year_digits)?;
        if year_digits == 2 {
            year += if year < 80 { 2000 } else { 1900 };
        }
        let rest = start + year_digits;
        let two = |k: usize| self.integer::<u32>(rest + 3 * k, 3);
        let (month, day, hour, minute) = (two(0)?, two(1)?, two(2)?, two(3)?);
        let second = self.real(rest + 12, seconds_width)?.unwrap_or(f64::NAN);
        let possible = (1980..2200).contains(&year)
            && (1..=12).contains(&month)
            && (1..=31).contains(&day)
            && hour <= 24
            && minute <= 60
            && (0.0..=60.0).contains(&second);
        if !possible {
            let text = self.columns(start, year_digits + 12 + seconds_width);
            return Err(self.malformed(
                format!("'{text}' is no date"),
                "year, month, day, hour, minute and second stand there",
            ));
        }
        Ok(GpsTime::from_calendar(year, month, day, hour, minute, second))
    }
}
