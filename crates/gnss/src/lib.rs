//! Signals, messages and orbits of GNSS satellites, with constants, time, coordinates, observations, antennas and
//! file formats.
//!
//! Everything here is a plain value or a pure function of plain values; nothing depends on samples or receivers.

pub mod antenna;
pub mod atmosphere;
pub mod checked;
pub mod coordinates;
pub mod format;
pub mod galileo_data;
pub mod message;
pub mod navigation_data;
pub mod observation;
pub mod orbit;
pub mod random;
pub mod satellite;
pub mod signal;
pub mod time;
mod utc;

pub use format::ReadError;
pub use navigation_data::NavigationData;
pub use orbit::Orbit;
pub use orbit::broadcast::{Ephemeris, SatelliteState};
pub use orbit::glonass::GlonassEphemeris;
pub use satellite::{Constellation, Sv};
pub use signal::{Signal, Transmission};
pub use time::GpsTime;

/// Physical constants, each with unit and source.
pub mod constants {
    /// Speed of light in vacuum, m/s (exact, SI; IS-GPS-200N 20.3.4.3).
    pub const SPEED_OF_LIGHT: f64 = 299_792_458.0;
    /// WGS 84 gravitational constant of the Earth for GPS users, m^3/s^2 (IS-GPS-200N table 20-IV).
    pub const MU_EARTH: f64 = 3.986_005e14;
    /// Gravitational constant of the Earth for Galileo users, m^3/s^2 (Galileo OS SIS ICD 2.1, 5.1.1).
    pub const MU_EARTH_GALILEO: f64 = 3.986_004_418e14;
    /// WGS 84 rotation rate of the Earth, rad/s (IS-GPS-200N table 20-IV; Galileo OS SIS ICD 2.1, 5.1.1).
    pub const OMEGA_EARTH: f64 = 7.292_115_146_7e-5;
    /// The same of BeiDou (CGCS2000, BDS-SIS-ICD-B1I-3.0 table 5-11) and of GLONASS (PZ-90.11, ICD L1, L2 edition 5.1
    /// table 3.2), rad/s.
    pub const OMEGA_EARTH_BEIDOU: f64 = 7.292_115e-5;
    /// Ratio used by the GPS control segment for pi (IS-GPS-200N 20.3.3.4.3): semicircle in rad.
    #[expect(
        clippy::approx_constant,
        reason = "the control segment rounds pi to 13 decimals, and so must users"
    )]
    pub const GPS_PI: f64 = 3.141_592_653_589_8;
    /// Relativistic clock constant F = -2 sqrt(mu)/c^2, s/sqrt(m) (IS-GPS-200N 20.3.3.3.3.1).
    pub const RELATIVISTIC_F: f64 = -4.442_807_633e-10;
    /// The same of Galileo (OS SIS ICD 2.1, 5.1.4).
    pub const RELATIVISTIC_F_GALILEO: f64 = -4.442_807_309e-10;
    /// Mean radius of the Earth used for cold starts, m (`psi` of Morichi et al. 2026).
    pub const EARTH_RADIUS: f64 = 6.371e6;
    /// WGS 84 semi-major axis, m (NGA.STND.0036).
    pub const WGS84_A: f64 = 6_378_137.0;
    /// WGS 84 flattening (NGA.STND.0036).
    pub const WGS84_F: f64 = 1.0 / 298.257_223_563;

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn derived_constants_agree_with_their_definitions() {
            // Printed to ten digits in IS-GPS-200N.
            assert!(
                (RELATIVISTIC_F + 2.0 * MU_EARTH.sqrt() / SPEED_OF_LIGHT.powi(2)).abs() < 5e-20
            );
            let of_galileo = -2.0 * MU_EARTH_GALILEO.sqrt() / SPEED_OF_LIGHT.powi(2);
            assert!((RELATIVISTIC_F_GALILEO - of_galileo).abs() < 5e-20);
            assert!((GPS_PI - std::f64::consts::PI).abs() < 5e-14);
            // One sidereal day, 86164.1 s.
            assert!((2.0 * std::f64::consts::PI / OMEGA_EARTH - 86_164.1).abs() < 0.05);
        }
    }
}
