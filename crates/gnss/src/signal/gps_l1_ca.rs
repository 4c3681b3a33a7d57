//! GPS L1 C/A (IS-GPS-200N 3.2.1.3, 3.3).

use super::ca_code::ca_code;
use super::{Carrier, L1_CENTRE_HZ, Modulation, Overlay, Signal, Symbols};
use crate::Constellation;
use crate::message::lnav::FrameDecoder;

/// G2 delay in chips by PRN 1..=32 (IS-GPS-200N table 3-Ia).
const G2_DELAY: [u16; 32] = [
    5, 6, 7, 8, 17, 18, 139, 140, 141, 251, 252, 254, 255, 256, 257, 258, 469, 470, 471, 472, 473,
    474, 509, 512, 513, 514, 515, 516, 859, 860, 861, 862,
];

/// GPS L1 C/A.
pub static GPS_L1_CA: Signal = SIGNAL;

/// What QZSS and SBAS send too, but for the codes and the message.
pub(super) const SIGNAL: Signal = Signal {
    name: "GPS L1 C/A",
    rinex: "1C",
    constellation: Constellation::Gps,
    carrier: Carrier::Fixed(L1_CENTRE_HZ),
    chip_rate_hz: 1.023e6,
    chips: super::ca_code::CHIPS,
    code: |number| ca_code(&G2_DELAY, number.checked_sub(1)?),
    modulation: Modulation::Bpsk,
    overlay: Overlay::None,
    symbols: |_| Some(Symbols { periods: 20, decoder: Some(|| Box::new(FrameDecoder::new())) }),
    partner: None,
    power_fraction: 1.0,
    phase_cycles: 0.0,
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Sv;

    /// IS-GPS-200N table 3-Ia, "first 10 chips, octal".
    const FIRST_CHIPS_OCTAL: [u16; 32] = [
        0o1440, 0o1620, 0o1710, 0o1744, 0o1133, 0o1455, 0o1131, 0o1454, 0o1626, 0o1504, 0o1642,
        0o1750, 0o1764, 0o1772, 0o1775, 0o1776, 0o1156, 0o1467, 0o1633, 0o1715, 0o1746, 0o1763,
        0o1063, 0o1706, 0o1743, 0o1761, 0o1770, 0o1774, 0o1127, 0o1453, 0o1625, 0o1712,
    ];

    #[test]
    fn first_ten_chips_are_those_of_the_interface_specification() {
        for (sv, octal) in Sv::all_gps().zip(FIRST_CHIPS_OCTAL) {
            let code = (GPS_L1_CA.code)(sv.number()).unwrap();
            let bits = code[..10].iter().fold(0, |word, &c| word << 1 | u16::from(c < 0));
            assert_eq!(bits, octal, "{sv}");
        }
    }
}
