//! SigMF metadata, version 1.x: the part that a receiver needs.

mod document;
mod spatial;
mod write;

pub use document::{ApertureBearing, Capture, CartesianPoint, Extension, Global, Metadata};
pub(in crate::capture) use spatial::joined;
pub use write::SigmfWriter;

use super::error::wrong;
use super::file_source::Description;
use super::lane::Data;
use super::number::Number;
use super::options::check_rate;
use super::{CaptureError, Note, OpenOptions, SampleFormat};
use crate::gnss::signal::L1_CENTRE_HZ;
use std::path::{Path, PathBuf};

/// Parses the text of a `.sigmf-meta` file; `path` is for messages only.
///
/// # Errors
/// [`CaptureError::Metadata`] with line and column.
pub fn parse(text: &str, path: &Path) -> Result<Metadata, CaptureError> {
    serde_json::from_str(text.trim_start_matches('\u{feff}')).map_err(|e| CaptureError::Metadata {
        path: path.to_owned(),
        line: e.line(),
        column: e.column(),
        reason: format!("no SigMF metadata: {e}"),
    })
}

/// Describes the recording of a `.sigmf-meta` or `.sigmf-data` file.
pub(super) fn describe(path: &Path, options: &OpenOptions) -> Result<Description, CaptureError> {
    let suffix = path.extension().unwrap_or_default();
    if suffix == "sigmf" {
        let reason =
            "SigMF archives are not read: unpack it with `tar -xf` and name the .sigmf-meta";
        return Err(wrong(path, "archive", reason));
    }
    let meta_path = path.with_extension("sigmf-meta");
    if suffix == "sigmf-data" && !meta_path.exists() {
        if options.format.is_some() && options.rate_hz.is_some() {
            return Ok(Description::unknown(Data::whole(path)?));
        }
        let (metadata, data) = (meta_path, path.to_owned());
        return Err(CaptureError::MissingMetadata { metadata, data });
    }
    let bytes = std::fs::read(&meta_path)
        .map_err(|cause| CaptureError::Open { path: meta_path.clone(), cause })?;
    let metadata = parse(&String::from_utf8_lossy(&bytes), &meta_path)?;
    let data_path = match &metadata.global.dataset {
        Some(name) if Path::new(name).file_name().is_some_and(|last| last == name.as_str()) => {
            meta_path.with_file_name(name)
        }
        Some(name) => {
            let reason = format!(
                "'{name}' is not beside the metadata: name the data file itself, with its type and rate"
            );
            return Err(wrong(&meta_path, "core:dataset", reason));
        }
        None => meta_path.with_extension("sigmf-data"),
    };
    let described = interpret(&metadata, &meta_path, data_path.clone())?;
    let whole = Data::whole(&data_path).map_err(|e| match e {
        CaptureError::Open { ref cause, .. } if cause.kind() == std::io::ErrorKind::NotFound => {
            CaptureError::MissingData { metadata: meta_path.clone(), data: data_path.clone() }
        }
        other => other,
    })?;
    let offset = described.data[0].offset;
    let trailing = metadata.global.trailing_bytes.unwrap_or(0);
    let bytes = whole.bytes.map(|b| b.saturating_sub(offset).saturating_sub(trailing));
    Ok(Description { data: vec![whole.part(offset, bytes)], ..described })
}

/// The metadata's description of the data at `data_path`.
fn interpret(
    metadata: &Metadata,
    path: &Path,
    data_path: PathBuf,
) -> Result<Description, CaptureError> {
    let global = &metadata.global;
    if global.metadata_only == Some(true) {
        return Err(wrong(path, "core:metadata_only", "there are no samples with these metadata"));
    }
    let format = datatype(&global.datatype).ok_or_else(|| {
        let reason = format!(
            "'{}' is not supported: c or r, then one of u8 i8 u16_le i16_le i32_le f32_le f64_le (or _be)",
            global.datatype
        );
        wrong(path, "core:datatype", reason)
    })?;
    let channels = global.num_channels.unwrap_or(1);
    if !(1..=1024).contains(&channels) {
        return Err(wrong(path, "core:num_channels", format!("{channels} is not in 1 to 1024")));
    }
    if let Some(rate) = global.sample_rate
        && check_rate(rate).is_err()
    {
        let reason = format!("{rate} is no rate of a converter: above 0, at most 1e10");
        return Err(wrong(path, "core:sample_rate", reason));
    }
    let mut notes = Vec::new();
    let first = metadata.captures.first().cloned().unwrap_or_default();
    if metadata.captures.iter().skip(1).any(|c| c.header_bytes.unwrap_or(0) > 0) {
        let reason = "only the first segment may have one: split the recording";
        return Err(wrong(path, "core:header_bytes", reason));
    }
    if metadata.captures.len() > 1 {
        let segments = metadata.captures.len();
        notes.push(Note::Segments { path: path.to_owned(), segments });
    }
    if first.frequency.is_none() && !format.is_real() {
        notes.push(Note::NoFrequency(path.to_owned()));
    }
    let start_time = match &first.datetime {
        None => None,
        Some(text) => {
            let time = text.parse().ok();
            if time.is_none() {
                notes.push(Note::NoTime { path: path.to_owned(), text: text.clone() });
            }
            time
        }
    };
    let offset = first.header_bytes.unwrap_or(0);
    Ok(Description {
        format: Some(format),
        rate_hz: global.sample_rate,
        if_hz: first.frequency.map(|f| L1_CENTRE_HZ - f),
        channels_per_file: Some(channels),
        start_time,
        array: spatial::read(global, &first, channels, path)?,
        notes,
        ..Description::unknown(Data { path: data_path, offset, bytes: None, seekable: true })
    })
}

/// `^(c|r)(f32|f64|i32|i16|u32|u16|i8|u8)(_le|_be)?` of the specification, less u32.
fn datatype(name: &str) -> Option<SampleFormat> {
    let (kind, rest) = (name.get(..1)?, name.get(1..)?);
    let (number, big_endian) = match rest.split_once('_') {
        None => (rest, false),
        Some((number, "le")) => (number, false),
        Some((number, "be")) => (number, true),
        _ => return None,
    };
    let number = match number {
        "u8" => Number::U8,
        "i8" => Number::I8,
        "u16" => Number::U16,
        "i16" => Number::I16,
        "i32" => Number::I32,
        "f32" => Number::F32,
        "f64" => Number::F64,
        _ => return None,
    };
    matches!(kind, "c" | "r").then(|| SampleFormat::numbers(number, big_endian, kind == "r"))
}
