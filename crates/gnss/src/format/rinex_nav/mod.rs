//! Reader of RINEX navigation files: versions 2.10 to 2.12, 3.0x and 4.0x, LNAV of GPS and QZSS, I/NAV of Galileo.
//!
//! Sources: RINEX 2.11 table A3-A4, 3.05 tables A5-A6, A8 and A13, 4.01 sections 5.2 to 5.4. Records of
//! other systems and message types are skipped and counted. Deviations of
//! real files are accepted (D exponents, labels in any case, CRLF, blank optional fields, a missing last line);
//! errors name file, line and what is valid.

mod header;
mod lines;
pub(super) mod write;

pub use write::write;

use crate::atmosphere::Klobuchar;
use crate::format::records::{LeftOut, ReadError, plain, read_text};
use crate::navigation_data::UtcParameters;
use crate::orbit::broadcast::{NO_ACCURACY, ura_index};
use crate::time::SECONDS_PER_WEEK;
use crate::{Constellation, Ephemeris, NavigationData, Sv};
use header::{Header, utc_parameters};
use lines::Lines;
use std::path::Path;

/// Weeks after which the 10 bits of a week number start anew.
const WEEKS_PER_CYCLE: i64 = 1 << 10;

/// Lines of an LNAV record.
const LINES: usize = 8;
/// Data validity and health status of E1-B in the health word of Galileo.
const E1_HEALTH: u16 = 0b111;
/// The largest user range accuracy that is sent, m.
const WORST_URA_M: f64 = 8192.0;

/// Contents of a navigation file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NavigationFile {
    /// The format's version, such as 3.04.
    pub version: f64,
    /// Ephemerides of GPS, QZSS and Galileo, ionosphere and UTC.
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
            None | Some(("EPH", _, "LNAV" | "INAV")) => match header.satellite(lines, first)? {
                // The clock of F/NAV is that of E1 and E5a.
                Some(sv) if is_of_fnav(lines, first, sv)? => file.skipped += 1,
                Some(sv) => file.data.insert(ephemeris(lines, range, sv, header)?),
                None => file.skipped += 1,
            },
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

/// Bits of the data source of a Galileo record: I/NAV of E1-B, and of E5b, which is the same.
const INAV_SOURCES: u32 = 0b101;

/// Whether the record of a satellite is that of F/NAV (RINEX 3.05 table A8, broadcast orbit 5, field 2).
fn is_of_fnav(lines: &Lines, first: usize, sv: Sv) -> Result<bool, ReadError> {
    if sv.constellation() != Constellation::Galileo || first + 5 >= lines.lines.len() {
        return Ok(false);
    }
    let source = lines.real(first + 5, 4 + 19, 19)?;
    Ok(source.is_some_and(|source| source as u32 & INAV_SOURCES == 0))
}

