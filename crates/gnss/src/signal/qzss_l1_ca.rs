//! QZSS L1 C/A (IS-QZSS-PNT-005 3.2.2): GPS's signal with codes of its own.

use super::ca_code::ca_code;
use super::{Signal, gps_l1_ca};
use crate::Constellation;

/// G2 delay in chips by PRN 193..=202 (IS-QZSS-PNT-005 table 3.2.2-2).
const G2_DELAY: [u16; 10] = [339, 208, 711, 189, 263, 537, 663, 942, 173, 900];

/// QZSS L1 C/A.
pub static QZSS_L1_CA: Signal = Signal {
    name: "QZSS L1 C/A",
    constellation: Constellation::Qzss,
    code: |number| ca_code(&G2_DELAY, number.checked_sub(1)?),
    ..gps_l1_ca::SIGNAL
};
