//! BeiDou B1I (BDS-SIS-ICD-B1I-3.0) with the messages D1 and D2.

use super::{Carrier, Modulation, Overlay, Signal, Symbols};
use crate::Constellation;
/// Geostationary satellites send D2: 500 bit/s and no secondary code.
use crate::satellite::is_beidou_geo as sends_d2;

const CHIPS: usize = 2046;
const STAGES: usize = 11;

/// Stages of G2, counted from 1, whose sum is added to G1, of PRN 1 to 63 (table 4-1).
#[rustfmt::skip]
const G2_STAGES: [&[usize]; 63] = [
    &[1, 3], &[1, 4], &[1, 5], &[1, 6], &[1, 8], &[1, 9], &[1, 10], &[1, 11], &[2, 7], &[3, 4], &[3, 5], &[3, 6], &[3, 8], &[3, 9], &[3, 10], &[3, 11], &[4, 5], &[4, 6], &[4, 8], &[4, 9], &[4, 10], &[4, 11], &[5, 6], &[5, 8], &[5, 9], &[5, 10], &[5, 11], &[6, 8], &[6, 9], &[6, 10], &[6, 11], &[8, 9], &[8, 10], &[8, 11], &[9, 10], &[9, 11], &[10, 11], &[1, 2, 7], &[1, 3, 4], &[1, 3, 6], &[1, 3, 8], &[1, 3, 10], &[1, 3, 11], &[1, 4, 5], &[1, 4, 9], &[1, 5, 6], &[1, 5, 8], &[1, 5, 10], &[1, 5, 11], &[1, 6, 9], &[1, 8, 9], &[1, 9, 10], &[1, 9, 11], &[2, 3, 7], &[2, 5, 7], &[2, 7, 9], &[3, 4, 5], &[3, 4, 9], &[3, 5, 6], &[3, 5, 8], &[3, 5, 10], &[3, 5, 11], &[3, 6, 9],
];

/// Secondary code NH20 of the message D1, 00000100110101001110: a chip a code period, aligned with the bit.
const NH20: [i8; 20] = [1, 1, 1, 1, 1, -1, 1, 1, -1, -1, 1, -1, 1, -1, 1, 1, -1, -1, -1, 1];

fn code(number: u8) -> Option<Box<[i8]>> {
    let stages = *G2_STAGES.get(usize::from(number.checked_sub(1)?))?;
    // G1 = 1 + x + x^7 + x^8 + x^9 + x^10 + x^11, G2 = 1 + x + x^2 + x^3 + x^4 + x^5 + x^8 + x^9 + x^11.
    let g1 = shift_register(&[1, 7, 8, 9, 10, 11], &[11]);
    let g2 = shift_register(&[1, 2, 3, 4, 5, 8, 9, 11], stages);
    Some(g1.zip(g2).map(|(a, b)| 1 - 2 * (a ^ b)).take(CHIPS).collect())
}

/// Sums of the stages `outputs` of a register that starts at 01010101010 and feeds back the sum of `taps`.
fn shift_register(taps: &[usize], outputs: &[usize]) -> impl Iterator<Item = i8> {
    let mut register: [i8; STAGES] = std::array::from_fn(|k| (k % 2) as i8);
    std::iter::repeat_with(move || {
        let sum = |of: &[usize]| of.iter().fold(0, |sum, &stage| sum ^ register[stage - 1]);
        let (output, feedback) = (sum(outputs), sum(taps));
        register.rotate_right(1);
        register[0] = feedback;
        output
    })
}

/// BeiDou B1I. Its messages are not decoded here.
pub static BEIDOU_B1I: Signal = Signal {
    name: "BeiDou B1I",
    rinex: "2I",
    constellation: Constellation::BeiDou,
    carrier: Carrier::Fixed(1_561.098e6),
    chip_rate_hz: 2.046e6,
    chips: CHIPS,
    code,
    modulation: Modulation::Bpsk,
    overlay: Overlay::PerSatellite(|number| (!sends_d2(number)).then(|| NH20.into())),
    symbols: |number| {
        Some(Symbols { periods: if sends_d2(number) { 2 } else { NH20.len() }, decoder: None })
    },
    partner: None,
    power_fraction: 1.0,
    phase_cycles: 0.0,
};

#[cfg(test)]
mod tests {
    use super::super::code_vectors::check_all;
    use super::*;
    use crate::{Sv, Transmission};

    #[test]
    fn all_codes_equal_the_vectors_of_others() {
        check_all("B1I", BEIDOU_B1I.code, 1..=63);
    }

    #[test]
    fn geostationary_satellites_send_no_secondary_code_and_two_periods_a_bit() {
        let of = |name: &str| {
            let transmission =
                Transmission { sv: name.parse::<Sv>().unwrap(), signal: &BEIDOU_B1I };
            (transmission.timing().cycle, transmission.overlay().map(|chips| chips.len()))
        };
        assert_eq!([of("C05"), of("C06")], [(2, None), (20, Some(20))]);
        let bits: String = NH20.iter().map(|&chip| if chip < 0 { '1' } else { '0' }).collect();
        assert_eq!(bits, "00000100110101001110");
        assert_eq!(BEIDOU_B1I.period_s(), 1e-3);
    }
}
