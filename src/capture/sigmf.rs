//! SigMF metadata, version 1.x: the part that a receiver needs.

use super::file_source::Description;
use super::lane::Data;
use super::number::Number;
use super::sigmf_spatial::{self, Bearing, CartesianPoint, Extension};
use super::{CaptureError, OpenOptions, SampleFormat};
use crate::gnss::constants::L1_HZ;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A `.sigmf-meta` file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// What holds for the whole recording.
    pub global: Global,
    /// Segments of the recording, the first at sample 0.
    #[serde(default)]
    pub captures: Vec<Capture>,
    /// Marked regions: kept as they are.
    #[serde(default)]
    pub annotations: Vec<serde_json::Value>,
}

/// The `global` object.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Global {
    /// Sample type, such as `ci16_le`.
    #[serde(rename = "core:datatype")]
    pub datatype: String,
    /// Samples per second of each channel, Hz.
    #[serde(rename = "core:sample_rate", skip_serializing_if = "Option::is_none")]
    pub sample_rate: Option<f64>,
    /// Version of the SigMF specification.
    #[serde(rename = "core:version", default)]
    pub version: String,
    /// Number of channels, interleaved by sample; 1 where absent.
    #[serde(rename = "core:num_channels", skip_serializing_if = "Option::is_none")]
    pub num_channels: Option<usize>,
    /// What the recording is.
    #[serde(rename = "core:description", skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// The hardware that made it.
    #[serde(rename = "core:hw", skip_serializing_if = "Option::is_none")]
    pub hw: Option<String>,
    /// The software that made it.
    #[serde(rename = "core:recorder", skip_serializing_if = "Option::is_none")]
    pub recorder: Option<String>,
    /// Name of the data file where it is not the metadata's own with suffix `.sigmf-data`.
    #[serde(rename = "core:dataset", skip_serializing_if = "Option::is_none")]
    pub dataset: Option<String>,
    /// Bytes after the last sample.
    #[serde(rename = "core:trailing_bytes", skip_serializing_if = "Option::is_none")]
    pub trailing_bytes: Option<u64>,
    /// Whether there is no data file.
    #[serde(rename = "core:metadata_only", skip_serializing_if = "Option::is_none")]
    pub metadata_only: Option<bool>,
    /// Extensions in use.
    #[serde(rename = "core:extensions", default, skip_serializing_if = "Vec::is_empty")]
    pub extensions: Vec<Extension>,
    /// Elements of the antenna array, in this file and others.
    #[serde(rename = "spatial:num_elements", skip_serializing_if = "Option::is_none")]
    pub num_elements: Option<usize>,
    /// Which of the array's elements the first channel is.
    #[serde(rename = "spatial:channel_index", skip_serializing_if = "Option::is_none")]
    pub channel_index: Option<usize>,
    /// What the channels are to be multiplied by, [re, im].
    #[serde(rename = "sdr_rx:calibration", skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Vec<[f64; 2]>>,
}

/// A member of `captures`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Capture {
    /// Index of the segment's first sample.
    #[serde(rename = "core:sample_start", default)]
    pub sample_start: u64,
    /// Frequency of the sky that lies at 0 Hz of the samples, Hz.
    #[serde(rename = "core:frequency", skip_serializing_if = "Option::is_none")]
    pub frequency: Option<f64>,
    /// UTC of the segment's first sample, ISO 8601.
    #[serde(rename = "core:datetime", skip_serializing_if = "Option::is_none")]
    pub datetime: Option<String>,
    /// Bytes before the segment's first sample that are no samples.
    #[serde(rename = "core:header_bytes", skip_serializing_if = "Option::is_none")]
    pub header_bytes: Option<u64>,
    /// Where the array's boresight points, degrees from north over east.
    #[serde(rename = "spatial:aperture_azimuth", skip_serializing_if = "Option::is_none")]
    pub aperture_azimuth: Option<f64>,
    /// The same with elevation; goes before `aperture_azimuth`.
    #[serde(rename = "spatial:aperture_bearing", skip_serializing_if = "Option::is_none")]
    pub aperture_bearing: Option<Bearing>,
    /// Right-handed turn about the boresight, degrees.
    #[serde(rename = "spatial:aperture_rotation", skip_serializing_if = "Option::is_none")]
    pub aperture_rotation: Option<f64>,
    /// Where the elements are: those of this file, or all of the array.
    #[serde(rename = "spatial:element_geometry", skip_serializing_if = "Option::is_none")]
    pub element_geometry: Option<Vec<CartesianPoint>>,
    /// Phase of this file's data against the common reference, degrees.
    #[serde(rename = "spatial:phase_offset", skip_serializing_if = "Option::is_none")]
    pub phase_offset: Option<f64>,
}

/// Parses the text of a `.sigmf-meta` file; `path` is for messages only.
///
/// # Errors
/// [`CaptureError::Metadata`] with line and column.
pub fn parse(text: &str, path: &Path) -> Result<Metadata, CaptureError> {
    serde_json::from_str(text).map_err(|e| CaptureError::Metadata {
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
        Some(name) => meta_path.with_file_name(name),
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

/// What the metadata say of the data at `data_path`.
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
        && !(rate.is_finite() && rate > 0.0)
    {
        return Err(wrong(path, "core:sample_rate", format!("{rate} is no positive number")));
    }
    let mut notes = Vec::new();
    let first = metadata.captures.first().cloned().unwrap_or_default();
    if metadata.captures.iter().skip(1).any(|c| c.header_bytes.unwrap_or(0) > 0) {
        let reason = "only the first segment may have one: split the recording";
        return Err(wrong(path, "core:header_bytes", reason));
    }
    if metadata.captures.len() > 1 {
        notes.push(format!(
            "'{}' has {} segments: frequency and time of the first are taken for all, and gaps \
             between them are not known",
            path.display(),
            metadata.captures.len()
        ));
    }
    if first.frequency.is_none() && !format.is_real() {
        notes.push(format!(
            "'{}' states no core:frequency: the L1 carrier is taken to lie at 0 Hz; give --if otherwise",
            path.display()
        ));
    }
    let start_time = match &first.datetime {
        None => None,
        Some(text) => Some(text.parse().map_err(|e| wrong(path, "core:datetime", format!("{e}")))?),
    };
    let offset = first.header_bytes.unwrap_or(0);
    Ok(Description {
        format: Some(format),
        rate_hz: global.sample_rate,
        if_hz: first.frequency.map(|f| L1_HZ - f),
        channels_per_file: Some(channels),
        start_time,
        array: sigmf_spatial::read(global, &first, channels, path)?,
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

pub(super) fn wrong(path: &Path, field: &str, reason: impl ToString) -> CaptureError {
    CaptureError::MetadataValue {
        path: path.to_owned(),
        field: field.to_owned(),
        reason: reason.to_string(),
    }
}
