//! Whether a code loop stands on the main peak of an autocorrelation that has side peaks.
//!
//! Very early and very late correlators stand where the neighbouring peaks are. On a side peak the main one is among
//! them and has more power (4.8 to 6 dB of BOC(1,1)); on the main peak both have less.

use num_complex::Complex64;

/// Loop intervals in a test, and standard errors by which a neighbour's power must be more. Of noise alone one test in
/// 30 000 fails either way.
const TESTED: usize = 50;
const SIGNIFICANT: f64 = 4.0;

/// Sums of the differences of powers since the last test.
#[derive(Clone, Debug, Default)]
pub(super) struct PeakMonitor {
    /// Very early and very late.
    sums: [f64; 2],
    squares: [f64; 2],
    count: usize,
}

/// The neighbour that has more power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Neighbour {
    Earlier,
    Later,
}

impl PeakMonitor {
    /// Takes the prompt of a loop interval and those of the neighbours, very early and very late. Gives the neighbour to
    /// jump to where a test says so.
    pub(super) fn push(&mut self, prompt: Complex64, sides: [Complex64; 2]) -> Option<Neighbour> {
        for (k, side) in sides.iter().enumerate() {
            let more = side.norm_sqr() - prompt.norm_sqr();
            self.sums[k] += more;
            self.squares[k] += more * more;
        }
        self.count += 1;
        if self.count < TESTED {
            return None;
        }
        let Self { sums, squares, count } = std::mem::take(self);
        // Mean over standard error.
        let significance = |k: usize| {
            let variance = squares[k] - sums[k] * sums[k] / count as f64;
            sums[k] / variance.max(f64::MIN_POSITIVE).sqrt()
        };
        let (best, neighbour) = match significance(0) > significance(1) {
            true => (significance(0), Neighbour::Earlier),
            false => (significance(1), Neighbour::Later),
        };
        (best > SIGNIFICANT).then_some(neighbour)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Outcomes of 200 tests at a C/N0 of the pilot, dB-Hz, with 10 ms, from these amplitudes of very early, prompt and
    /// very late (independent noise, which is worse than the correlated one of half a chip).
    fn outcomes(cn0_dbhz: f64, amplitudes: [f64; 3]) -> Vec<Option<Neighbour>> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let amplitude = (10f64.powf(cn0_dbhz / 10.0) * 1e-2).sqrt();
        let mut monitor = PeakMonitor::default();
        let mut all = Vec::new();
        for k in 1..=200 * TESTED {
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let [early, prompt, late] = amplitudes.map(|a| {
                Complex64::new(a * amplitude + normal() / 2f64.sqrt(), normal() / 2f64.sqrt())
            });
            let outcome = monitor.push(prompt, [early, late]);
            if k % TESTED == 0 {
                all.push(outcome);
            }
        }
        all
    }

    #[test]
    fn a_side_peak_is_left_and_the_main_peak_is_kept() {
        for cn0 in [27.0, 42.0] {
            assert!(outcomes(cn0, [-0.5, 1.0, -0.5]).iter().all(Option::is_none));
            let left = |expected, amplitudes| {
                let all = outcomes(cn0, amplitudes);
                let jumps = all.iter().filter(|o| **o == Some(expected)).count();
                // Mean over standard error at 27 dB-Hz: 3.3 / 0.6, of which 4 are asked.
                assert!(jumps > 150 && all.iter().all(|o| o.is_none_or(|n| n == expected)));
            };
            left(Neighbour::Earlier, [1.0, -0.58, 0.0]);
            left(Neighbour::Later, [0.0, -0.58, 1.0]);
        }
    }
}
