//! Loop discriminators.

use num_complex::Complex64;
use std::f64::consts::TAU;

/// Costas discriminator, cycles in (-1/4, 1/4]: phase of the signal against the replica, insensitive to data
/// symbols (Kaplan & Hegarty, 3rd ed., table 8.2, two-quadrant arctangent, the maximum-likelihood one).
pub fn costas_cycles(prompt: Complex64) -> f64 {
    if prompt.re == 0.0 && prompt.im == 0.0 { 0.0 } else { (prompt.im / prompt.re).atan() / TAU }
}

/// Frequency discriminator, Hz: phase from one prompt to the next, `interval_s` later, in which a data symbol
/// may change (Kaplan & Hegarty, 3rd ed., table 8.4, decision-directed cross over dot).
pub fn frequency_hz(before: Complex64, now: Complex64, interval_s: f64) -> f64 {
    costas_cycles(now * before.conj()) / interval_s
}

/// Normalised early minus late envelope, chips: the delay of the signal against the replica, exact for the
/// triangular correlation of an unfiltered code and |result| < `distance` (Kaplan & Hegarty, 3rd ed., table
/// 8.5), for early and late `distance` chips from prompt.
pub fn lateness_chips(early: Complex64, late: Complex64, distance: f64) -> f64 {
    let (early, late) = (early.norm(), late.norm());
    let sum = early + late;
    if sum > 0.0 { (1.0 - distance) * (late - early) / sum } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discriminators_are_exact_on_ideal_correlations() {
        for k in -9..=9 {
            let x = f64::from(k) * 0.025;
            let (early, late) = (Complex64::from(0.75 - x), Complex64::from(0.75 + x));
            assert!((lateness_chips(early, late, 0.25) - x).abs() < 1e-12);
            for sign in [1.0, -1.0] {
                let prompt = Complex64::cis(TAU * x) * sign;
                assert!((costas_cycles(prompt) - x).abs() < 1e-12);
                let next = Complex64::cis(TAU * (x + 0.1));
                assert!((frequency_hz(prompt, next, 1e-3) - 100.0).abs() < 1e-9);
            }
        }
    }
}
