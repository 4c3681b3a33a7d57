//! Reader of RINEX observation files: versions 2.10 to 2.12, 3.0x and 4.0x; the signals of GPS, QZSS, Galileo, BeiDou
//! and GLONASS on L1, E1 and B1.
//!
//! Sources: RINEX 2.11 tables A1 and A2, 3.04 tables 4 to 9, A2 and A3. Of version 2 the code of GPS is C1, and P1 where
//! C1 is missing, that of GLONASS and Galileo C1; of versions 3 and 4 they are those of the module `signals`; beside it L1, D1 and
//! S1 (L1C, D1C, S1C). Satellites of other systems, and those without code and Doppler, are skipped and counted. A Doppler is positive when
//! the satellite approaches. Standard deviations are those of [`typical_noise`] at the file's C/N0, which is
//! S1, or else the middle of the class that the signal strength digit names, or else unknown (NaN).
//!
//! [`ObservationReader::next_pseudoranges`] gives the pseudoranges of other signals too, by their names.
//!
//! Deviations of real files are accepted: labels in any case, D exponents, CRLF, comments between any lines,
//! missing trailing fields, event records and cycle-slip records, files one after the other. A malformed record loses
//! itself only: it is counted, and named by file, line and what is valid. Compact (Hatanaka) files, and files that gzip or
//! compress packed, are read as what they are made of.
//!
//! Stored values are divided by `SYS / SCALE FACTOR`. `SYS / PHASE SHIFT` says what the writer has added already, and is 0
//! for L1 C/A, to which phases of other signals are aligned.

mod compact;
mod header;
mod records;
mod signals;
mod source;
#[cfg(test)]
mod tests;
mod write;

pub use header::ObservationHeader;
pub use write::{file_name, is_file_name, write};

use crate::format::records::LeftOut;
use crate::format::unpack::{Counted, MOST_UNPACKED_BYTES, Unpacked, unpack};
#[cfg(doc)]
use crate::observation::typical_noise;
use crate::observation::{Observation, ObservationEpoch};
use crate::{GpsTime, ReadError, Sv};
use header::Signals;
use records::{Epoch, Field};
use source::Source;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Longest line, bytes: 5000 fields.
const LONGEST_LINE: usize = 80_000;

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
    /// Bytes of the file read so far, packed or not; none of other inputs.
    bytes_of_file: Option<Arc<AtomicU64>>,
}

/// The pseudoranges of chosen signals of all satellites at one receive instant.
#[derive(Clone, Debug, PartialEq)]
pub struct PseudorangeEpoch {
    /// Receive instant by the receiver's clock.
    pub receive_time: GpsTime,
    /// Each satellite with its pseudoranges, m, in the order of the signals requested; none where it is missing.
    pub satellites: Vec<(Sv, Vec<Option<f64>>)>,
}

/// Opens a RINEX observation file, packed by gzip or compress or not, and reads its header.
///
/// # Errors
/// As [`ObservationReader::new`], and when the file cannot be opened or unpacked.
pub fn open(path: impl AsRef<Path>) -> Result<ObservationReader<Unpacked<'static>>, ReadError> {
    let path = path.as_ref();
    let io = |source| ReadError::Io { format: "RINEX", path: path.to_owned(), source };
    let count = Arc::new(AtomicU64::new(0));
    let file = Counted { input: File::open(path).map_err(io)?, count: Arc::clone(&count) };
    let file = BufReader::with_capacity(1 << 16, file);
    let unpacked = unpack(file, MOST_UNPACKED_BYTES).map_err(io)?;
    let reader = ObservationReader::new(unpacked, &path.display().to_string())?;
    Ok(ObservationReader { bytes_of_file: Some(count), ..reader })
}

impl<R: BufRead> ObservationReader<R> {
    /// Reads the header of an observation file, compact or not; `name` stands in error messages.
    ///
    /// # Errors
    /// When the input cannot be read, is no observation file, or its header lacks what everything needs.
    pub fn new(input: R, name: &str) -> Result<Self, ReadError> {
        let mut source = Source::new(input, name);
        let mut left_out = LeftOut::default();
        // Where the file cannot be unpacked, that is why its header does not end.
        let (header, signals) = header::read(&mut source, &mut left_out)
            .map_err(|error| source.losses.drain(..).next().map_or(error, |loss| loss.1))?;
        let (first, first_error) = (None, None);
        Ok(Self {
            source,
            header,
            signals,
            first,
            skipped: 0,
            left_out,
            first_error,
            ended: false,
            bytes_of_file: None,
        })
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
    /// When the input cannot be read; or no epoch is usable, for the first reason.
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
        for (what, error) in std::mem::take(&mut self.source.losses) {
            self.leave_out(what, error);
        }
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

    /// Bytes of the file read so far, packed where it is.
    pub fn bytes(&self) -> u64 {
        self.bytes_of_file.as_ref().map_or(self.source.bytes, |count| count.load(Ordering::Relaxed))
    }
}

/// Epochs in the order of the file, which may be several files one after the other; `sample` counts seconds from the
/// first.
impl<R: BufRead> Iterator for ObservationReader<R> {
    type Item = Result<ObservationEpoch, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        let epoch = self.next_epoch(records::observations).transpose()?;
        Some(epoch.map(|Epoch { receive_time, power_failed, satellites }| {
            let mut observations: Vec<Observation> = satellites.into_iter().flatten().collect();
            observations.iter_mut().for_each(|o| o.lost_lock |= power_failed);
            observations.sort_by_key(|o| o.transmission);
            let sample = receive_time - self.first.unwrap_or(receive_time);
            ObservationEpoch { receive_time, sample, observations }
        }))
    }
}
