//! Weil codes: sums of a Legendre sequence and itself moved (BDS-SIS-ICD-B1C-1.0 5.2; IS-GPS-800G 3.2.2.1).

/// The Legendre sequence of a prime: true at k where k is a square modulo the prime, and not at 0.
fn legendre(prime: usize) -> Vec<bool> {
    let mut sequence = vec![false; prime];
    (1..prime).for_each(|k| sequence[k * k % prime] = true);
    sequence
}

/// `count` chips, from the chip `start` (from 0) on, of the Weil code of length `prime` and this index: L(k) + L(k + index).
pub(super) fn weil_code(prime: usize, index: usize, start: usize, count: usize) -> Vec<i8> {
    let sequence = legendre(prime);
    let level = |k: usize| sequence[k % prime];
    let chip = |k: usize| if level(k) == level(k + index) { 1 } else { -1 };
    (start..start + count).map(chip).collect()
}
