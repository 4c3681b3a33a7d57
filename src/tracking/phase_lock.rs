//! Detection of slips of the carrier's phase.
//!
//! A Costas loop holds the phase but for half cycles. Where it slips by one, the replica's phase stays half a cycle off
//! (a range of half a wavelength) and the symbols change their sign. On the way the prompt passes quadrature, which its
//! square shows whatever the symbols are: over n prompts p of signal power S and noise N, in lock,
//!
//! ```text
//! sum Re p^2 = n S +- sqrt(n (2 S N + N^2)),    at quadrature -n S
//! ```
//!
//! A sum below 0 is a slip. n is such that noise alone makes one five standard deviations below its mean (3e-7), and at
//! least 10 ms, the integration time of the loop.

use num_complex::Complex64;

/// Standard deviations by which the mean of a sum is above 0.
const SIGMAS: f64 = 5.0;
/// Shortest sum, s.
const SHORTEST_S: f64 = 0.01;
/// Assumed until it is known, dB-Hz.
const UNKNOWN_CN0_DBHZ: f64 = 30.0;

/// Watches a carrier loop.
#[derive(Clone, Debug, Default)]
pub(super) struct PhaseLock {
    sum: f64,
    prompts: f64,
    slipped: bool,
}

impl PhaseLock {
    /// Takes a prompt correlation over so many seconds.
    pub(super) fn push(&mut self, prompt: Complex64, length_s: f64, cn0_dbhz: Option<f64>) {
        self.sum += (prompt * prompt).re;
        self.prompts += 1.0;
        let ratio = 10f64.powf(cn0_dbhz.unwrap_or(UNKNOWN_CN0_DBHZ) / 10.0) * length_s;
        let needed = SIGMAS * SIGMAS * (1.0 + 2.0 * ratio) / (ratio * ratio);
        if self.prompts >= needed.max(SHORTEST_S / length_s) {
            self.slipped |= self.sum <= 0.0;
            (self.sum, self.prompts) = (0.0, 0.0);
        }
    }

    /// Whether the phase may have slipped since last asked.
    pub(super) fn take_slip(&mut self) -> bool {
        std::mem::take(&mut self.slipped)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::PI;

    /// Slips reported in `seconds` of prompts of 1 ms whose phase goes, after a second, by half a cycle within `slip_s`.
    fn slips(cn0_dbhz: f64, seconds: usize, slip_s: f64, seed: u64) -> usize {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let amplitude = (10f64.powf(cn0_dbhz / 10.0) * 1e-3).sqrt();
        let (mut lock, mut count, mut symbol) = (PhaseLock::default(), 0, 1.0);
        for k in 0..1000 * seconds {
            if k % 20 == 0 {
                symbol = if rng.next_u32() & 1 == 0 { 1.0 } else { -1.0 };
            }
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let noise = Complex64::new(normal(), normal()) / 2f64.sqrt();
            let turned = if slip_s > 0.0 { (k as f64 * 1e-3 - 1.0) / slip_s } else { 0.0 };
            let phase = PI * turned.clamp(0.0, 1.0);
            lock.push(Complex64::cis(phase) * amplitude * symbol + noise, 1e-3, Some(cn0_dbhz));
            count += usize::from(lock.take_slip());
        }
        count
    }

    /// 3e-7 for each of at most 100 sums a second.
    #[test]
    fn a_loop_in_lock_shows_no_slip() {
        for cn0_dbhz in [28.0, 32.0, 45.0] {
            assert_eq!((0..10).map(|seed| slips(cn0_dbhz, 60, 0.0, seed)).sum::<usize>(), 0);
        }
    }

    /// A loop of 15 Hz crosses half a cycle in no less than 1 / (2 B) = 33 ms, half of which the square is negative.
    #[test]
    fn a_slip_of_half_a_cycle_shows_at_common_strengths() {
        for cn0_dbhz in [40.0, 45.0, 50.0] {
            for seed in 0..100 {
                assert!(slips(cn0_dbhz, 2, 1.0 / 30.0, seed) >= 1, "{cn0_dbhz} dB-Hz, {seed}");
            }
        }
    }
}
