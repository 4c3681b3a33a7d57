//! The orbit of a satellite, from any source, and the propagation of its signal.
//!
//! [`NavigationData::orbit`](super::NavigationData::orbit) gives the valid [`Orbit`] of a satellite at a time.

pub mod broadcast;
pub mod glonass;
pub mod precise;
pub(crate) mod system;

use crate::constants::{OMEGA_EARTH, SPEED_OF_LIGHT};
use crate::orbit::broadcast::ura_metres;
use crate::orbit::precise::PreciseArc;
use crate::{Ephemeris, GlonassEphemeris, GpsTime, SatelliteState};
use nalgebra::{Rotation3, Vector3};

/// A source of satellite states around one time.
#[derive(Clone, Copy, Debug)]
pub enum Orbit<'a> {
    /// Broadcast elements.
    Broadcast(&'a Ephemeris),
    /// Broadcast position and velocity of GLONASS, to be integrated.
    Glonass(&'a GlonassEphemeris),
    /// Tabulated positions and clocks, as of an SP3 file.
    Precise(PreciseArc<'a>),
}

impl<'a> From<&'a Ephemeris> for Orbit<'a> {
    fn from(ephemeris: &'a Ephemeris) -> Self {
        Self::Broadcast(ephemeris)
    }
}

impl<'a> From<&'a GlonassEphemeris> for Orbit<'a> {
    fn from(ephemeris: &'a GlonassEphemeris) -> Self {
        Self::Glonass(ephemeris)
    }
}

impl<'a> From<PreciseArc<'a>> for Orbit<'a> {
    fn from(arc: PreciseArc<'a>) -> Self {
        Self::Precise(arc)
    }
}

/// Standard deviation of a range of GLONASS, m: 2 m of orbit and clock (Montenbruck et al. 2018, see `system`), and 1 m of
/// what its frequency channels differ by in a receiver.
const GLONASS_SIGMA_M: f64 = 2.2;

impl Orbit<'_> {
    /// Satellite state at GPS time `t`, as good as the source is at that time.
    pub fn state(&self, t: GpsTime) -> SatelliteState {
        match self {
            Self::Broadcast(ephemeris) => ephemeris.state(t),
            Self::Glonass(ephemeris) => ephemeris.state(t),
            Self::Precise(arc) => arc.state(t),
        }
    }

    /// Standard deviation, m, of a range on L1 computed from orbit and satellite clock.
    pub fn range_sigma_m(&self) -> f64 {
        match self {
            // Index 0 of GPS stands for 2.4 m, its upper bound, where orbit and clock are good to about 0.7 m.
            Self::Broadcast(ephemeris) => {
                let model = ephemeris.sv.constellation().model();
                let worse = ura_metres(ephemeris.ura_index) / model.usual_ura_m;
                model.range_sigma_m * worse.max(1.0)
            }
            Self::Glonass(_) => GLONASS_SIGMA_M,
            Self::Precise(arc) => arc.range_sigma_m(),
        }
    }
}

/// Why there is no orbit to use for a satellite at a time.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoOrbit {
    /// No orbit of the satellite is known.
    #[error("no ephemeris")]
    Unknown,
    /// The table of precise orbits has too few points to be interpolated.
    #[error("{points} points of its precise orbit, {needed} are needed")]
    TooFewPoints {
        /// Points of the table.
        points: usize,
        /// Points needed.
        needed: usize,
    },
    /// The nearest ephemeris is this many hours away.
    #[error("ephemeris {0:.1} h away")]
    Stale(f64),
    /// The satellite declares itself unhealthy, with this health word.
    #[error("unhealthy (health word {0})")]
    Unhealthy(u8),
    /// The satellite raises the alert flag of its hand-over words: its ranges may be worse than it states.
    #[error("it sends the alert flag")]
    Alert,
    /// The satellite gives no prediction of its accuracy (URA index 15).
    #[error("it predicts no accuracy (URA index 15, or no SISA)")]
    NoAccuracy,
}

/// Rotates an ECEF vector of the instant of transmission into the ECEF frame of reception,
/// `flight_time_s` later (the Sagnac correction; IS-GPS-200N 20.3.3.4.3.3.2).
pub fn earth_rotation(vector: &Vector3<f64>, flight_time_s: f64) -> Vector3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), -OMEGA_EARTH * flight_time_s) * vector
}

/// Geometric range and its rate from a receiver to a satellite, light time and Earth rotation
/// solved for a known instant of reception.
#[derive(Clone, Copy, Debug)]
pub struct Propagation {
    /// Satellite state at the instant of transmission, position and velocity rotated into the ECEF
    /// frame of the instant of reception.
    pub satellite: SatelliteState,
    /// Range in the frame of reception, m.
    pub range_m: f64,
    /// Time of transmission, GPS time.
    pub transmit_time: GpsTime,
}

impl Propagation {
    /// Light-time solution for reception at GPS time `receive_time` at `receiver_m` (ECEF, m):
    /// fixed-point iteration, converged below 1e-7 m in three rounds as v/c < 1e-4 per round.
    pub fn solve<'a>(
        orbit: impl Into<Orbit<'a>>,
        receiver_m: &Vector3<f64>,
        receive_time: GpsTime,
    ) -> Self {
        let orbit = orbit.into();
        let mut flight_time = 0.075;
        let mut result = None;
        for _ in 0..4 {
            let transmit_time = receive_time - flight_time;
            let mut satellite = orbit.state(transmit_time);
            satellite.position_m = earth_rotation(&satellite.position_m, flight_time);
            satellite.velocity_mps = earth_rotation(&satellite.velocity_mps, flight_time);
            let range_m = (satellite.position_m - receiver_m).norm();
            flight_time = range_m / SPEED_OF_LIGHT;
            result = Some(Self { satellite, range_m, transmit_time });
        }
        result.expect("the loop runs four times")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orbit::broadcast::sample_ephemeris;

    #[test]
    fn propagation_closes_the_light_time_equation() {
        let eph = sample_ephemeris();
        let receiver = Vector3::new(-3_959_617.5, 3_350_136.6, 3_699_531.5);
        let p = Propagation::solve(&eph, &receiver, eph.toe + 100.0);
        let flight = (eph.toe + 100.0) - p.transmit_time;
        assert!((flight * SPEED_OF_LIGHT - p.range_m).abs() < 1e-6);
        // The Sagnac term equals omega/c (x_s y_r - y_s x_r) to second order.
        let s = eph.state(p.transmit_time).position_m;
        let sagnac = OMEGA_EARTH / SPEED_OF_LIGHT * (s.x * receiver.y - s.y * receiver.x);
        let plain = (s - receiver).norm();
        assert!((p.range_m - plain - sagnac).abs() < 1e-3, "{} {}", p.range_m - plain, sagnac);
    }
}
