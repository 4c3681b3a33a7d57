//! Satellite geometries for Monte Carlo: Walker constellations, receivers on and above the Earth, random satellites in
//! view.

use nalgebra::Vector3;
use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, UnitSphere};
use sdr_rx::gnss::constants::EARTH_RADIUS;
use sdr_rx::gnss::coordinates::{Geodetic, azimuth_elevation};
use sdr_rx::position::{Row, RowKind, Satellite};
use std::ops::RangeInclusive;

const EARTH_RATE: f64 = 7.292_115e-5;
const MU_EARTH: f64 = 3.986_004_418e14;

/// A Walker delta constellation `satellites/planes/phasing` on circular orbits.
#[derive(Clone, Copy)]
pub struct Walker {
    pub satellites: u32,
    pub planes: u32,
    pub phasing: u32,
    pub inclination_deg: f64,
    pub radius_m: f64,
}

impl Walker {
    /// The paper's, of Galileo's height.
    pub const GALILEO_LIKE: Self = Self::new(24, 3, 1, 56.0, 29.6e6);
    pub const STARLINK_LIKE: Self = Self::new(1584, 72, 39, 53.0, EARTH_RADIUS + 550e3);
    pub const ONEWEB_LIKE: Self = Self::new(648, 18, 1, 87.9, EARTH_RADIUS + 1200e3);

    const fn new(
        sats: u32,
        planes: u32,
        phasing: u32,
        inclination_deg: f64,
        radius_m: f64,
    ) -> Self {
        Self { satellites: sats, planes, phasing, inclination_deg, radius_m }
    }

    /// Earth-fixed states `t` s after the constellation was aligned with the Earth.
    pub fn at(&self, t: f64) -> Vec<Satellite> {
        let per_plane = self.satellites / self.planes;
        let rate = (MU_EARTH / self.radius_m.powi(3)).sqrt();
        let (sin_i, cos_i) = self.inclination_deg.to_radians().sin_cos();
        (0..self.satellites)
            .map(|k| {
                let (plane, slot) = (f64::from(k / per_plane), f64::from(k % per_plane));
                let along = 360.0 / f64::from(per_plane) * slot
                    + 360.0 * f64::from(self.phasing) / f64::from(self.satellites) * plane;
                let node = (360.0 / f64::from(self.planes) * plane).to_radians() - EARTH_RATE * t;
                let (sin_u, cos_u) = (along.to_radians() + rate * t).sin_cos();
                let (sin_o, cos_o) = node.sin_cos();
                let turn = |x: f64, y: f64| {
                    let (y, z) = (y * cos_i, y * sin_i);
                    Vector3::new(x * cos_o - y * sin_o, x * sin_o + y * cos_o, z)
                };
                let position_m = self.radius_m * turn(cos_u, sin_u);
                let inertial = self.radius_m * rate * turn(-sin_u, cos_u);
                let earth = Vector3::new(0.0, 0.0, EARTH_RATE);
                Satellite { position_m, velocity_mps: inertial - earth.cross(&position_m) }
            })
            .collect()
    }
}

/// A satellite brought down to the orbit radius `radius_m` along the line of sight (paper, eq. 14).
pub fn scaled_down(satellite: &Satellite, receiver: &Vector3<f64>, radius_m: f64) -> Satellite {
    let u = (satellite.position_m - receiver).normalize();
    let along = u.dot(receiver);
    let range = (along * along + radius_m.powi(2) - receiver.norm_squared()).sqrt() - along;
    let speed = (satellite.position_m.norm() / radius_m).sqrt();
    Satellite { position_m: receiver + range * u, velocity_mps: satellite.velocity_mps * speed }
}

/// One draw: a receiver, and the satellites observed there.
pub struct Draw {
    pub truth: Vector3<f64>,
    pub satellites: Vec<Satellite>,
}

/// A constellation at random times of one day.
pub struct Skies(Vec<Vec<Satellite>>);

impl Skies {
    pub fn new(walker: &Walker, times: usize, rng: &mut ChaCha8Rng) -> Self {
        Self((0..times).map(|_| walker.at(rng.random_range(0.0..86_400.0))).collect())
    }

    /// A constellation at one time.
    pub fn at(walker: &Walker, t: f64) -> Self {
        Self(vec![walker.at(t)])
    }

    /// A receiver at a uniform direction, its height above the ellipsoid in `height_m`, with `count` random
    /// ones of the satellites above 5 degrees.
    pub fn draw(&self, rng: &mut ChaCha8Rng, height_m: RangeInclusive<f64>, count: usize) -> Draw {
        loop {
            let [x, y, z]: [f64; 3] = UnitSphere.sample(rng);
            let (latitude, longitude) = (z.asin(), y.atan2(x));
            let height = rng.random_range(height_m.clone());
            let truth = Geodetic { latitude, longitude, height }.to_ecef();
            let in_view =
                |s: &&Satellite| azimuth_elevation(&truth, &s.position_m).1 >= 5f64.to_radians();
            // Farther from the zenith than 80 degrees at the Earth's centre nothing is seen.
            let near = |s: &&Satellite| {
                s.position_m.dot(&truth) > 0.17 * s.position_m.norm() * truth.norm()
            };
            let sky = self.0.choose(rng).expect("at least one time");
            let view: Vec<Satellite> = sky.iter().filter(near).filter(in_view).copied().collect();
            if view.len() >= count {
                let satellites = view.sample(rng, count).copied().collect();
                return Draw { truth, satellites };
            }
        }
    }
}

impl Draw {
    /// With the satellites brought down to a random one of the paper's heights, 160 to 20 200 km.
    pub fn scaled_down(mut self, rng: &mut ChaCha8Rng) -> Self {
        let radius_m = EARTH_RADIUS + rng.random_range(160e3..20_200e3);
        for satellite in &mut self.satellites {
            *satellite = scaled_down(satellite, &self.truth, radius_m);
        }
        self
    }

    /// Observations with a clock term and white noise of standard deviation `sigma`, which they do not tell.
    pub fn observe(&self, kind: RowKind, rng: &mut ChaCha8Rng, clock: f64, sigma: f64) -> Vec<Row> {
        let observe = |s: &Satellite| {
            let noise: f64 = StandardNormal.sample(rng);
            Row::new(kind, *s, kind.see(s, &self.truth).value + clock + sigma * noise)
        };
        self.satellites.iter().map(observe).collect()
    }
}

/// The same rows with a standard deviation each.
pub fn weighted(rows: &[Row], sigma: f64) -> Vec<Row> {
    rows.iter().map(|row| row.with_sigma(sigma)).collect()
}
