//! Satellites and receivers: Walker shells, receivers on the ground, orbits brought down along the line of sight,
//! and observations.

use nalgebra::Vector3;
use sdr_rx::gnss::constants::{EARTH_RADIUS, OMEGA_EARTH};
use sdr_rx::gnss::coordinates::azimuth_elevation;
use sdr_rx::position::{Row, RowKind, Satellite};

/// Gravitational constant of the Earth, m^3/s^2 (WGS 84).
const MU: f64 = 3.986_004_418e14;

/// Walker's delta pattern i: T/P/F of circular orbits (Walker 1984).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shell {
    /// T: satellites.
    pub satellites: u32,
    /// P: planes.
    pub planes: u32,
    /// F: phasing.
    pub phasing: u32,
    /// Inclination, deg.
    pub inclination_deg: f64,
    /// Radius of the orbits, m.
    pub radius_m: f64,
}

impl Shell {
    /// Galileo in the paper: 24/3/1, 56 deg, 29 600 km.
    pub const GALILEO: Self =
        Self { satellites: 24, planes: 3, phasing: 1, inclination_deg: 56.0, radius_m: 29.6e6 };
    /// GPS-like: 24/6/1, 55 deg, 26 560 km.
    pub const GPS: Self =
        Self { satellites: 24, planes: 6, phasing: 1, inclination_deg: 55.0, radius_m: 26.56e6 };
    /// Starlink's first shell: 1584/72/39, 53 deg, 550 km.
    pub const STARLINK: Self = Self {
        satellites: 1584,
        planes: 72,
        phasing: 39,
        inclination_deg: 53.0,
        radius_m: EARTH_RADIUS + 550e3,
    };
    /// OneWeb-like: 648/18/1, 87.9 deg, 1200 km.
    pub const ONEWEB: Self = Self {
        satellites: 648,
        planes: 18,
        phasing: 1,
        inclination_deg: 87.9,
        radius_m: EARTH_RADIUS + 1200e3,
    };

    /// State of satellite `k` in the Earth-fixed frame `t` seconds after that was aligned.
    pub fn state(&self, k: u32, t: f64) -> Satellite {
        let (plane, slot) =
            (k / (self.satellites / self.planes), k % (self.satellites / self.planes));
        let turn = std::f64::consts::TAU;
        let ratio = |a: u32, b: u32| f64::from(a) / f64::from(b);
        let rate = (MU / self.radius_m.powi(3)).sqrt();
        let phase = ratio(slot, self.satellites / self.planes)
            + ratio(plane * self.phasing, self.satellites);
        let (sin_u, cos_u) = (turn * phase + rate * t).sin_cos();
        let (sin_o, cos_o) = (turn * ratio(plane, self.planes) - OMEGA_EARTH * t).sin_cos();
        let (sin_i, cos_i) = self.inclination_deg.to_radians().sin_cos();
        let turned = |x: f64, y: f64| {
            let (y, z) = (y * cos_i, y * sin_i);
            self.radius_m * Vector3::new(x * cos_o - y * sin_o, x * sin_o + y * cos_o, z)
        };
        let position_m = turned(cos_u, sin_u);
        let inertial_mps = rate * turned(-sin_u, cos_u);
        let earth = Vector3::new(0.0, 0.0, OMEGA_EARTH);
        Satellite { position_m, velocity_mps: inertial_mps - earth.cross(&position_m) }
    }

    /// Numbers and states of the satellites above `mask` (rad) at `receiver_m` (ECEF).
    pub fn in_view(&self, t: f64, receiver_m: &Vector3<f64>, mask: f64) -> Vec<(u32, Satellite)> {
        let all = (0..self.satellites).map(|k| (k, self.state(k, t)));
        all.filter(|(_, s)| azimuth_elevation(receiver_m, &s.position_m).1 >= mask).collect()
    }
}

/// A satellite brought to the orbit radius `radius_m` along the line of sight, its speed that of a circular
/// orbit there, its direction of flight kept (the paper, eq. 14).
pub fn scaled_down(satellite: &Satellite, receiver_m: &Vector3<f64>, radius_m: f64) -> Satellite {
    let u = (satellite.position_m - receiver_m).normalize();
    let along = u.dot(receiver_m);
    let range = (along * along + radius_m.powi(2) - receiver_m.norm_squared()).sqrt() - along;
    let speed = (satellite.position_m.norm() / radius_m).sqrt();
    Satellite { position_m: receiver_m + range * u, velocity_mps: satellite.velocity_mps * speed }
}

/// The hundred heights, m: 160 to 2000 km in steps of 31 km, then to 20 200 km in steps of 455 km.
pub fn altitudes_m() -> Vec<f64> {
    let low = (0..60).map(|k| 160e3 + 1840e3 / 59.0 * f64::from(k));
    low.chain((1..=40).map(|k| 2000e3 + 455e3 * f64::from(k))).collect()
}

/// Observations of `satellites` from `receiver_m` with an error of standard deviation `sigma` each, which they
/// do not tell, of which `error` gives a value of unit variance for each index.
pub fn observe(
    kind: RowKind,
    satellites: impl Iterator<Item = Satellite>,
    receiver_m: &Vector3<f64>,
    sigma: f64,
    error: impl Fn(usize) -> f64,
) -> Vec<Row> {
    satellites
        .enumerate()
        .map(|(k, s)| Row::new(kind, s, kind.see(&s, receiver_m).value + sigma * error(k)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn satellites_fly_on_circles_and_come_down_along_the_line_of_sight() {
        let receiver = Vector3::new(4.4e6, 6e5, 4.5e6);
        for shell in [Shell::GALILEO, Shell::STARLINK] {
            for k in [0, 7, shell.satellites - 1] {
                let at = |t: f64| shell.state(k, t).position_m;
                let satellite = shell.state(k, 500.0);
                assert!((satellite.position_m.norm() / shell.radius_m - 1.0).abs() < 1e-14);
                // Truncation of the central difference: v^3/(6 a^2) h^2, at most 2e-3 m/s for h = 1 s.
                let difference = (at(501.0) - at(499.0)) / 2.0;
                assert!((difference - satellite.velocity_mps).norm() < 2e-3);
                let low = scaled_down(&satellite, &receiver, 7e6);
                let [a, b] = [low, satellite].map(|s| (s.position_m - receiver).normalize());
                assert!((a - b).norm() < 1e-12 && (low.position_m.norm() - 7e6).abs() < 1e-6);
            }
        }
        let heights = altitudes_m();
        assert!(heights.len() == 100 && heights.is_sorted());
        assert!((heights[59] - 2000e3).abs() < 1e-6 && heights[99] == 20_200e3);
    }
}
