//! The C/A codes of GPS, QZSS and SBAS.

use super::Sv;
use super::constants::CA_CODE_LENGTH;

/// G2 delay in chips by PRN 1..=32 (IS-GPS-200N table 3-Ia).
const G2_DELAY_GPS: [u16; 32] = [
    5, 6, 7, 8, 17, 18, 139, 140, 141, 251, 252, 254, 255, 256, 257, 258, 469, 470, 471, 472, 473,
    474, 509, 512, 513, 514, 515, 516, 859, 860, 861, 862,
];
/// G2 delay in chips by PRN 120..=138 (IS-GPS-200N table 6-I; WAAS code assignments).
const G2_DELAY_SBAS: [u16; 19] =
    [145, 175, 52, 21, 237, 235, 886, 657, 634, 762, 355, 1012, 176, 603, 130, 359, 595, 68, 386];
/// G2 delay in chips by PRN 193..=202 (IS-QZSS-PNT).
const G2_DELAY_QZSS: [u16; 10] = [339, 208, 711, 189, 263, 537, 663, 942, 173, 900];

/// One period of a C/A code as chips +1 (logical 0) and -1 (logical 1).
pub fn ca_code(sv: Sv) -> [i8; CA_CODE_LENGTH] {
    let delay = match sv.prn() {
        prn @ 1..=32 => G2_DELAY_GPS[usize::from(prn - 1)],
        prn @ 120..=138 => G2_DELAY_SBAS[usize::from(prn - 120)],
        prn => G2_DELAY_QZSS[usize::from(prn - 193)],
    };
    // IS-GPS-200N 3.2.1.3: G1 = 1 + x^3 + x^10, G2 = 1 + x^2 + x^3 + x^6 + x^8 + x^9 + x^10.
    let g1 = shift_register(&[3, 10]);
    let g2 = shift_register(&[2, 3, 6, 8, 9, 10]);
    std::array::from_fn(|chip| {
        let delayed = (chip + CA_CODE_LENGTH - usize::from(delay)) % CA_CODE_LENGTH;
        1 - 2 * (g1[chip] ^ g2[delayed])
    })
}

/// Output of stage 10 of a register that starts at all ones and feeds back the sum of `taps`.
fn shift_register(taps: &[usize]) -> [i8; CA_CODE_LENGTH] {
    let mut stages = [1i8; 10];
    std::array::from_fn(|_| {
        let output = stages[9];
        let feedback = taps.iter().fold(0, |sum, &tap| sum ^ stages[tap - 1]);
        stages.rotate_right(1);
        stages[0] = feedback;
        output
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// IS-GPS-200N table 3-Ia, "first 10 chips, octal".
    const FIRST_CHIPS_OCTAL: [u16; 32] = [
        0o1440, 0o1620, 0o1710, 0o1744, 0o1133, 0o1455, 0o1131, 0o1454, 0o1626, 0o1504, 0o1642,
        0o1750, 0o1764, 0o1772, 0o1775, 0o1776, 0o1156, 0o1467, 0o1633, 0o1715, 0o1746, 0o1763,
        0o1063, 0o1706, 0o1743, 0o1761, 0o1770, 0o1774, 0o1127, 0o1453, 0o1625, 0o1712,
    ];

    #[test]
    fn first_ten_chips_are_those_of_the_interface_specification() {
        for (sv, octal) in Sv::all_gps().zip(FIRST_CHIPS_OCTAL) {
            let bits = ca_code(sv)[..10].iter().fold(0, |word, &c| word << 1 | u16::from(c < 0));
            assert_eq!(bits, octal, "{sv}");
        }
    }

    #[test]
    fn codes_are_balanced_gold_codes_of_three_valued_correlation() {
        let all = (1..=202u8).filter_map(Sv::from_prn).map(ca_code).collect::<Vec<_>>();
        for (i, a) in all.iter().enumerate() {
            assert_eq!(a.iter().map(|&c| i32::from(c)).sum::<i32>().abs(), 1);
            let b = &all[(i + 7) % all.len()];
            for shift in 0..CA_CODE_LENGTH {
                let r: i32 = (0..CA_CODE_LENGTH)
                    .map(|n| i32::from(a[n]) * i32::from(b[(n + shift) % CA_CODE_LENGTH]))
                    .sum();
                assert!([-65, -1, 63].contains(&r), "a Gold code pair correlates to {r}");
            }
        }
    }
}
