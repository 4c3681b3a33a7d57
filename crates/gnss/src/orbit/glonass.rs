//! Ephemerides of GLONASS: position, velocity and acceleration at one instant, from which the orbit is integrated
//! (ICD L1, L2, edition 5.1, 4.4 and A.3.1.2).

use crate::constants::OMEGA_EARTH_BEIDOU as OMEGA_EARTH_PZ90;
use crate::{GpsTime, SatelliteState, Sv};
use nalgebra::Vector3;

/// Gravitational constant of PZ-90, m^3/s^2, its semi-major axis, m, and second zonal harmonic (edition 5.1, table 3.2).
const MU: f64 = 3.986_004_4e14;
const SEMI_MAJOR_AXIS_M: f64 = 6_378_136.0;
const J2: f64 = 1.082_625_7e-3;
/// Longest step of the integration, s: its error is below a millimetre after 15 minutes.
const STEP_S: f64 = 60.0;
/// How far from its instant an ephemeris may be used, s: half of the 30 minutes between two.
pub(crate) const HALF_INTERVAL_S: f64 = 900.0;

/// An ephemeris of GLONASS, in PZ-90.11, which is WGS 84 within centimetres; times are those of GPS.
#[derive(Clone, Debug, PartialEq)]
pub struct GlonassEphemeris {
    /// The satellite, by its orbital slot.
    pub sv: Sv,
    /// Instant `t_b` of the ephemeris.
    pub tb: GpsTime,
    /// When the message frame was sent, if known.
    pub sent: Option<GpsTime>,
    /// Satellite clock minus GLONASS time at `t_b`, s: `-tau_n`.
    pub clock_bias_s: f64,
    /// Relative offset of the carrier's frequency, `gamma_n`: rate of the clock, s/s.
    pub clock_drift_sps: f64,
    /// Position at `t_b`, m, in the rotating frame.
    pub position_m: Vector3<f64>,
    /// Velocity at `t_b`, m/s, in the rotating frame.
    pub velocity_mps: Vector3<f64>,
    /// Acceleration by Sun and Moon, m/s^2.
    pub acceleration_mps2: Vector3<f64>,
    /// Health: `B_n` as sent or as its highest bit, plus 8 where `l_n` is set; 0 is healthy.
    pub health: u8,
    /// Frequency channel, -7 to 13, if it is stated.
    pub channel: Option<i8>,
    /// Age of the data, days.
    pub age_days: u8,
}

/// Position and velocity.
type Motion = (Vector3<f64>, Vector3<f64>);

impl GlonassEphemeris {
    /// Satellite state at GPS time `t`: Runge-Kutta of fourth order from `t_b`. Relativity is part of the clock's terms.
    pub fn state(&self, t: GpsTime) -> SatelliteState {
        let elapsed = t - self.tb;
        let steps = (elapsed.abs() / STEP_S).ceil().max(1.0);
        let h = elapsed / steps;
        let mut motion = (self.position_m, self.velocity_mps);
        for _ in 0..steps as usize {
            motion = self.step(motion, h);
        }
        SatelliteState {
            position_m: motion.0,
            velocity_mps: motion.1,
            clock_bias_s: self.clock_bias_s + self.clock_drift_sps * elapsed,
            clock_drift_sps: self.clock_drift_sps,
        }
    }

    fn step(&self, (r, v): Motion, h: f64) -> Motion {
        let rate = |(r, v): Motion| (v, self.acceleration(&r, &v));
        let ahead = |k: &Motion, h: f64| (r + k.0 * h, v + k.1 * h);
        let k1 = rate((r, v));
        let k2 = rate(ahead(&k1, h / 2.0));
        let k3 = rate(ahead(&k2, h / 2.0));
        let k4 = rate(ahead(&k3, h));
        let mean = |a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>, d: &Vector3<f64>| {
            (a + 2.0 * (b + c) + d) * (h / 6.0)
        };
        (r + mean(&k1.0, &k2.0, &k3.0, &k4.0), v + mean(&k1.1, &k2.1, &k3.1, &k4.1))
    }

