//! A nominal constellation and stations for several tests. The Earth is a sphere here.

use super::{Constraints, Graph};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::f64::consts::TAU;

/// Radius of the Earth, m.
pub const EARTH_M: f64 = 6.371e6;

/// Position of a satellite of Walker 24/6/1 (55 deg, 26 560 km) at `time_s`, in a frame that turns with the Earth.
pub fn satellite_m(k: usize, time_s: f64) -> Vector3<f64> {
    let (plane, slot) = (k % 6, k / 6);
    let sidereal = TAU * time_s / 86_164.1;
    let node = TAU * plane as f64 / 6.0 - sidereal;
    let latitude = TAU * (slot as f64 / 4.0 + plane as f64 / 24.0) + 2.0 * sidereal;
    let (sin_i, cos_i) = 55f64.to_radians().sin_cos();
    let (s, c) = latitude.sin_cos();
    let (sin_n, cos_n) = node.sin_cos();
    2.656e7 * Vector3::new(c * cos_n - s * cos_i * sin_n, c * sin_n + s * cos_i * cos_n, s * sin_i)
}

/// Elevation of a satellite, rad.
pub fn elevation(station_m: &Vector3<f64>, satellite_m: &Vector3<f64>) -> f64 {
    (satellite_m - station_m).normalize().dot(&station_m.normalize()).asin()
}

/// A stream of random numbers of its own for each trial.
pub fn stream(seed: u64, trial: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(trial);
    random
}

/// A number of the standard normal distribution.
pub fn normal(random: &mut ChaCha8Rng) -> f64 {
    random.sample(StandardNormal)
}

/// A position on the globe within `spread` radii of another, or anywhere with a spread of infinity.
pub fn position_near(centre: &Vector3<f64>, spread: f64, random: &mut ChaCha8Rng) -> Vector3<f64> {
    let aside = Vector3::from_fn(|_, _| normal(random));
    if spread.is_infinite() {
        return aside.normalize() * EARTH_M;
    }
    (centre / EARTH_M + spread * aside).normalize() * EARTH_M
}

/// The nine nodes of the paper's figure 5.
pub fn nine() -> Constraints {
    let ring = [(0, 1), (1, 2), (2, 4), (2, 5), (2, 6), (2, 7), (1, 3), (3, 4), (4, 5), (5, 6)];
    let graph = Graph::new(9, &[&ring[..], &[(6, 8), (7, 8)]].concat()).unwrap();
    super::constraints::choose(&graph).unwrap()
}
