//! What makes a solution plausible and how well its geometry is.

use super::error::PositioningError;
use nalgebra::{Matrix4, Vector3};
use sdr_rx_gnss::coordinates::Geodetic;

/// Smallest distance from the Earth's centre, m, of a place that is believed: the poles lie at 6357 km.
pub(super) const MIN_RADIUS: f64 = 6.33e6;
/// Largest such distance, m: 50 km above the equator.
pub(super) const MAX_RADIUS: f64 = 6.43e6;
/// Beyond this dilution a range error of 3 m is one of 300 m in position.
const MAX_PDOP: f64 = 100.0;

/// Dilutions of precision, and the rotation to local axes.
pub(super) struct Geometry {
    rotation: Matrix4<f64>,
    pub pdop: f64,
    pub hdop: f64,
    pub vdop: f64,
}

impl Geometry {
    /// From `(H^T H)^-1` of position (ECEF) and clock, for `satellites` satellites.
    pub fn new(
        position_m: &Vector3<f64>,
        cofactor: &Matrix4<f64>,
        satellites: usize,
    ) -> Result<Self, PositioningError> {
        let mut rotation = Matrix4::identity();
        let enu = Geodetic::from_ecef(position_m).ecef_to_enu();
        rotation.fixed_view_mut::<3, 3>(0, 0).copy_from(&enu);
        let local = rotation * cofactor * rotation.transpose();
        let hdop = (local[(0, 0)] + local[(1, 1)]).sqrt();
        let vdop = local[(2, 2)].sqrt();
        let pdop = hdop.hypot(vdop);
        if pdop <= MAX_PDOP {
            return Ok(Self { rotation, pdop, hdop, vdop });
        }
        let name = "position dilution of precision";
        Err(PositioningError::DegenerateGeometry { satellites, name, value: pdop, limit: MAX_PDOP })
    }

    /// A covariance of position and clock, from ECEF to east, north, up.
    pub fn local(&self, covariance: &Matrix4<f64>) -> Matrix4<f64> {
        self.rotation * covariance * self.rotation.transpose()
    }
}
