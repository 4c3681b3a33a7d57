//! Reader of RINEX navigation files: versions 2.10 to 2.12 of GPS, QZSS and GLONASS, 3.0x and 4.0x of these, Galileo
//! I/NAV and BeiDou D1 and D2.
//!
//! Sources: RINEX 2.11 tables A3-A4 and A10-A11, 3.05 tables A5 to A14, 4.01 sections 5.2 to 5.4. Records of
//! other systems and message types, F/NAV among them, are skipped and counted. Deviations of
//! real files are accepted (D exponents, labels in any case, CRLF, blank optional fields, a missing last line);
//! errors name file, line and what is valid.

mod glonass;
mod header;
mod keplerian;
mod lines;
mod record;
pub(super) mod write;

pub use write::write;

use crate::atmosphere::Klobuchar;
use crate::format::records::{LeftOut, ReadError, plain, read_text};
use crate::navigation_data::UtcParameters;
use crate::{Constellation, NavigationData};
use header::{Header, utc_parameters};
use lines::Lines;
use record::RecordFields;
use std::path::Path;

/// Contents of a navigation file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NavigationFile {
    /// The format's version, such as 3.04.
    pub version: f64,
    /// Ephemerides, ionosphere and UTC of GPS.
    pub data: NavigationData,
    /// Records of other systems and messages that were skipped.
    pub skipped: usize,
    /// Records and lines of the header that do not follow the format.
    pub left_out: LeftOut,
}

/// Reads a RINEX navigation file.
///
/// # Errors
/// As [`parse`], and when the file cannot be read.
pub fn read(path: impl AsRef<Path>) -> Result<NavigationFile, ReadError> {
    let path = path.as_ref();
    let file = read_text("RINEX", path)?;
    let mut parsed = parse(&file.text, &path.display().to_string())?;
    parsed.left_out.add_damage(file.damage.as_ref());
    Ok(parsed)
}

/// Parses the text of a RINEX navigation file, or of several one after the other; `name` stands in error messages. A
/// malformed record loses itself only.
///
/// # Errors
/// When the text is no RINEX navigation file, or holds nothing but malformed records.
pub fn parse(text: &str, name: &str) -> Result<NavigationFile, ReadError> {
    let text = plain(text);
    let lines = Lines::new(name, &text);
    let mut at = lines.lines.iter().position(|line| !line.is_empty()).unwrap_or(0);
    if !lines.is_header(at) {
        let right = "a RINEX file starts with a line that ends in 'RINEX VERSION / TYPE'";
        return Err(lines.malformed(at, "this is no RINEX file", right));
    }
    let mut reading = Reading::default();
    while at < lines.lines.len() {
        at = reading.take(&lines, at);
    }
    let Reading { mut file, header, utc, first_error } = reading;
    file.data.utc = header.as_ref().and_then(|header| Some(header.with_leap_seconds(utc?)));
    match first_error {
        Some(error) if header.is_none() || file.data.is_empty() && file.skipped == 0 => Err(error),
        _ => Ok(file),
    }
}

/// A file as far as it was read.
#[derive(Default)]
struct Reading {
    file: NavigationFile,
    /// Of the records that follow; none as long as none could be read.
    header: Option<Header>,
    utc: Option<UtcParameters>,
    first_error: Option<ReadError>,
}

impl Reading {
    /// Takes what starts at line `at`, a header, a record or nothing of interest, and gives the line after it.
    fn take(&mut self, lines: &Lines, at: usize) -> usize {
        if lines.is_header(at) {
            // The first, or that of another file after it.
            return match Header::read(lines, at, &mut self.file.left_out) {
                Ok((header, next)) => {
                    self.take_header(header);
                    next
                }
                Err(error) => {
                    self.leave_out("headers left out", error);
                    at + 1
                }
            };
        }
        let Some(version) = self.header.as_ref().map(|header| header.version) else {
            return at + 1;
        };
        if lines.lines[at].is_empty() {
            return at + 1;
        }
        let framed = (version >= 4.0).then(|| lines.frame(at)).transpose();
        let first = at + usize::from(matches!(framed, Ok(Some(_))));
        let end = lines.record_end(first, version);
        if let Err(error) = framed.and_then(|frame| self.content(lines, frame, first..end)) {
            self.leave_out("records left out", error);
        }
        end.max(at + 1)
    }

