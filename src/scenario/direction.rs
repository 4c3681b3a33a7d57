//! Directions of arrival of signals that no satellite sends.

use super::values;
use crate::gnss::Sv;
use crate::gnss::antenna::{ArrayDescription, direction};
use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};

/// A direction of arrival.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Direction {
    /// Azimuth and elevation.
    #[serde(rename = "sky")]
    AzimuthElevation {
        /// From north over east, degrees.
        #[serde(deserialize_with = "values::finite")]
        azimuth_deg: f64,
        /// Above the horizon, degrees.
        #[serde(deserialize_with = "values::elevation")]
        elevation_deg: f64,
    },
    /// On a cone about the axis of a linear array: degrees from broadside towards its last element. Of the
    /// cone's directions, the one before the platform (above it, where the axis points forward).
    #[serde(deserialize_with = "values::elevation")]
    ConeDeg(f64),
}

impl Direction {
    /// Unit vector (east, north, up), or why there is none.
    pub fn towards(&self, array: Option<&ArrayDescription>) -> Result<Unit<Vector3<f64>>, String> {
        match *self {
            Self::AzimuthElevation { azimuth_deg, elevation_deg } => {
                Ok(direction(azimuth_deg.to_radians(), elevation_deg.to_radians()))
            }
            Self::ConeDeg(cone_deg) => {
                let axis = array.and_then(|a| Some((a.attitude, a.array.axis()?)));
                let (attitude, axis) = axis.ok_or(
                    "direction.cone_deg needs an [array] whose elements lie on a line: give direction.sky",
                )?;
                let across = |v: Vector3<f64>| v - axis.into_inner() * axis.dot(&v);
                let forward = across(Vector3::y());
                let side = if forward.norm() > 0.1 { forward } else { across(Vector3::z()) };
                let (sin, cos) = cone_deg.to_radians().sin_cos();
                let towards = axis.into_inner() * sin + side.normalize() * cos;
                Ok(Unit::new_normalize(attitude.to_enu() * towards))
            }
        }
    }
}

/// A transmitter that sends the signals of satellites, with their true ranges, from one direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spoofer {
    /// Direction of arrival.
    pub direction: Direction,
    /// When it begins, s from the start; before, the satellites themselves are received.
    #[serde(default, deserialize_with = "values::finite")]
    pub start_s: f64,
    /// Satellites whose signals it sends; absent: all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub satellites: Option<Vec<Sv>>,
}

impl Spoofer {
    /// Whether it sends the signal of this satellite.
    pub fn sends(&self, sv: Sv) -> bool {
        self.satellites.as_ref().is_none_or(|list| list.contains(&sv))
    }
}
