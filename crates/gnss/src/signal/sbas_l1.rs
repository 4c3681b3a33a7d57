//! SBAS L1 (RTCA DO-229 Appendix A): codes of GPS's family, and a message of 500 symbols/s.

use super::ca_code::ca_code;
use super::{Signal, Symbols, gps_l1_ca};
use crate::Constellation;
use crate::message::sbas::SbasDecoder;

/// G2 delay in chips by PRN 120..=158 (IS-GPS-200N table 6-I).
const G2_DELAY: [u16; 39] = [
    145, 175, 52, 21, 237, 235, 886, 657, 634, 762, 355, 1012, 176, 603, 130, 359, 595, 68, 386,
    797, 456, 499, 883, 307, 127, 211, 121, 118, 163, 628, 853, 484, 289, 811, 202, 1021, 463, 568,
    904,
];

/// SBAS L1.
pub static SBAS_L1: Signal = Signal {
    name: "SBAS L1",
    constellation: Constellation::Sbas,
    code: |number| ca_code(&G2_DELAY, number.checked_sub(20)?),
    symbols: |_| Some(Symbols { periods: 2, decoder: Some(|| Box::new(SbasDecoder::new())) }),
    ..gps_l1_ca::SIGNAL
};
