//! Which types of observations belong to which signals.

use crate::signal::{
    BEIDOU_B1C_DATA, BEIDOU_B1C_PILOT, BEIDOU_B1I, GALILEO_E1B, GALILEO_E1C, GLONASS_L1OF,
    GPS_L1_CA, GPS_L1C_D, GPS_L1C_P, QZSS_L1_CA, Signal,
};

/// A signal, and its types of observations without their first letter.
pub(super) struct Names {
    pub signal: &'static Signal,
    /// Letter of its system.
    pub system: char,
    /// From version 3 on: band and attribute, the preferred first (RINEX 3.04 tables 4 to 9). Receivers that sum data and
    /// pilot name both X.
    pub modern: &'static [&'static str],
    /// Of version 2: of code, preferred first, then those of phase, Doppler and strength; empty where that has none.
    pub old: &'static [&'static str],
}

const fn names(
    signal: &'static Signal,
    system: char,
    modern: &'static [&'static str],
    old: &'static [&'static str],
) -> Names {
    Names { signal, system, modern, old }
}

/// All signals that are read, in the order in which records are searched for them.
pub(super) static ALL: [Names; 10] = [
    names(&GPS_L1_CA, 'G', &["1C"], &["C1", "P1"]),
    names(&GPS_L1C_P, 'G', &["1L", "1X"], &[]),
    names(&GPS_L1C_D, 'G', &["1S"], &[]),
    names(&QZSS_L1_CA, 'J', &["1C"], &["C1", "P1"]),
    names(&GALILEO_E1C, 'E', &["1C", "1X", "1Z"], &["C1"]),
    names(&GALILEO_E1B, 'E', &["1B"], &[]),
    // 1I is the name of version 3.02.
    names(&BEIDOU_B1I, 'C', &["2I", "1I"], &[]),
    names(&BEIDOU_B1C_PILOT, 'C', &["1P", "1X"], &[]),
    names(&BEIDOU_B1C_DATA, 'C', &["1D"], &[]),
    names(&GLONASS_L1OF, 'R', &["1C"], &["C1"]),
];
