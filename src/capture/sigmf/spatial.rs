//! The antenna array in SigMF metadata: the `spatial` extension, version 1.1.0.
//!
//! Its frame has X along the boresight, Y to the left and Z up; `aperture_azimuth` (or
//! `aperture_bearing`) is the direction of X, and `aperture_rotation` is a right-handed turn about it. Ours is
//! right, forward, up, with yaw, pitch and roll. Forward is the boresight, and so
//!
//! - right = -Y, forward = X, up = Z;
//! - yaw = azimuth, pitch = elevation, roll = rotation.
//!
//! `phase_offset` belongs to a whole file (one channel each); data are aligned by exp(-j phase_offset).
//! Weights of the channels of one file have no field of the extension: they stand in
//! `sdr_rx:calibration`, [re, im] for each channel.

use super::document::{ApertureBearing, Capture, CartesianPoint, Extension, Global};
use crate::capture::CaptureError;
use crate::capture::error::wrong;
use crate::gnss::antenna::{AntennaArray, ArrayDescription, Attitude};
use nalgebra::Vector3;
use num_complex::Complex64;
use std::path::Path;

/// Farthest element from the origin, m.
const FARTHEST_M: f64 = 1000.0;

/// Adds the array, without its errors, to the metadata of a file with all of its channels.
pub(super) fn describe(array: &ArrayDescription, global: &mut Global, capture: &mut Capture) {
    let Attitude { yaw_deg, pitch_deg, roll_deg } = array.attitude;
    let extension = |name: &str, version: &str| Extension {
        name: name.into(),
        version: version.into(),
        optional: true,
    };
    global.extensions.push(extension("spatial", "1.1.0"));
    global.num_elements = Some(array.len());
    global.channel_index = Some(0);
    capture.aperture_azimuth = Some(yaw_deg);
    capture.aperture_bearing = (pitch_deg != 0.0)
        .then_some(ApertureBearing { azimuth: Some(yaw_deg), elevation: Some(pitch_deg) });
    capture.aperture_rotation = (roll_deg != 0.0).then_some(roll_deg);
    let point = |p: &Vector3<f64>| CartesianPoint { point: Some([p.y, 0.0 - p.x, p.z]) };
    capture.element_geometry = Some(array.array.elements_m.iter().map(point).collect());
    if let Some(weights) = &array.calibration {
        global.extensions.push(extension("sdr_rx", "1.0.0"));
        global.calibration = Some(weights.iter().map(|w| [w.re, w.im]).collect());
    }
}

/// The part of the array that belongs to the `channels` of one file, if the metadata give it.
pub(super) fn read(
    global: &Global,
    capture: &Capture,
    channels: usize,
    path: &Path,
) -> Result<Option<ArrayDescription>, CaptureError> {
    let Some(geometry) = &capture.element_geometry else { return Ok(None) };
    let field = "spatial:element_geometry";
    let first = if geometry.len() == channels { 0 } else { global.channel_index.unwrap_or(0) };
    let own = first.checked_add(channels).and_then(|end| geometry.get(first..end)).ok_or_else(|| {
        let reason = format!(
            "{} elements, and channel_index {first} with {channels} channels: list the elements of this file, \
             or all of the array",
            geometry.len()
        );
        wrong(path, field, reason)
    })?;
    // An element of unknown position makes the array an unknown one.
    let Some(points) = own.iter().map(|p| p.point).collect::<Option<Vec<_>>>() else {
        return Ok(None);
    };
    if let Some(p) = points.iter().flatten().find(|v| v.abs() > FARTHEST_M) {
        return Err(wrong(path, field, format!("{p} is not within {FARTHEST_M} m")));
    }
    let bearing = capture.aperture_bearing.unwrap_or_default();
    let yaw_deg = bearing.azimuth.or(capture.aperture_azimuth).unwrap_or(0.0);
    let pitch_deg = bearing.elevation.unwrap_or(0.0);
    let roll_deg = capture.aperture_rotation.unwrap_or(0.0);
    let calibration = calibration(global, capture, channels, path)?;
    let position = |[x, y, z]: [f64; 3]| Vector3::new(0.0 - y, x, z);
    let array = AntennaArray::new(points.into_iter().map(position).collect());
    let attitude = Attitude { yaw_deg, pitch_deg, roll_deg };
    Ok(Some(ArrayDescription { attitude, calibration, ..array.into() }))
}

fn calibration(
    global: &Global,
    capture: &Capture,
    channels: usize,
    path: &Path,
) -> Result<Option<Vec<Complex64>>, CaptureError> {
    let aligned = capture.phase_offset.filter(|&phase| phase != 0.0);
    let offset = aligned.map(|phase| vec![Complex64::cis(-phase.to_radians()); channels]);
    match &global.calibration {
        None => Ok(offset),
        Some(list) if list.len() == channels => {
            Ok(Some(list.iter().map(|&[re, im]| Complex64::new(re, im)).collect()))
        }
        Some(list) => {
            let reason =
                format!("{} weights for {channels} channels: give one for each", list.len());
            Err(wrong(path, "sdr_rx:calibration", reason))
        }
    }
}

/// The array whose parts two files hold, in this order; none where one is unknown or has another attitude.
pub(in crate::capture) fn joined(
    first: Option<ArrayDescription>,
    second: Option<ArrayDescription>,
) -> Option<ArrayDescription> {
    let (mut first, second) = (first?, second?);
    let calibrated = first.calibration.is_some() || second.calibration.is_some();
    let weights = |part: &ArrayDescription| {
        part.calibration.clone().unwrap_or_else(|| vec![Complex64::ONE; part.len()])
    };
    first.calibration = calibrated.then(|| [weights(&first), weights(&second)].concat());
    first.array.elements_m.extend(second.array.elements_m);
    first.array.gains.extend(second.array.gains);
    first.errors.extend(second.errors);
    (first.attitude == second.attitude).then_some(first)
}
