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
//! missing trailing fields, event records and cycle-slip records, files one after the other. A malformed record loses
//! itself only: it is counted, and named by file, line and what is valid.

mod header;
mod records;
#[cfg(test)]
mod tests;
mod write;

pub use header::ObservationHeader;
pub use write::{file_name, is_file_name, write};

use crate::format::records::{LeftOut, Line, compressed, is_compressed, plain};
#[cfg(doc)]
use crate::observation::typical_noise;
use crate::observation::{Observation, ObservationEpoch};
use crate::{GpsTime, ReadError, Sv};
use header::Signals;
use records::{Epoch, Field};
use std::fs::File;
use std::io::{BufRead, BufReader};
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
    left_out: LeftOut,
    /// The first malformed record, as long as no epoch was read.
    first_error: Option<ReadError>,
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
        let mut source = Source {
            input,
            name: name.to_owned(),
            text: String::new(),
            number: 0,
            bytes: 0,
            is_cut: false,
            again: false,
        };
        let mut left_out = LeftOut::default();
        let (header, signals) = header::read(&mut source, &mut left_out)?;
        let (first, first_error) = (None, None);
        Ok(Self { source, header, signals, first, skipped: 0, left_out, first_error, ended: false })
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
                Ok(value.transpose()?.flatten())
            };
            let ranges: Vec<Option<f64>> = signals.iter().map(range).collect::<Result<_, _>>()?;
            Ok(ranges.iter().any(Option::is_some).then_some((sv, ranges)))
        })?;
        Ok(epoch.map(|Epoch { receive_time, mut satellites, .. }| {
            satellites.sort_by_key(|satellite| satellite.0);
            PseudorangeEpoch { receive_time, satellites }
        }))
    }

    /// The next epoch, none at the end of the file. Malformed records are left out; where there is nothing else, the first
    /// of them is the error.
    fn next_epoch<T>(
        &mut self,
        take: impl for<'a> Fn(Sv, &Signals, &dyn Fn(usize) -> Field<'a>) -> Result<Option<T>, ReadError>,
    ) -> Result<Option<Epoch<T>>, ReadError> {
        if self.ended {
            return Ok(None);
        }
        let epoch = records::next_epoch(self, take);
        self.ended = !matches!(epoch, Ok(Some(_)));
        match (&epoch, self.first_error.take()) {
            (Ok(None), Some(error)) if self.first.is_none() => Err(error),
            (Ok(None) | Err(_), _) => epoch,
            (Ok(Some(found)), _) => {
                self.first.get_or_insert(found.receive_time);
                epoch
            }
        }
    }

    /// Leaves a malformed record out.
    fn leave_out(&mut self, what: &'static str, error: ReadError) {
        self.left_out.add(what, &error);
        self.first_error.get_or_insert(error);
    }

    /// Records so far that were left out, since they do not follow the format.
    pub fn left_out(&self) -> &LeftOut {
        &self.left_out
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

/// Epochs in the order of the file, which may be several files one after the other; `sample` counts seconds from the
/// first.
impl<R: BufRead> Iterator for ObservationReader<R> {
    type Item = Result<ObservationEpoch, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        let epoch = self.next_epoch(records::observation).transpose()?;
        Some(epoch.map(|Epoch { receive_time, power_failed, satellites }| {
            let mut observations: Vec<Observation> = satellites;
            observations.iter_mut().for_each(|o| o.lost_lock |= power_failed);
            observations.sort_by_key(|o| o.transmission);
            let sample = receive_time - self.first.unwrap_or(receive_time);
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
    /// Whether the file ends within the line.
    is_cut: bool,
    /// Whether the next step stays at this line.
    again: bool,
}

impl<R: BufRead> Source<R> {
    /// The bytes up to the next line feed or carriage return, or both, and whether one came.
    fn read_line(&mut self) -> std::io::Result<(Vec<u8>, bool)> {
        let mut line = Vec::new();
        let ends = |b: &u8| matches!(b, b'\n' | b'\r');
        loop {
            let buffer = self.input.fill_buf()?;
            let end = buffer.iter().position(ends);
            let (used, ended) = (end.map_or(buffer.len(), |k| k + 1), end.is_some());
            let is_return = end.is_some_and(|k| buffer[k] == b'\r');
            line.extend_from_slice(&buffer[..end.unwrap_or(used)]);
            self.input.consume(used);
            self.bytes += used as u64;
            if is_return && self.input.fill_buf()?.first() == Some(&b'\n') {
                self.input.consume(1);
                self.bytes += 1;
            }
            if ended || used == 0 || line.len() as u64 >= LONGEST_LINE {
                return Ok((line, ended));
            }
        }
    }

    /// Goes to the next line; false at the end of the file.
    fn step(&mut self) -> Result<bool, ReadError> {
        if std::mem::take(&mut self.again) {
            return Ok(true);
        }
        let read = self.read_line();
        let (bytes, ended) = read.map_err(|source| ReadError::Io {
            format: "RINEX",
            path: self.name.as_str().into(),
            source,
        })?;
        self.is_cut = !ended;
        self.number += 1;
        if self.number == 1 && is_compressed(&bytes) {
            return Err(compressed("RINEX", &self.name));
        }
        self.text = plain(String::from_utf8_lossy(&bytes).trim_end()).trim_end().to_owned();
        if bytes.len() as u64 >= LONGEST_LINE {
            let problem = format!("the line is longer than {LONGEST_LINE} bytes");
            return Err(self.line().malformed(problem, "RINEX files are text"));
        }
        Ok(ended || !bytes.is_empty())
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

    /// Whether a header starts at this line.
    fn is_header(&self) -> bool {
        self.line().columns(60, 20).eq_ignore_ascii_case("RINEX VERSION / TYPE")
    }

    fn line(&self) -> Line<'_> {
        Line { format: "RINEX", file: &self.name, number: self.number, text: &self.text }
    }
}