/// An LNAV or I/NAV record (RINEX 2.11 table A4, 3.05 tables A6 and A8): up to eight lines of four fields. Galileo has
/// IODnav in place of IODE and IODC, BGD(E1, E5b) in that of IODC, and the health of all of its signals in one word.
fn ephemeris(
    lines: &Lines,
    range: std::ops::Range<usize>,
    sv: Sv,
    header: &Header,
) -> Result<Ephemeris, ReadError> {
    let first = range.start;
    let count = range.clone().filter(|at| !lines.lines[*at].is_empty()).count();
    if count > LINES {
        let problem = format!("the record of {sv} has {count} lines");
        return Err(lines.malformed(first, problem, format!("it has {LINES}")));
    }
    let (toc, column) = if header.version < 3.0 {
        (lines.epoch(first, 3, 2)?, 3)
    } else {
        (lines.epoch(first, 4, 4)?, 4)
    };
    let field = |k: usize| -> Result<Option<f64>, ReadError> {
        let (row, slot) = (k / 4, k % 4);
        if first + row >= range.end {
            Ok(None)
        } else {
            lines.real(first + row, column + 19 * slot, 19)
        }
    };
    let within = |k: usize, name: &str, min: f64, max: f64| -> Result<f64, ReadError> {
        let at = (first + k / 4).min(range.end - 1);
        let value = field(k)?;
        value.filter(|v| (min..=max).contains(v)).ok_or_else(|| {
            let problem = match value {
                Some(v) => format!("{name} of {sv} is {v:e}"),
                None if first + k / 4 >= range.end => {
                    format!("the record of {sv} ends after {} lines, before {name}", range.len())
                }
                None => format!("{name} of {sv} is blank"),
            };
            lines.malformed(at, problem, format!("it lies in {min:e} to {max:e}"))
        })
    };
    let any = |k: usize, name: &str| within(k, name, -1e9, 1e9);
    let toe = toc.nearest_with_tow(within(12, "toe", 0.0, SECONDS_PER_WEEK as f64)?);
    if let Some(week) = field(22)? {
        // The week goes with toe, or with the transmission at most a fit interval away.
        let off = (week as i64 - i64::from(toe.week())).rem_euclid(WEEKS_PER_CYCLE);
        if (off + 1) % WEEKS_PER_CYCLE > 2 {
            let problem =
                format!("week {week} of {sv} does not go with its epoch, in week {}", toc.week());
            return Err(lines.malformed(first + 5, problem, "both are of the same week"));
        }
    }
    // The last line may be missing; where another is, this is the time of transmission.
    if let Some(ura) = field(24)?.filter(|ura| count < LINES && *ura > WORST_URA_M) {
        let problem = format!("the record of {sv} has {count} lines, and its URA is {ura} m");
        return Err(lines.malformed(first, problem, format!("it has {LINES}")));
    }
    let is_galileo = sv.constellation() == Constellation::Galileo;
    let last_issue = f64::from((1u16 << 10) - 1);
    let issue = within(4, "IODE", 0.0, if is_galileo { last_issue } else { 255.0 })? as u16;
    let (iodc, tgd, health) = match is_galileo {
        true => (issue, any(27, "BGD")?, within(25, "health", 0.0, 511.0)? as u16 & E1_HEALTH),
        false => {
            let iodc = within(27, "IODC", 0.0, last_issue)? as u16;
            (iodc, any(26, "TGD")?, within(25, "health", 0.0, 63.0)? as u16)
        }
    };
    let fit = field(29)?.filter(|_| !is_galileo).unwrap_or(0.0);
    let sent = field(28)?.filter(|tow| tow.abs() <= 2.0 * SECONDS_PER_WEEK as f64);
    Ok(Ephemeris {
        sv,
        iodc,
        iode: issue as u8,
        // Where none is stated, what is usual; Galileo states by -1 that there is none.
        ura_index: field(24)?.map_or(0, |m| if m < 0.0 { NO_ACCURACY } else { ura_index(m) }),
        health: health as u8,
        l2_codes: field(21)?.filter(|_| !is_galileo).map_or(0, |v| v.clamp(0.0, 3.0) as u8),
        l2_p_data: field(23)?.is_some_and(|v| v != 0.0 && !is_galileo),
        // Hours, or from older writers and of QZSS the flag itself.
        fit_interval_flag: fit == 1.0 || fit > 4.0,
        toc,
        toe,
        transmission_time: sent.map(|tow| toe.nearest_with_tow(tow)),
        af0: any(1, "af0")?,
        af1: any(2, "af1")?,
        af2: any(3, "af2")?,
        tgd,
        sqrt_a: within(11, "sqrt(A)", 2000.0, 8192.0)?,
        e: within(9, "e", 0.0, 0.5)?,
        m0: any(7, "M0")?,
        delta_n: any(6, "Delta n")?,
        omega0: any(14, "OMEGA0")?,
        omega_dot: any(19, "OMEGA DOT")?,
        i0: any(16, "i0")?,
        idot: any(20, "IDOT")?,
        omega: any(18, "omega")?,
        cuc: any(8, "Cuc")?,
        cus: any(10, "Cus")?,
        crc: any(17, "Crc")?,
        crs: any(5, "Crs")?,
        cic: any(13, "Cic")?,
        cis: any(15, "Cis")?,
    })
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
mod tests;
