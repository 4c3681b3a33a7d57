//! The fields of SigMF metadata, version 1.x, and of its `spatial` extension that a receiver needs.

use serde::{Deserialize, Serialize};

/// A `.sigmf-meta` file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// Properties of the whole recording.
    pub global: Global,
    /// Segments of the recording, the first at sample 0.
    #[serde(default)]
    pub captures: Vec<Capture>,
    /// Marked regions, unchanged.
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
    /// Description of the recording.
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
    #[serde(
        rename = "core:extensions",
        default,
        skip_serializing_if = "Vec::is_empty",
        deserialize_with = "extensions"
    )]
    pub extensions: Vec<Extension>,
    /// Elements of the antenna array, in this file and others.
    #[serde(rename = "spatial:num_elements", skip_serializing_if = "Option::is_none")]
    pub num_elements: Option<usize>,
    /// The array's element of the first channel.
    #[serde(rename = "spatial:channel_index", skip_serializing_if = "Option::is_none")]
    pub channel_index: Option<usize>,
    /// Factors of the channels, [re, im].
    #[serde(rename = "sdr_rx:calibration", skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Vec<[f64; 2]>>,
}

/// A member of `captures`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Capture {
    /// Index of the segment's first sample.
    #[serde(rename = "core:sample_start", default)]
    pub sample_start: u64,
    /// Radio frequency at 0 Hz of the samples, Hz.
    #[serde(rename = "core:frequency", skip_serializing_if = "Option::is_none")]
    pub frequency: Option<f64>,
    /// UTC of the segment's first sample, ISO 8601.
    #[serde(rename = "core:datetime", skip_serializing_if = "Option::is_none")]
    pub datetime: Option<String>,
    /// Bytes of a header before the segment's first sample.
    #[serde(rename = "core:header_bytes", skip_serializing_if = "Option::is_none")]
    pub header_bytes: Option<u64>,
    /// Azimuth of the array's boresight, degrees from north over east.
    #[serde(rename = "spatial:aperture_azimuth", skip_serializing_if = "Option::is_none")]
    pub aperture_azimuth: Option<f64>,
    /// The same with elevation; overrides `aperture_azimuth`.
    #[serde(rename = "spatial:aperture_bearing", skip_serializing_if = "Option::is_none")]
    pub aperture_bearing: Option<ApertureBearing>,
    /// Right-handed turn about the boresight, degrees.
    #[serde(rename = "spatial:aperture_rotation", skip_serializing_if = "Option::is_none")]
    pub aperture_rotation: Option<f64>,
    /// Positions of the elements: those of this file, or all of the array.
    #[serde(rename = "spatial:element_geometry", skip_serializing_if = "Option::is_none")]
    pub element_geometry: Option<Vec<CartesianPoint>>,
    /// Phase of this file's data against the common reference, degrees.
    #[serde(rename = "spatial:phase_offset", skip_serializing_if = "Option::is_none")]
    pub phase_offset: Option<f64>,
}

/// An extension that the metadata use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extension {
    /// Its namespace.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Whether the recording can be read without knowing it.
    pub optional: bool,
}

/// Extensions as a list of objects, or as older versions have them, an object of versions by name; of anything else none.
fn extensions<'de, D: serde::Deserializer<'de>>(d: D) -> Result<Vec<Extension>, D::Error> {
    use serde_json::Value;
    let named = |(name, version): (String, Value)| Extension {
        name,
        version: version.as_str().unwrap_or_default().to_owned(),
        optional: true,
    };
    Ok(match Value::deserialize(d)? {
        Value::Array(all) => all.into_iter().flat_map(serde_json::from_value).collect(),
        Value::Object(all) => all.into_iter().map(named).collect(),
        _ => Vec::new(),
    })
}

/// Position of an element.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CartesianPoint {
    /// X, Y, Z, m; absent where it is unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point: Option<[f64; 3]>,
}

/// Direction of the boresight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ApertureBearing {
    /// Degrees from north over east.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub azimuth: Option<f64>,
    /// Degrees above the horizon.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elevation: Option<f64>,
}