    fn leave_out(&mut self, what: &'static str, error: ReadError) {
        self.file.left_out.add(what, &error);
        self.first_error.get_or_insert(error);
    }

    /// Takes what the header holds, where it holds it.
    fn take_header(&mut self, header: Header) {
        let sent = header.alpha.zip(header.beta).and_then(|(a, b)| Klobuchar::sent(a, b));
        self.file.data.ionosphere = sent.or(self.file.data.ionosphere);
        self.utc = header.utc.or(self.utc);
        let known = &mut self.file.data.galileo.gps_offset;
        *known = header.galileo.or(*known);
        if self.header.is_none() {
            self.file.version = header.version;
        }
        self.header = Some(header);
    }

    fn content(
        &mut self,
        lines: &Lines,
        frame: Option<lines::Frame>,
        range: std::ops::Range<usize>,
    ) -> Result<(), ReadError> {
        let Some(header) = &self.header else { return Ok(()) };
        let (first, file) = (range.start, &mut self.file);
        match frame.as_ref().map(|f| (f.kind, f.system(), f.message)) {
            None | Some(("EPH", _, "LNAV" | "INAV" | "FNAV" | "D1" | "D2" | "FDMA")) => {
                match header.satellite(lines, first)? {
                    Some(sv) => {
                        file.take(&RecordFields { lines, range, sv, version: header.version })?
                    }
                    None => file.skipped += 1,
                }
            }
            // QZSS sends coefficients of its own region, NavIC and BeiDou those of their own models.
            Some(("ION", 'G', "LNAV")) => {
                file.data.ionosphere = ionosphere(lines, first)?.or(file.data.ionosphere);
            }
            Some(("STO", 'G', "LNAV")) if lines.columns(first, 24, 4) == "GPUT" => {
                self.utc = Some(time_offset(lines, first)?);
            }
            Some(_) => file.skipped += 1,
        }
        Ok(())
    }
}

impl NavigationFile {
    /// Takes the record of a satellite.
    fn take(&mut self, record: &RecordFields) -> Result<(), ReadError> {
        match record.sv.constellation() {
            Constellation::Glonass => self.data.insert_glonass(glonass::ephemeris(record)?),
            Constellation::Galileo if !keplerian::is_inav(record)? => self.skipped += 1,
            constellation => {
                self.data.insert(keplerian::ephemeris(record)?);
                if constellation == Constellation::Galileo {
                    let status = keplerian::galileo_status(record)?;
                    self.data.galileo.status.insert(record.sv, status);
                }
            }
        }
        Ok(())
    }
}

/// A version 4 `ION` record of LNAV: alpha 0-2; alpha 3, beta 0-2; beta 3.
fn ionosphere(lines: &Lines, first: usize) -> Result<Option<Klobuchar>, ReadError> {
    let field = |k: usize| -> Result<f64, ReadError> {
        let at = first + k / 4;
        lines.real(at, 4 + 19 * (k % 4), 19)?.ok_or_else(|| {
            lines.malformed(
                at.min(lines.lines.len() - 1),
                "a Klobuchar coefficient is missing",
                "eight follow the epoch",
            )
        })
    };
    Ok(Klobuchar::sent(
        [field(1)?, field(2)?, field(3)?, field(4)?],
        [field(5)?, field(6)?, field(7)?, field(8)?],
    ))
}

/// A version 4 `STO` record of GPS minus UTC: epoch and `GPUT`; time sent, A0, A1.
fn time_offset(lines: &Lines, first: usize) -> Result<UtcParameters, ReadError> {
    let field = |slot: usize| lines.real(first + 1, 4 + 19 * slot, 19);
    match (field(1)?, field(2)?) {
        (Some(a0), Some(a1)) => Ok(utc_parameters(a0, a1, lines.epoch(first, 4, 4)?)),
        _ => Err(lines.malformed(first, "A0 or A1 is missing", "both follow on the next line")),
    }
}

#[cfg(test)]
mod system_tests;
#[cfg(test)]
mod tests;
