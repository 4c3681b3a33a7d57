//! What the user may choose.

use crate::gnss::atmosphere::Troposphere;

/// Options of the receiver's position solutions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositioningOptions {
    /// Troposphere model.
    pub troposphere: Troposphere,
    /// Satellites below this elevation, rad, are not used.
    pub elevation_mask: f64,
}

/// Saastamoinen's troposphere, mask 5 degrees.
impl Default for PositioningOptions {
    fn default() -> Self {
        Self { troposphere: Troposphere::default(), elevation_mask: 5f64.to_radians() }
    }
}

/// Options of the snapshot solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SnapshotOptions {
    /// What all position solutions share.
    pub positioning: PositioningOptions,
    /// How far the epoch's receive time may be from GPS time, s, either way. Beyond ten minutes the time is
    /// searched for; where it is infinite, at all times that the ephemerides cover.
    pub time_uncertainty_s: f64,
    /// Speed that the receiver may have, m/s: it enters the standard deviation of the Dopplers.
    pub user_speed_mps: f64,
}

/// Time known to a minute, a receiver that stands still.
impl Default for SnapshotOptions {
    fn default() -> Self {
        Self {
            positioning: PositioningOptions::default(),
            time_uncertainty_s: 60.0,
            user_speed_mps: 0.0,
        }
    }
}
