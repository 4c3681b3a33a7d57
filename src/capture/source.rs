//! The trait of sources of samples.

use super::{Block, Note};
use crate::gnss::GpsTime;
use crate::gnss::antenna::ArrayDescription;

/// Properties of a stream of samples, known before the first is read.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamInfo {
    /// Samples per second of each channel, Hz (complex samples; for real captures the real rate).
    pub rate_hz: f64,
    /// Where the GPS L1 carrier lies in the samples, Hz: the intermediate frequency, 0 for baseband.
    pub if_hz: f64,
    /// Number of channels (antenna elements).
    pub channels: usize,
    /// Whether the imaginary parts are all zero because the front end gives real samples.
    pub real: bool,
    /// Samples of each channel, where the end is known.
    pub samples: Option<u64>,
    /// GPS time of the first sample, where the recording states it.
    pub start_time: Option<GpsTime>,
    /// Sample type, such as `cs8`.
    pub format: String,
    /// The antenna array whose elements the channels are, where the recording states it.
    pub array: Option<ArrayDescription>,
}

/// A source of samples: a file, a pipe, a scenario, a radio.
pub trait SampleSource: Send {
    /// Properties of the stream.
    fn info(&self) -> &StreamInfo;

    /// Reads up to `samples` samples of each channel into `block` (resized to what was read) and returns
    /// their number; 0 means the end. Fewer than requested are read only at the end.
    fn read(&mut self, block: &mut Block, samples: usize) -> Result<usize, SourceError>;

    /// Notes on the samples read so far: a truncated end, NaN replaced by zero, ...
    fn notes(&self) -> Vec<Note> {
        Vec::new()
    }
}

/// Why a source can give no more samples.
pub type SourceError = Box<dyn std::error::Error + Send + Sync>;
