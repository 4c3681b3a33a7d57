//! The simulated receiver: where its antenna is and what its clock shows.

use super::values;
use crate::gnss::GpsTime;
use crate::gnss::coordinates::Geodetic;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Maximum acceleration, m/s^2, for which a carrier phase that is linear over 1 ms segments stays
/// within 1e-4 m: a T^2 / 8.
pub const MAX_ACCELERATION: f64 = 800.0;

/// The receiver of a scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatedReceiver {
    /// Where it is at the first sample; of a circle, the centre.
    pub position: AntennaPosition,
    /// How it moves.
    #[serde(default)]
    pub motion: Motion,
    /// Receiver clock minus GPS time at the first sample, s.
    #[serde(default, deserialize_with = "values::finite")]
    pub clock_offset_s: f64,
    /// Rate error of the receiver's oscillator, parts per million: it drives sampling clock and local
    /// oscillator alike, so a fast clock (> 0) lowers the apparent Doppler by 1575.42 Hz per ppm.
    #[serde(default, deserialize_with = "values::ppm")]
    pub clock_drift_ppm: f64,
}

/// Position of the antenna.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum AntennaPosition {
    /// Earth-centred Earth-fixed coordinates, m.
    EcefM([f64; 3]),
    /// On WGS 84.
    Geodetic {
        /// Latitude, degrees.
        #[serde(deserialize_with = "values::elevation")]
        latitude_deg: f64,
        /// Longitude, degrees.
        #[serde(deserialize_with = "values::finite")]
        longitude_deg: f64,
        /// Height above the ellipsoid, m.
        #[serde(deserialize_with = "values::finite")]
        height_m: f64,
    },
}

impl AntennaPosition {
    /// In ECEF metres.
    pub fn ecef(self) -> Vector3<f64> {
        match self {
            Self::EcefM(ecef) => ecef.into(),
            Self::Geodetic { latitude_deg, longitude_deg, height_m } => {
                Geodetic::from_degrees(latitude_deg, longitude_deg, height_m).to_ecef()
            }
        }
    }
}

/// How a receiver moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Motion {
    /// At rest.
    #[default]
    Static,
    /// On a straight line (in ECEF) with constant velocity.
    Straight {
        /// Velocity to east, north and up of the first position, m/s.
        velocity_enu_mps: [f64; 3],
    },
    /// On a horizontal circle, clockwise seen from above, from its northernmost point.
    Circle {
        /// Radius, m.
        #[serde(deserialize_with = "values::positive")]
        radius_m: f64,
        /// Speed, m/s.
        #[serde(deserialize_with = "values::positive")]
        speed_mps: f64,
    },
}

/// The receiver at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReceiverState {
    /// True GPS time.
    pub time: GpsTime,
    /// Reading of the receiver's clock.
    pub clock_reading: GpsTime,
    /// Antenna position, m, ECEF.
    pub position_m: Vector3<f64>,
    /// Velocity, m/s, ECEF.
    pub velocity_mps: Vector3<f64>,
    /// Receiver clock minus GPS time, s.
    pub clock_bias_s: f64,
    /// Rate of the clock bias per second of GPS time, s/s.
    pub clock_drift_sps: f64,
}

/// The receiver's whole path.
#[derive(Clone, Copy, Debug)]
pub struct Trajectory {
    start: GpsTime,
    origin_m: Vector3<f64>,
    east: Vector3<f64>,
    north: Vector3<f64>,
    up: Vector3<f64>,
    motion: Motion,
    clock_offset_s: f64,
    clock_drift_sps: f64,
}

impl Trajectory {
    /// The path of `receiver`, whose clock shows `start` at the first sample.
    pub fn new(receiver: &SimulatedReceiver, start: GpsTime) -> Self {
        let origin_m = receiver.position.ecef();
        let enu = Geodetic::from_ecef(&origin_m).ecef_to_enu();
        let axis = |i: usize| enu.row(i).transpose();
        Self {
            start,
            origin_m,
            east: axis(0),
            north: axis(1),
            up: axis(2),
            motion: receiver.motion,
            clock_offset_s: receiver.clock_offset_s,
            clock_drift_sps: receiver.clock_drift_ppm * 1e-6,
        }
    }

    /// The state when `elapsed` seconds of the receiver's own clock have passed since the first
    /// sample (any real number): true time passes by elapsed / (1 + drift).
    pub fn state(&self, elapsed: f64) -> ReceiverState {
        let true_elapsed = elapsed / (1.0 + self.clock_drift_sps);
        let clock_bias_s = self.clock_offset_s + self.clock_drift_sps * true_elapsed;
        let (position_m, velocity_mps) = self.motion_at(true_elapsed);
        ReceiverState {
            time: self.start + (true_elapsed - self.clock_offset_s),
            clock_reading: self.start + elapsed,
            position_m,
            velocity_mps,
            clock_bias_s,
            clock_drift_sps: self.clock_drift_sps,
        }
    }

    fn motion_at(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        match self.motion {
            Motion::Static => (self.origin_m, Vector3::zeros()),
            Motion::Straight { velocity_enu_mps: [e, n, u] } => {
                let velocity = self.east * e + self.north * n + self.up * u;
                (self.origin_m + velocity * t, velocity)
            }
            Motion::Circle { radius_m, speed_mps } => {
                let (sin, cos) = (speed_mps / radius_m * t).sin_cos();
                let offset = (self.east * sin + self.north * cos) * radius_m;
                let velocity = (self.east * cos - self.north * sin) * speed_mps;
                (self.origin_m + offset, velocity)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn receiver(motion: Motion) -> SimulatedReceiver {
        let position =
            AntennaPosition::Geodetic { latitude_deg: 48.0, longitude_deg: 11.0, height_m: 500.0 };
        SimulatedReceiver { position, motion, clock_offset_s: 1e-3, clock_drift_ppm: 2.0 }
    }

    #[test]
    fn a_circle_keeps_its_radius_speed_and_height_and_closes() {
        let circle = Motion::Circle { radius_m: 100.0, speed_mps: 20.0 };
        let path = Trajectory::new(&receiver(circle), GpsTime::from_week_tow(2190, 0.0));
        let centre = AntennaPosition::ecef(receiver(circle).position);
        let up = centre.normalize();
        for k in 0..20 {
            let s = path.state(f64::from(k) * 1.7);
            assert!(((s.position_m - centre).norm() - 100.0).abs() < 1e-7);
            assert!((s.velocity_mps.norm() - 20.0).abs() < 1e-12);
            // Geocentric and geodetic up differ by at most 0.2 degrees.
            assert!((s.position_m - centre).dot(&up).abs() < 0.4);
        }
        let period = std::f64::consts::TAU * 100.0 / 20.0 * (1.0 + 2e-6);
        assert!((path.state(period).position_m - path.state(0.0).position_m).norm() < 1e-6);
    }

    #[test]
    fn the_clock_shows_true_time_plus_bias() {
        let path = Trajectory::new(&receiver(Motion::Static), GpsTime::from_week_tow(2190, 10.0));
        for elapsed in [0.0, 3.0, 1000.0] {
            let s = path.state(elapsed);
            // Rounding of 1000 s in double precision: 1e-13 s.
            assert!((s.clock_reading - s.time - s.clock_bias_s).abs() < 2e-13);
            assert!(
                (s.clock_bias_s - (1e-3 + 2e-6 / (1.0 + 2e-6) * elapsed)).abs() < 1e-18 + 1e-15
            );
        }
    }
}
