//! Loop discriminators.

use num_complex::Complex64;
use std::f64::consts::TAU;

/// Costas discriminator, cycles in (-1/4, 1/4]: phase of the signal against the replica, insensitive to data
/// symbols (Kaplan & Hegarty, 3rd ed., table 8.2, two-quadrant arctangent, the maximum-likelihood one).
pub fn costas_cycles(prompt: Complex64) -> f64 {
    if prompt.re == 0.0 && prompt.im == 0.0 { 0.0 } else { (prompt.im / prompt.re).atan() / TAU }
}

/// Four-quadrant discriminator, cycles in (-1/2, 1/2]: phase of a pilot against the replica (Kaplan & Hegarty, 3rd ed.,
/// table 8.3).
pub fn phase_cycles(prompt: Complex64) -> f64 {
    prompt.arg() / TAU
}

/// Frequency discriminator, Hz: phase from one prompt to the next, `interval_s` later, in which a data symbol
/// may change (Kaplan & Hegarty, 3rd ed., table 8.4, decision-directed cross over dot).
pub fn frequency_hz(before: Complex64, now: Complex64, interval_s: f64) -> f64 {
    costas_cycles(now * before.conj()) / interval_s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discriminators_are_exact_on_ideal_correlations() {
        for k in -9..=9 {
            let x = f64::from(k) * 0.025;
            for sign in [1.0, -1.0] {
                let prompt = Complex64::cis(TAU * x) * sign;
                assert!((phase_cycles(prompt * sign) - x).abs() < 1e-12);
                assert!((costas_cycles(prompt) - x).abs() < 1e-12);
                let next = Complex64::cis(TAU * (x + 0.1));
                assert!((frequency_hz(prompt, next, 1e-3) - 100.0).abs() < 1e-9);
            }
        }
    }
}
