//! Reader of RINEX observation files: versions 2.10 to 2.12, 3.0x and 4.0x, GPS and QZSS L1 C/A.
//!
//! Sources: RINEX 2.11 tables A1 and A2, 3.04 tables A2 and A3. Of version 2 the code is C1, and P1 where
//! C1 is missing; of versions 3 and 4 it is C1C; beside it L1, D1 and S1 (L1C, D1C, S1C). Satellites of
//! other systems, and those without code and Doppler, are skipped and counted. A Doppler is positive when
//! the satellite approaches. Standard deviations are those of [`typical_noise`] at the file's C/N0, which is
//! S1, or else the middle of the class that the signal strength digit names, or else unknown (NaN).
//!
//! [`ObservationReader::next_pseudoranges`] gives the pseudoranges of other signals too, by their names.
//!
//! Deviations of real files are accepted: labels in any case, D exponents, CRLF, comments between any lines,
//! missing trailing fields, event records and cycle-slip records. Errors name file, line and what is valid.

mod header;
mod records;
#[cfg(test)]
mod tests;
mod write;

pub use header::ObservationHeader;
pub use write::{file_name, write};

use crate::format::records::{Line, ascii, compressed, is_compressed};
#[cfg(doc)]
use crate::observation::typical_noise;
use crate::observation::{Observation, ObservationEpoch};
use crate::{GpsTime, ReadError, Sv};
use header::Signals;
use records::{Epoch, Field};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Longest line, bytes: 5000 fields.
const LONGEST_LINE: u64 = 80_000;

/// Epochs of a RINEX observation file, one after the other: memory does not grow with the file.
pub struct ObservationReader<R> {
    source: Source<R>,
    header: ObservationHeader,
    signals: Signals,
    /// Start of the file, for the epochs' `sample`.
    first: Option<GpsTime>,
    skipped: usize,
    ended: bool,
}

/// The pseudoranges of chosen signals of all satellites at one receive instant.
#[derive(Clone, Debug, PartialEq)]
pub struct PseudorangeEpoch {
    /// Receive instant by the receiver's clock.
    pub receive_time: GpsTime,
    /// Each satellite with its pseudoranges, m, in the order of the signals requested; none where it is missing.
    pub satellites: Vec<(Sv, Vec<Option<f64>>)>,
}

/// Opens a RINEX observation file and reads its header.
///
/// # Errors
/// When the file cannot be read, is compressed, is no observation file or has a malformed header.
pub fn open(path: impl AsRef<Path>) -> Result<ObservationReader<BufReader<File>>, ReadError> {
    let path = path.as_ref();
    let file = File::open(path).map_err(|source| ReadError::Io {
        format: "RINEX",
        path: path.to_owned(),
        source,
    })?;
    ObservationReader::new(BufReader::with_capacity(1 << 16, file), &path.display().to_string())
}

impl<R: BufRead> ObservationReader<R> {
    /// Reads the header of an observation file; `name` stands in error messages.
    ///
    /// # Errors
    /// As [`open`].
    pub fn new(input: R, name: &str) -> Result<Self, ReadError> {
        let mut source =
            Source { input, name: name.to_owned(), text: String::new(), number: 0, bytes: 0 };
        let (header, signals) = header::read(&mut source)?;
        Ok(Self { source, header, signals, first: None, skipped: 0, ended: false })
    }

    /// The header.
    pub fn header(&self) -> &ObservationHeader {
        &self.header
    }

