//! What the broadcast models of the satellite systems differ by.

use crate::Constellation;
use crate::constants::{
    MU_EARTH, MU_EARTH_GALILEO, OMEGA_EARTH, OMEGA_EARTH_BEIDOU, RELATIVISTIC_F,
    RELATIVISTIC_F_GALILEO,
};

/// Constants of a system whose satellites send Keplerian elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SystemModel {
    /// Gravitational constant of the Earth, m^3/s^2.
    pub mu: f64,
    /// Rotation rate of the Earth, rad/s.
    pub omega_earth: f64,
    /// Relativistic clock constant, s/sqrt(m).
    pub relativistic_f: f64,
    /// GPS time minus the time of the system, whole s.
    pub behind_gps_s: f64,
    /// GPS week of the system's week 0 as RINEX counts weeks.
    pub first_week: i32,
    /// How far from its reference time an ephemeris may be used, s, where it does not state that.
    pub half_fit_interval_s: f64,
    /// Standard deviation of a range by orbit, clock and group delay at the usual accuracy, m.
    pub range_sigma_m: f64,
    /// The accuracy that is usually stated, as the bound of its index, m.
    pub usual_ura_m: f64,
}

/// IS-GPS-200N. Errors of orbits and clocks of all systems: 0.6 m GPS, 0.2 m Galileo, 1 m BeiDou, 2 m GLONASS
/// (Montenbruck, Steigenberger & Hauschild, "Multi-GNSS signal-in-space range error assessment", Adv. Space Res. 61,
/// 2018); with 0.35 m of group delay each.
const GPS: SystemModel = SystemModel {
    mu: MU_EARTH,
    omega_earth: OMEGA_EARTH,
    relativistic_f: RELATIVISTIC_F,
    behind_gps_s: 0.0,
    first_week: 0,
    half_fit_interval_s: 2.0 * 3600.0,
    range_sigma_m: 0.7,
    usual_ura_m: 2.4,
};

/// Galileo OS SIS ICD 2.1; SISA is 3.12 m.
const GALILEO: SystemModel = SystemModel {
    mu: MU_EARTH_GALILEO,
    relativistic_f: RELATIVISTIC_F_GALILEO,
    half_fit_interval_s: 4.0 * 3600.0,
    range_sigma_m: 0.4,
    usual_ura_m: 3.4,
    ..GPS
};

/// BDS-SIS-ICD-B1I-3.0 tables 5-10 and 5-11: ephemerides change every hour.
const BEIDOU: SystemModel = SystemModel {
    mu: MU_EARTH_GALILEO,
    relativistic_f: RELATIVISTIC_F_GALILEO,
    omega_earth: OMEGA_EARTH_BEIDOU,
    behind_gps_s: 14.0,
    first_week: 1356,
    range_sigma_m: 1.1,
    ..GPS
};

impl Constellation {
    /// The constants of the system's broadcast model.
    pub(crate) const fn model(self) -> &'static SystemModel {
        match self {
            Self::Galileo => &GALILEO,
            Self::BeiDou => &BEIDOU,
            Self::Gps | Self::Qzss | Self::Sbas | Self::Glonass => &GPS,
        }
    }
}
