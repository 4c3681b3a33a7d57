//! What is observed, on plain satellite positions and velocities, with its first and second derivatives.
//!
//! With `u = (s - r)/rho` the unit vector from receiver `r` to satellite `s`, `rho` the range, `v` the
//! satellite's velocity, all in the Earth-fixed frame, where the receiver stands still:
//!
//! | observable | `h(r)` | gradient by `r` | second derivative along `D` |
//! | --- | --- | --- | --- |
//! | pseudorange, m | `rho + b` | `-u` | `(q - p^2)/rho` |
//! | Doppler as range rate, m/s | `u.v + d` | `(u (u.v) - v)/rho` | `2 h1 p/rho - (u.v)(q - p^2)/rho^2` |
//!
//! `p = u.D`, `q = |D|^2`, `h1` the gradient along `D`; the clock terms `b` and `d` enter linearly.

use nalgebra::Vector3;

/// A satellite, as the geometry needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Satellite {
    /// Position, m, ECEF.
    pub position_m: Vector3<f64>,
    /// Velocity, m/s, ECEF; not used by pseudoranges.
    pub velocity_mps: Vector3<f64>,
}

/// Where a receiver sees a satellite: what the value of an observation and its derivatives share.
#[derive(Clone, Copy, Debug)]
pub struct LineOfSight {
    /// Unit vector from receiver to satellite, ECEF.
    pub unit: Vector3<f64>,
    /// Their distance, m.
    pub range: f64,
    /// Its inverse, 1/m.
    pub inverse_range: f64,
}

impl LineOfSight {
    /// From a receiver at `receiver_m` (ECEF) to the satellite; not finite where the two coincide.
    #[inline]
    pub fn new(satellite: &Satellite, receiver_m: &Vector3<f64>) -> Self {
        let los = satellite.position_m - receiver_m;
        let range = los.norm();
        let inverse_range = 1.0 / range;
        Self { unit: los * inverse_range, range, inverse_range }
    }
}

/// Which of the receiver's clock terms an observable contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The bias `c dt`, m.
    Bias,
    /// The drift `c d(dt)/dt`, m/s.
    Drift,
}

/// What an observation is expected to be, but for the receiver's clock, which adds the same to all.
///
/// A researcher's own observable implements the three functions of the line of sight; every solver
/// takes it.
pub trait ObservationModel {
    /// The clock term it contains.
    const CLOCK: Clock;

    /// Value for a receiver at rest, without its clock.
    fn value(satellite: &Satellite, sight: &LineOfSight) -> f64;

    /// Gradient of the value by the receiver's position.
    fn gradient(satellite: &Satellite, sight: &LineOfSight, value: f64) -> Vector3<f64>;

    /// Second derivative of the value along `along` (m), from `slope`, the gradient along it.
    fn curvature(sight: &LineOfSight, value: f64, slope: f64, along: &Vector3<f64>) -> f64;

    /// Value for a receiver at rest at `receiver_m` (ECEF), without its clock.
    #[inline]
    fn predict(satellite: &Satellite, receiver_m: &Vector3<f64>) -> f64 {
        Self::value(satellite, &LineOfSight::new(satellite, receiver_m))
    }

    /// The same and its gradient by the receiver's position.
    #[inline]
    fn linearise(satellite: &Satellite, receiver_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let sight = LineOfSight::new(satellite, receiver_m);
        let value = Self::value(satellite, &sight);
        (value, Self::gradient(satellite, &sight, value))
    }
}

/// Pseudorange, m.
#[derive(Clone, Copy, Debug)]
pub struct Pseudorange;

/// Doppler as range rate `-lambda D`, m/s.
#[derive(Clone, Copy, Debug)]
pub struct Doppler;

impl ObservationModel for Pseudorange {
    const CLOCK: Clock = Clock::Bias;

    #[inline]
    fn value(_: &Satellite, sight: &LineOfSight) -> f64 {
        sight.range
    }

    #[inline]
    fn gradient(_: &Satellite, sight: &LineOfSight, _: f64) -> Vector3<f64> {
        -sight.unit
    }

    #[inline]
    fn curvature(sight: &LineOfSight, _: f64, slope: f64, along: &Vector3<f64>) -> f64 {
        (along.norm_squared() - slope * slope) * sight.inverse_range
    }
}

impl ObservationModel for Doppler {
    const CLOCK: Clock = Clock::Drift;

    #[inline]
    fn value(satellite: &Satellite, sight: &LineOfSight) -> f64 {
        sight.unit.dot(&satellite.velocity_mps)
    }

    #[inline]
    fn gradient(satellite: &Satellite, sight: &LineOfSight, value: f64) -> Vector3<f64> {
        (sight.unit * value - satellite.velocity_mps) * sight.inverse_range
    }

    #[inline]
    fn curvature(sight: &LineOfSight, value: f64, slope: f64, along: &Vector3<f64>) -> f64 {
        let p = sight.unit.dot(along);
        let turned = (along.norm_squared() - p * p) * sight.inverse_range;
        (2.0 * slope * p - value * turned) * sight.inverse_range
    }
}
