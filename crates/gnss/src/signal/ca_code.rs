//! The family of C/A codes (IS-GPS-200N 3.2.1.3).

/// Chips in a period.
pub(super) const CHIPS: usize = 1023;

/// One period of the code number `index` of a list of G2 delays (chips) as chips +1 (logical 0) and -1
/// (logical 1).
pub(super) fn ca_code(delays: &[u16], index: u8) -> Option<Box<[i8]>> {
    let delay = usize::from(*delays.get(usize::from(index))?);
    // G1 = 1 + x^3 + x^10, G2 = 1 + x^2 + x^3 + x^6 + x^8 + x^9 + x^10.
    let g1 = shift_register(&[3, 10]);
    let g2 = shift_register(&[2, 3, 6, 8, 9, 10]);
    let chip = |chip| 1 - 2 * (g1[chip] ^ g2[(chip + CHIPS - delay) % CHIPS]);
    Some((0..CHIPS).map(chip).collect())
}

/// Output of stage 10 of a register that starts at all ones and feeds back the sum of `taps`.
fn shift_register(taps: &[usize]) -> [i8; CHIPS] {
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
    use super::CHIPS;
    use crate::{Constellation, Sv, signal};

    #[test]
    fn codes_are_balanced_gold_codes_of_three_valued_correlation() {
        let systems = [Constellation::Gps, Constellation::Qzss, Constellation::Sbas];
        let satellites = systems.into_iter().flat_map(Sv::all);
        let all = satellites.map(|sv| signal::of(sv).code()).collect::<Vec<_>>();
        for (i, a) in all.iter().enumerate() {
            assert_eq!(a.iter().map(|&c| i32::from(c)).sum::<i32>().abs(), 1);
            let b = &all[(i + 7) % all.len()];
            for shift in 0..CHIPS {
                let r: i32 =
                    (0..CHIPS).map(|n| i32::from(a[n]) * i32::from(b[(n + shift) % CHIPS])).sum();
                assert!([-65, -1, 63].contains(&r), "a Gold code pair correlates to {r}");
            }
        }
    }
}
