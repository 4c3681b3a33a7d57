//! Options for captures that do not describe themselves.

use super::{BitOrder, CaptureError, Encoding};
use crate::gnss::GpsTime;

/// How the channels of one file lie in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// The samples of all channels at one instant side by side.
    Interleaved,
    /// All samples of the first channel, then all of the second, ...
    Planar,
}

/// Options of [`open`](super::open): `None` takes the value of the capture's metadata, its name or
/// the stated default. Options override metadata, with a warning where they differ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Sample type by name ([`FORMAT_NAMES`](super::FORMAT_NAMES)), or `wav`.
    pub format: Option<String>,
    /// Samples per second of each channel, Hz.
    pub rate_hz: Option<f64>,
    /// Where the L1 carrier lies in the (conjugated, if so asked) samples, Hz; 0 for complex samples.
    pub if_hz: Option<f64>,
    /// Whether the spectrum is mirrored and Q is to be inverted.
    pub conjugate: bool,
    /// Number of channels; 1 for a raw file.
    pub channels: Option<usize>,
    /// How the channels lie in one file; interleaved by default.
    pub layout: Option<Layout>,
    /// Order of packed samples in a byte; most significant first by default.
    pub bit_order: Option<BitOrder>,
    /// Values of 2-bit codes; two's complement by default.
    pub encoding: Option<Encoding>,
    /// Seconds to skip at the start.
    pub start_s: f64,
    /// Seconds to read at most.
    pub duration_s: Option<f64>,
    /// GPS time of the file's first sample (before anything is skipped).
    pub start_time: Option<GpsTime>,
    /// Which stream or lane of ION metadata to read, by its id; those of GPS L1 by default.
    pub stream: Option<String>,
}

impl OpenOptions {
    /// Refuses values that no capture can have.
    pub(super) fn check(&self) -> Result<(), CaptureError> {
        if let Some(rate) = self.rate_hz {
            check_rate(rate)?;
        }
        match self {
            Self { if_hz: Some(f), .. } if f.is_nan() || f.abs() > MAX_RATE_HZ => {
                Err(CaptureError::BadIf(*f))
            }
            Self { channels: Some(n), .. } if !(1..=1024).contains(n) => {
                Err(CaptureError::BadChannels(*n))
            }
            Self { start_s, .. } if !(*start_s >= 0.0 && start_s.is_finite()) => {
                Err(CaptureError::BadStart(*start_s))
            }
            Self { duration_s: Some(d), .. } if d.is_nan() || *d <= 0.0 => {
                Err(CaptureError::BadDuration(*d))
            }
            _ => Ok(()),
        }
    }
}

/// Largest rate of a converter, and largest intermediate frequency, Hz.
const MAX_RATE_HZ: f64 = 1e10;

/// A rate is a number above zero that a converter can have.
pub(super) fn check_rate(rate_hz: f64) -> Result<f64, CaptureError> {
    if rate_hz > 0.0 && rate_hz <= MAX_RATE_HZ {
        Ok(rate_hz)
    } else {
        Err(CaptureError::BadRate(rate_hz))
    }
}
