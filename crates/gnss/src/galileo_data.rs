//! What Galileo sends beside ephemerides: health, group delays and accuracy of its satellites, and the models of its
//! system.

use crate::utc::UtcParameters;
use crate::{GpsTime, Sv};
use std::collections::BTreeMap;

/// Health of the signals with I/NAV. Health status: 0 good, 1 out of service, 2 will be out of service, 3 in test
/// (Galileo OS SIS ICD 2.1, 5.1.9.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GalileoHealth {
    /// Health status of E5b.
    pub e5b_status: u8,
    /// Health status of E1-B and E1-C.
    pub e1b_status: u8,
    /// Whether the data of E5b are sent without guarantee.
    pub e5b_not_valid: bool,
    /// Whether the data of E1-B are sent without guarantee.
    pub e1b_not_valid: bool,
}

impl GalileoHealth {
    /// The three bits of E1-B as RINEX orders them (3.04 table A8): data validity in bit 0, health status in bits 1
    /// and 2. Zero is good.
    pub fn e1b_word(self) -> u8 {
        self.e1b_status << 1 | u8::from(self.e1b_not_valid)
    }
}

/// Newest state of a Galileo satellite by words 3 and 5 of its own I/NAV.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GalileoStatus {
    /// Accuracy of orbit and clock SISA(E1, E5b), m; none where it is not stated.
    pub sisa_m: Option<f64>,
    /// Group delay BGD(E1, E5a), s: that of the clock of F/NAV.
    pub bgd_e1_e5a: f64,
    /// Group delay BGD(E1, E5b), s: that of the clock of I/NAV, and `tgd` of the ephemeris.
    pub bgd_e1_e5b: f64,
    /// Health.
    pub health: GalileoHealth,
}

/// Effective ionisation level of NeQuick G, the ionosphere model of Galileo (OS SIS ICD 5.1.6).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NequickCoefficients {
    /// A constant, a term per degree and one per square degree of the modified dip latitude, solar flux units. All
    /// zero: not known, 63.7 is to be used.
    pub ai: [f64; 3],
    /// Ionospheric disturbance flags of the regions 1 to 5, region 1 as the highest of five bits.
    pub storm_flags: u8,
}

/// Galileo System Time (GST) minus GPS time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GalileoGpsOffset {
    /// At the reference time, s.
    pub a0: f64,
    /// Its rate, s/s.
    pub a1: f64,
    /// Reference time.
    pub t0: GpsTime,
}

impl GalileoGpsOffset {
    /// GST minus GPS time at `t`, s.
    pub fn at(&self, t: GpsTime) -> f64 {
        self.a0 + self.a1 * (t - self.t0)
    }
}

/// What the satellites of Galileo say of their system and of themselves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GalileoData {
    /// Ionosphere model, if known.
    pub nequick: Option<NequickCoefficients>,
    /// GST against UTC, if known: as those of GPS, of GST in place of GPS time.
    pub utc: Option<UtcParameters>,
    /// GST against GPS time, if it is sent.
    pub gps_offset: Option<GalileoGpsOffset>,
    /// State of each satellite.
    pub status: BTreeMap<Sv, GalileoStatus>,
}

impl GalileoData {
    /// Adds all of `other`, which replaces ours where it has something.
    pub(crate) fn merge(&mut self, other: Self) {
        self.nequick = other.nequick.or(self.nequick);
        self.utc = other.utc.or(self.utc);
        self.gps_offset = other.gps_offset.or(self.gps_offset);
        self.status.extend(other.status);
    }
}
