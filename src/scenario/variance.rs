//! The variance of noise that changes from sample to sample: alpha-stable noise, and bursts.
//!
//! Isotropic alpha-stable noise is Gaussian noise of random variance: times a positive stable number of exponent
//! `a = alpha / 2` whose Laplace transform is `exp(-s^a)` (Samorodnitsky & Taqqu 1994, 2.5), drawn as Kanter (1975) has
//! it. An exponent of 2 leaves the background as it is. Bursts are slots of equal length, each a burst with a probability
//! of its own, so that their lengths are geometric, as of a Markov chain of two states.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;

/// Streams of the generator, beside those of the noise itself.
const STABLE_STREAM: u64 = 5 << 32;
const BURST_STREAM: u64 = 6 << 32;

/// Bursts of noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bursts {
    /// Fraction of the time.
    pub fraction: f64,
    /// Samples of a slot.
    pub slot: u64,
    /// Variance in a burst over that outside.
    pub ratio: f64,
}

/// Factors of the amplitude, by sample.
pub(super) struct VarianceSource {
    stable_exponent: Option<f64>,
    bursts: Option<Bursts>,
    stable: ChaCha8Rng,
    burst: ChaCha8Rng,
}

impl VarianceSource {
    /// Of a channel; none where nothing changes.
    pub(super) fn new(
        stable_exponent: Option<f64>,
        bursts: Option<Bursts>,
        seed: u64,
        channel: usize,
    ) -> Option<Self> {
        let stream = |stream: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(stream | channel as u64);
            rng
        };
        (stable_exponent.is_some() || bursts.is_some()).then(|| Self {
            stable_exponent,
            bursts,
            stable: stream(STABLE_STREAM),
            burst: stream(BURST_STREAM),
        })
    }

    /// Multiplies noise of samples `first`, `first` + 1, ...
    pub(super) fn scale(&mut self, first: u64, re: &mut [f32], im: &mut [f32]) {
        self.stable.set_word_pos(4 * u128::from(first));
        let mut slot = (u64::MAX, 1.0);
        for (k, (re, im)) in re.iter_mut().zip(im).enumerate() {
            let mut variance = 1.0;
            if let Some(alpha) = self.stable_exponent {
                let mut uniform = || (self.stable.next_u64() as f64 + 0.5) * 2f64.powi(-64);
                variance *= positive_stable(alpha / 2.0, uniform(), uniform());
            }
            if let Some(Bursts { fraction, slot: len, ratio }) = self.bursts {
                let index = (first + k as u64) / len;
                if slot.0 != index {
                    self.burst.set_word_pos(2 * u128::from(index));
                    let uniform = self.burst.next_u64() as f64 * 2f64.powi(-64);
                    slot = (index, if uniform < fraction { ratio } else { 1.0 });
                }
                variance *= slot.1;
            }
            let amplitude = variance.sqrt() as f32;
            *re *= amplitude;
            *im *= amplitude;
        }
    }
}

/// A positive stable number of exponent `a` in (0, 1] from two uniform ones in (0, 1).
fn positive_stable(a: f64, u: f64, w: f64) -> f64 {
    if a >= 1.0 {
        return 1.0;
    }
    let (angle, exponential) = (PI * u, -w.ln());
    let part = (a * angle).sin() / angle.sin().powf(1.0 / a);
    part * (((1.0 - a) * angle).sin() / exponential).powf((1.0 - a) / a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positive_stable_numbers_have_their_laplace_transform() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut uniform = move || (rng.next_u64() as f64 + 0.5) * 2f64.powi(-64);
        for a in [0.4, 0.75, 0.95, 1.0] {
            for s in [0.1f64, 1.0, 3.0] {
                const DRAWS: usize = 100_000;
                let mean =
                    (0..DRAWS).map(|_| (-s * positive_stable(a, uniform(), uniform())).exp());
                let mean = mean.sum::<f64>() / DRAWS as f64;
                // Numbers between 0 and 1 have a standard deviation of at most 1/2.
                assert!((mean - (-s.powf(a)).exp()).abs() < 5.0 * 0.5 / (DRAWS as f64).sqrt());
            }
        }
    }
}
