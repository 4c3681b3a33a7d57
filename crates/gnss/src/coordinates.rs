//! Earth-fixed, geodetic and local coordinates on WGS 84.

use super::constants::{WGS84_A, WGS84_F};
use nalgebra::{Matrix3, Vector3};

/// A position on WGS 84.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// Geodetic latitude, rad, north positive.
    pub latitude: f64,
    /// Longitude, rad, east positive, in (-pi, pi].
    pub longitude: f64,
    /// Height above the ellipsoid, m.
    pub height: f64,
}

impl Geodetic {
    /// From degrees and metres above the ellipsoid.
    pub fn from_degrees(latitude_deg: f64, longitude_deg: f64, height_m: f64) -> Self {
        Self {
            latitude: latitude_deg.to_radians(),
            longitude: longitude_deg.to_radians(),
            height: height_m,
        }
    }

    /// From Earth-centred Earth-fixed metres (Bowring 1985; better than 1e-6 m from the ground to
    /// GNSS orbits). The centre of the Earth maps to latitude 0, height -a.
    pub fn from_ecef(ecef_m: &Vector3<f64>) -> Self {
        let e2 = WGS84_F * (2.0 - WGS84_F);
        let p = ecef_m.x.hypot(ecef_m.y);
        let longitude = ecef_m.y.atan2(ecef_m.x);
        let r = ecef_m.norm();
        if r < 1.0 {
            return Self { latitude: 0.0, longitude: 0.0, height: r - WGS84_A };
        }
        let b = WGS84_A * (1.0 - WGS84_F);
        // Parametric latitude, then two rounds of Bowring's formula.
        let mut u = (b * ecef_m.z * (1.0 + e2 / (1.0 - e2) * b / r)).atan2(WGS84_A * p);
        let mut latitude = 0.0;
        for _ in 0..2 {
            let (s, c) = u.sin_cos();
            latitude =
                (ecef_m.z + e2 / (1.0 - e2) * b * s.powi(3)).atan2(p - e2 * WGS84_A * c.powi(3));
            u = ((1.0 - WGS84_F) * latitude.sin()).atan2(latitude.cos());
        }
        let (s, c) = latitude.sin_cos();
        let height = p * c + ecef_m.z * s - WGS84_A * (1.0 - e2 * s * s).sqrt();
        Self { latitude, longitude, height }
    }

    /// To Earth-centred Earth-fixed metres.
    pub fn to_ecef(self) -> Vector3<f64> {
        let e2 = WGS84_F * (2.0 - WGS84_F);
        let (s, c) = self.latitude.sin_cos();
        let n = WGS84_A / (1.0 - e2 * s * s).sqrt();
        Vector3::new(
            (n + self.height) * c * self.longitude.cos(),
            (n + self.height) * c * self.longitude.sin(),
            (n * (1.0 - e2) + self.height) * s,
        )
    }

    /// Rotation that takes an ECEF difference vector to (east, north, up) at this position.
    pub fn ecef_to_enu(self) -> Matrix3<f64> {
        let (sp, cp) = self.latitude.sin_cos();
        let (sl, cl) = self.longitude.sin_cos();
        Matrix3::new(-sl, cl, 0.0, -sp * cl, -sp * sl, cp, cp * cl, cp * sl, sp)
    }
}

/// Azimuth (rad, from north over east, in [0, 2 pi)) and elevation (rad) of a target seen from a
/// position, both in ECEF metres.
pub fn azimuth_elevation(observer_m: &Vector3<f64>, target_m: &Vector3<f64>) -> (f64, f64) {
    let enu = Geodetic::from_ecef(observer_m).ecef_to_enu() * (target_m - observer_m);
    let azimuth = enu.x.atan2(enu.y).rem_euclid(std::f64::consts::TAU);
    (azimuth, enu.z.atan2(enu.x.hypot(enu.y)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_published_site_maps_to_its_ecef_coordinates() {
        let p = Geodetic::from_degrees(35.681298, 139.766247, 10.0).to_ecef();
        // Truth printed to 0.1 m and 1e-6 deg (0.1 m).
        assert!((p - Vector3::new(-3_959_617.5, 3_350_136.6, 3_699_531.5)).norm() < 0.3);
    }

    proptest! {
        #[test]
        fn geodetic_and_ecef_are_inverse(lat in -90.0f64..90.0, lon in -179.9f64..180.0, h in -5e3f64..3e7) {
            let position = Geodetic::from_degrees(lat, lon, h);
            let ecef = position.to_ecef();
            let back = Geodetic::from_ecef(&ecef);
            // 1e-6 m, plus rounding of 3e7 m in double precision.
            prop_assert!((back.to_ecef() - ecef).norm() < 1e-6);
            prop_assert!((back.height - h).abs() < 1e-6);
            let enu = position.ecef_to_enu();
            prop_assert!((enu * enu.transpose() - Matrix3::identity()).norm() < 1e-14);
            let up = Geodetic { height: h + 100.0, ..position }.to_ecef();
            prop_assert!(azimuth_elevation(&ecef, &up).1 > std::f64::consts::FRAC_PI_2 - 1e-4);
        }
    }
}