    /// Acceleration in the rotating frame: central force, oblateness, Sun and Moon, centrifugal and Coriolis terms.
    fn acceleration(&self, r: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        let square = r.norm_squared();
        let central = MU / (square * square.sqrt());
        let oblate = 1.5 * J2 * central * SEMI_MAJOR_AXIS_M.powi(2) / square;
        let polar = 5.0 * r.z * r.z / square;
        let across = -central - oblate * (1.0 - polar);
        let (w, w2) = (OMEGA_EARTH_PZ90, OMEGA_EARTH_PZ90.powi(2));
        self.acceleration_mps2
            + Vector3::new(
                (across + w2) * r.x + 2.0 * w * v.y,
                (across + w2) * r.y - 2.0 * w * v.x,
                (-central - oblate * (3.0 - polar)) * r.z,
            )
    }

    /// Whether the satellite declares itself fit for use.
    pub fn is_healthy(&self) -> bool {
        self.health == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> GlonassEphemeris {
        // R01 of 2024-06-24 08:15 UTC as its satellite sent it.
        GlonassEphemeris {
            sv: "R01".parse().unwrap(),
            tb: GpsTime::from_utc(2024, 6, 24, 8, 15, 0.0),
            sent: None,
            clock_bias_s: 8.934084326029e-5,
            clock_drift_sps: 9.094947017729e-13,
            position_m: Vector3::new(-1.373688769531e7, -3.309238281250e6, 2.124241259766e7),
            velocity_mps: Vector3::new(-1.554378509521e3, -2.458472251892e3, -1.386628150940e3),
            acceleration_mps2: Vector3::new(
                9.313225746155e-7,
                1.862645149231e-6,
                -1.862645149231e-6,
            ),
            health: 0,
            channel: Some(1),
            age_days: 0,
        }
    }

    /// In the inertial frame the energy of central force and oblateness is kept where nothing else acts.
    #[test]
    fn the_energy_is_kept_and_the_way_back_is_the_way_there() {
        let eph = GlonassEphemeris { acceleration_mps2: Vector3::zeros(), ..sample() };
        let energy = |s: &SatelliteState| {
            let (r, rotation) = (s.position_m, Vector3::z() * OMEGA_EARTH_PZ90);
            let (v, n) = (s.velocity_mps + rotation.cross(&r), r.norm());
            let oblate = J2 * (SEMI_MAJOR_AXIS_M / n).powi(2) * (1.5 * (r.z / n).powi(2) - 0.5);
            v.norm_squared() / 2.0 - MU / n * (1.0 - oblate)
        };
        let (start, end) = (eph.state(eph.tb), eph.state(eph.tb + 900.0));
        // A millimetre of the orbit's height is 2e-11 of the energy.
        assert!((energy(&end) / energy(&start) - 1.0).abs() < 2e-11);
        let back = GlonassEphemeris {
            tb: eph.tb + 900.0,
            position_m: end.position_m,
            velocity_mps: end.velocity_mps,
            ..eph.clone()
        };
        assert!((back.state(eph.tb).position_m - eph.position_m).norm() < 1e-3);
    }

    #[test]
    fn velocity_is_the_derivative_of_position_and_the_clock_runs_linearly() {
        let eph = sample();
        for k in -3..=3 {
            let t = eph.tb + 240.0 * f64::from(k) + 30.0;
            let (before, at, after) = (eph.state(t - 1.0), eph.state(t), eph.state(t + 1.0));
            // Truncation of the central difference: a sixth of the third derivative, below 1e-4 m/s.
            let difference = (after.position_m - before.position_m) / 2.0;
            assert!((difference - at.velocity_mps).norm() < 1e-4);
            let drift = (after.clock_bias_s - before.clock_bias_s) / 2.0;
            assert!((drift - eph.clock_drift_sps).abs() < 1e-18);
        }
    }
}
