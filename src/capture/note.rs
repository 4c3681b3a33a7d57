//! Notes on a capture that could be read in spite of doubts.

use std::fmt;
use std::path::PathBuf;

/// Something doubtful about a capture, and how it was treated.
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// A requested number differs from the metadata.
    Overridden {
        /// Which number.
        what: &'static str,
        /// The requested number, which is used, Hz.
        asked_hz: f64,
        /// The metadata's number, Hz.
        stated_hz: f64,
    },
    /// The requested sample type differs from that of the metadata or the name.
    FormatOverridden {
        /// The requested type, which is used.
        asked: String,
        /// The type of the metadata or the name.
        stated: String,
    },
    /// The carrier lies beyond half the sampling rate, and is taken as aliased.
    Aliased {
        /// Intermediate frequency, Hz.
        if_hz: f64,
        /// Sampling rate, Hz.
        rate_hz: f64,
    },
    /// Bytes at the end make no whole sample.
    Trailing {
        /// The file.
        path: PathBuf,
        /// How many.
        bytes: u64,
        /// Sample type.
        format: String,
        /// Channels in the file.
        channels: usize,
    },
    /// Files of one capture differ in length; the shortest counts.
    LengthsDiffer {
        /// Samples of the shortest.
        shortest: u64,
        /// Samples of the longest.
        longest: u64,
    },
    /// The capture is shorter than requested.
    Shorter {
        /// Requested length, s.
        asked_s: f64,
        /// Length of the capture, s.
        given_s: f64,
    },
    /// Numbers were NaN or infinite and were taken as 0.
    NotFinite {
        /// The file.
        path: PathBuf,
        /// How many.
        numbers: u64,
        /// Sample type.
        format: String,
    },
    /// There was no sample to read.
    NoSample,
    /// The input ended before its end.
    CutOff {
        /// Samples read.
        read: u64,
        /// Samples that were expected.
        samples: u64,
    },
    /// A SigMF recording has more than one segment; the first counts for all.
    Segments {
        /// The metadata.
        path: PathBuf,
        /// How many.
        segments: usize,
    },
    /// SigMF metadata state no frequency; the L1 carrier is taken to lie at 0 Hz.
    NoFrequency(PathBuf),
    /// The time of the first sample is none, and is taken as unknown.
    NoTime {
        /// The metadata.
        path: PathBuf,
        /// What stands there.
        text: String,
    },
    /// Not all streams of ION metadata are read.
    Streams {
        /// Those that are read.
        read: String,
        /// All.
        offered: String,
    },
    /// ION metadata state two times of the first sample.
    TwoTimes {
        /// The metadata.
        path: PathBuf,
        /// The session's, which is taken.
        taken: String,
        /// The file's.
        other: String,
    },
    /// A WAV file is shorter than its header states.
    WavCutOff {
        /// The file.
        path: PathBuf,
        /// Bytes of samples by the header.
        stated: u64,
        /// Bytes of samples in the file.
        present: u64,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Overridden { what, asked_hz, stated_hz } => write!(
                f,
                "the {what} {asked_hz} Hz that was asked for overrides {stated_hz} Hz of the metadata"
            ),
            Self::FormatOverridden { asked, stated } => write!(
                f,
                "the sample type {asked} that was asked for overrides {stated} of the metadata or the name"
            ),
            Self::Aliased { if_hz, rate_hz } => write!(
                f,
                "the intermediate frequency {if_hz} Hz lies beyond half the rate {rate_hz} Hz: the \
                 carrier is taken as aliased by sampling"
            ),
            Self::Trailing { path, bytes, format, channels } => write!(
                f,
                "'{}': the last {bytes} bytes make no whole sample of type {format} and {channels} \
                 channel(s): the file was cut off or is of another type",
                path.display()
            ),
            Self::LengthsDiffer { shortest, longest } => write!(
                f,
                "the files differ in length ({shortest} to {longest} samples): only the first \
                 {shortest} of each are used"
            ),
            Self::Shorter { asked_s, given_s } => {
                write!(f, "{asked_s} s were asked for, the capture gives {given_s} s")
            }
            Self::NotFinite { path, numbers, format } => write!(
                f,
                "'{}': {numbers} numbers were NaN or infinite and were taken as 0; check the sample \
                 type ({format}) and its byte order",
                path.display()
            ),
            Self::NoSample => write!(
                f,
                "the input ended before the first sample: it is empty or ends before the start asked for"
            ),
            Self::CutOff { read, samples } => {
                write!(f, "the input ended after {read} of {samples} samples: it was cut off")
            }
            Self::Segments { path, segments } => write!(
                f,
                "'{}' has {segments} segments: frequency and time of the first are taken for all, and \
                 gaps between them are not known",
                path.display()
            ),
            Self::NoFrequency(path) => write!(
                f,
                "'{}' states no core:frequency: the L1 carrier is taken to lie at 0 Hz",
                path.display()
            ),
            Self::NoTime { path, text } => write!(
                f,
                "'{}': core:datetime '{text}' is no time such as 2021-12-02T08:47:00Z: it is taken as unknown",
                path.display()
            ),
            Self::Streams { read, offered } => {
                write!(f, "reading {read} of the streams {offered}")
            }
            Self::TwoTimes { path, taken, other } => write!(
                f,
                "'{}' states two times of the first sample, {taken} (session, taken) and {other} (file)",
                path.display()
            ),
            Self::WavCutOff { path, stated, present } => write!(
                f,
                "'{}' states {stated} bytes of samples and holds {present}: it was cut off",
                path.display()
            ),
        }
    }
}