    /// The pseudoranges of these signals at the next epoch, none at the end of the file. Signals are named as
    /// the file's version does: `C1C`, `C2W`, `C5Q`, of version 2 `C1`, `P2`, `C5`. Satellites that have none
    /// of them are skipped.
    ///
    /// # Errors
    /// When the record is malformed, with file, line and what is valid; the file ends there.
    pub fn next_pseudoranges(
        &mut self,
        signals: &[&str],
    ) -> Result<Option<PseudorangeEpoch>, ReadError> {
        let epoch = self.next_epoch(|sv, fields, field| {
            let range = |name: &&str| {
                let value = fields.index_of(sv, name).map(|k| field(k).value());
                Ok(value.transpose()?.flatten().filter(|range| *range > 0.0))
            };
            let ranges: Vec<Option<f64>> = signals.iter().map(range).collect::<Result<_, _>>()?;
            Ok(ranges.iter().any(Option::is_some).then_some((sv, ranges)))
        })?;
        Ok(epoch.map(|Epoch { receive_time, mut satellites, .. }| {
            satellites.sort_by_key(|satellite| satellite.0);
            PseudorangeEpoch { receive_time, satellites }
        }))
    }

    /// The next epoch, none at the end of the file and after an error.
    fn next_epoch<T>(
        &mut self,
        take: impl for<'a> Fn(Sv, &Signals, &dyn Fn(usize) -> Field<'a>) -> Result<Option<T>, ReadError>,
    ) -> Result<Option<Epoch<T>>, ReadError> {
        if self.ended {
            return Ok(None);
        }
        let epoch = records::next_epoch(self, take);
        self.ended = !matches!(epoch, Ok(Some(_)));
        epoch
    }

    /// Satellites of epochs so far that were skipped: of other systems, or without code and Doppler.
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    /// Bytes read so far.
    pub fn bytes(&self) -> u64 {
        self.source.bytes
    }
}

/// Epochs in the order of the file; `sample` counts seconds from the first. After an error there are no more.
impl<R: BufRead> Iterator for ObservationReader<R> {
    type Item = Result<ObservationEpoch, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        let epoch = self.next_epoch(records::observation).transpose()?;
        Some(epoch.map(|Epoch { receive_time, power_failed, satellites }| {
            let mut observations: Vec<Observation> = satellites;
            observations.iter_mut().for_each(|o| o.lost_lock |= power_failed);
            observations.sort_by_key(|o| o.transmission);
            let sample = receive_time - *self.first.get_or_insert(receive_time);
            ObservationEpoch { receive_time, sample, observations }
        }))
    }
}

/// Lines of a file without its comments.
struct Source<R> {
    input: R,
    name: String,
    text: String,
    number: usize,
    bytes: u64,
}

impl<R: BufRead> Source<R> {
    /// Goes to the next line; false at the end of the file.
    fn step(&mut self) -> Result<bool, ReadError> {
        let mut bytes = Vec::new();
        let read = (&mut self.input).take(LONGEST_LINE).read_until(b'\n', &mut bytes);
        let read = read.map_err(|source| ReadError::Io {
            format: "RINEX",
            path: self.name.as_str().into(),
            source,
        })?;
        self.bytes += read as u64;
        self.number += 1;
        if self.number == 1 && is_compressed(&bytes) {
            return Err(compressed("RINEX", &self.name));
        }
        self.text = ascii(String::from_utf8_lossy(&bytes).trim_end());
        if read as u64 == LONGEST_LINE {
            let problem = format!("the line is longer than {LONGEST_LINE} bytes");
            return Err(self.line().malformed(problem, "RINEX files are text"));
        }
        Ok(read > 0)
    }

    /// Goes to the next line that is no comment; false at the end of the file.
    fn advance(&mut self) -> Result<bool, ReadError> {
        loop {
            let there = self.step()?;
            if !there || !self.line().columns(60, 20).eq_ignore_ascii_case("COMMENT") {
                return Ok(there);
            }
        }
    }

    /// Goes to the next line, which must be there: `what` names it in errors.
    fn expect(&mut self, what: &str) -> Result<(), ReadError> {
        if self.advance()? {
            return Ok(());
        }
        let right = format!("{what} follow");
        Err(self.line().malformed("the file ends in the middle of a record", right))
    }

    fn line(&self) -> Line<'_> {
        Line { format: "RINEX", file: &self.name, number: self.number, text: &self.text }
    }
}
