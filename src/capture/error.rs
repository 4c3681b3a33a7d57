//! Why a capture cannot be read or written.

use super::sample_format::FORMAT_NAMES;
use std::io;
use std::path::{Path, PathBuf};

/// Why a capture cannot be read or written: the fault, its position, and what is valid.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum CaptureError {
    #[error("no capture was given: name a file, or '-' for standard input")]
    NoInput,
    #[error("cannot open capture '{}': {cause}", path.display())]
    Open { path: PathBuf, cause: io::Error },
    #[error("cannot read '{}' at byte {byte}: {cause}", path.display())]
    Read { path: PathBuf, byte: u64, cause: io::Error },
    #[error("'{}' is a directory: name the capture file in it", .0.display())]
    Directory(PathBuf),
    #[error(
        "'{}' holds {bytes} bytes, less than one sample of type {format}: it is empty, cut off or \
         of another type", path.display()
    )]
    Empty { path: PathBuf, bytes: u64, format: String },
    #[error("sample type '{0}' is unknown: it must be one of {FORMAT_NAMES}, wav")]
    UnknownFormat(String),
    #[error(
        "the sample type of '{}' is not known from its name: one of {FORMAT_NAMES} must be given",
        .0.display()
    )]
    FormatNeeded(PathBuf),
    #[error("the sample rate of '{}' is not known and must be given", .0.display())]
    RateNeeded(PathBuf),
    #[error(
        "sample rate {0:e} Hz is impossible: it must be above 0 and at most 10 GHz, such as 4M"
    )]
    BadRate(f64),
    #[error(
        "intermediate frequency {0:e} Hz is impossible: it must be a number up to 10 GHz, such as 4.092M"
    )]
    BadIf(f64),
    #[error(
        "'{}' holds real samples ({format}), whose carrier lies at an intermediate frequency that \
         is not known and must be given", path.display()
    )]
    IfNeeded { path: PathBuf, format: String },
    #[error("{0} channels are impossible: there may be 1 to 1024")]
    BadChannels(usize),
    #[error(
        "{asked} channels were asked for, which contradicts the {found} channels that {what} gives"
    )]
    ChannelMismatch { asked: usize, found: usize, what: String },
    #[error(
        "'{}' and '{}' differ in {what} ({first_value} and {second_value}): files of one capture \
         must agree", first.display(), second.display()
    )]
    FilesDiffer {
        first: PathBuf,
        second: PathBuf,
        what: &'static str,
        first_value: String,
        second_value: String,
    },
    #[error("standard input ('-') cannot be joined with other files: give it alone")]
    StdinWithOthers,
    #[error(
        "planar channels cannot be read from '{}', which is no regular file: save it to a file \
         first, or send interleaved channels", .0.display()
    )]
    PlanarStream(PathBuf),
    #[error(
        "'{}' holds {bytes} bytes, which are not {channels} planes of whole {format} samples", path.display()
    )]
    PlanarLength { path: PathBuf, bytes: u64, channels: usize, format: String },
    #[error("a start at {0} s is impossible: it must be 0 or more")]
    BadStart(f64),
    #[error("a duration of {0} s is impossible: it must be more than 0")]
    BadDuration(f64),
    #[error(
        "a start at {start_s} s lies beyond the end of '{}', which is {length_s} s long", path.display()
    )]
    StartBeyondEnd { path: PathBuf, start_s: f64, length_s: f64 },
    #[error(
        "the data file '{}' that '{}' describes is missing: put it beside its metadata, or name \
         it after the metadata file", data.display(), metadata.display()
    )]
    MissingData { metadata: PathBuf, data: PathBuf },
    #[error(
        "the metadata file '{}' of '{}' is missing: put it there, or give sample type and rate",
        metadata.display(), data.display()
    )]
    MissingMetadata { metadata: PathBuf, data: PathBuf },
    #[error("'{}' line {line}, column {column}: {reason}", path.display())]
    Metadata { path: PathBuf, line: usize, column: usize, reason: String },
    #[error("'{}': {field}: {reason}", path.display())]
    MetadataValue { path: PathBuf, field: String, reason: String },
    #[error("'{}': {field} {reason}: one stream must be chosen", path.display())]
    StreamsDiffer { path: PathBuf, field: String, reason: String },
    #[error("'{}' is no WAV file that can be read: {reason}", path.display())]
    Wav { path: PathBuf, reason: String },
    #[error("cannot write '{}': {cause}", path.display())]
    Write { path: PathBuf, cause: io::Error },
    #[error("'{}': {reason}", path.display())]
    Unwritable { path: PathBuf, reason: String },
}

/// A field of metadata whose value cannot be.
pub(super) fn wrong(path: &Path, field: &str, reason: impl ToString) -> CaptureError {
    CaptureError::MetadataValue {
        path: path.to_owned(),
        field: field.to_owned(),
        reason: reason.to_string(),
    }
}
