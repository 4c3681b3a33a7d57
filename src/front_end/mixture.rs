//! The distribution of impulsive noise, estimated from the samples: a Gaussian mixture of two components.
//!
//! A sample comes from the background (variance v1) with probability 1 - e, and from an impulse (variance
//! v2 > v1) with probability e. Both are circular Gaussian (complex samples) or Gaussian (real ones). The fit is
//! by expectation maximisation (Dempster, Laird and Rubin 1977) over a histogram of powers, so that its cost
//! does not grow with the number of samples.

use num_complex::Complex32;

/// Bins per octave of power, as a power of two.
const BITS: u32 = 4;
/// Bins of power: the 8 bits of the exponent of a single-precision number and `BITS` of its fraction.
pub(crate) const BINS: usize = 1 << (8 + BITS);

/// Maximum number of iterations of the fit, and of those first made from each start.
const ITERATIONS: usize = 100;
const FIRST_ITERATIONS: usize = 8;
/// The fit ends when an iteration changes nothing by more than this, relative.
const CONVERGED: f64 = 1e-5;

/// Starts of the fit: probability, and both variances over that of a Gaussian of the same median power.
const STARTS: [[f64; 3]; 5] =
    [[0.1, 1.0, 10.0], [0.1, 1.0, 100.0], [0.05, 1.0, 1e3], [0.02, 1.0, 1e4], [0.8, 0.03, 1.0]];

/// Index of a power's bin: zero is in the first, powers that are not finite are in the last octave.
pub(crate) fn bin(power: f32) -> usize {
    (power.to_bits() >> (23 - BITS)) as usize & (BINS - 1)
}

/// The power in the middle of a bin; NaN in the last octave.
pub(crate) fn middle(bin: usize) -> f64 {
    f64::from(f32::from_bits(((2 * bin + 1) as u32) << (22 - BITS)))
}

/// Histogram of the powers |z|^2 of samples, in bins of a sixteenth of an octave.
#[derive(Clone, Debug)]
pub struct PowerHistogram {
    counts: Vec<u32>,
}

impl Default for PowerHistogram {
    fn default() -> Self {
        Self { counts: vec![0; BINS] }
    }
}

impl PowerHistogram {
    /// Removes all counts.
    pub fn clear(&mut self) {
        self.counts.fill(0);
    }

    /// Counts one power; powers that are not finite are not counted.
    pub fn add(&mut self, power: f32) {
        self.counts[bin(power)] += 1;
    }

    /// Counts the powers of samples times `scale`.
    pub fn add_samples(&mut self, samples: &[Complex32], scale: f32) {
        samples.iter().for_each(|z| self.add((z * scale).norm_sqr()));
    }

    /// Mean power of each bin that is not empty, and its count.
    ///
    /// Zeros are values of a converter, or samples that were lost. A converter gives about as many as of the
    /// smallest power next to them, and they represent a fraction of it; more are not counted.
    pub(super) fn cells(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let finite = &self.counts[..BINS - (1 << BITS)];
        let filled = |n: &u32| *n > 0;
        let start = finite[1..].iter().position(filled).map_or(BINS, |k| k + 1).min(finite.len());
        let end = finite.iter().rposition(filled).map_or(0, |last| last + 1).max(start);
        let smallest = finite.get(start).copied().unwrap_or(0).min(finite[0]);
        let zeros = (middle(start) / 4.0, f64::from(smallest));
        let cell = move |(k, &n): (usize, &u32)| (middle(start + k), f64::from(n));
        let others = finite[start..end].iter().enumerate().map(cell);
        std::iter::once(zeros).chain(others).filter(|c| c.1 > 0.0)
    }

    /// Number of powers counted.
    pub fn total(&self) -> f64 {
        self.cells().map(|c| c.1).sum()
    }

    /// Number of bins that are not empty: small when the samples come from a coarse converter.
    pub fn distinct(&self) -> usize {
        self.cells().count()
    }

    /// Mean of the powers counted.
    pub fn mean(&self) -> f64 {
        self.cells().map(|(power, n)| power * n).sum::<f64>() / self.total()
    }

    /// The power that a part of those counted does not exceed.
    pub(super) fn quantile(&self, part: f64) -> Option<f64> {
        let below = part * self.total();
        let mut seen = 0.0;
        let cell = self.cells().find(|c| {
            seen += c.1;
            seen >= below
        });
        cell.map(|c| c.0)
    }

    /// Excess of the spread of the powers over that of Gaussian noise: the larger of two measures, each over
    /// its standard deviation for as many samples of Gaussian noise.
    ///
    /// The first is E\[p^2\] / E\[p\]^2 over its value 2 (3 for real samples), less 1, which strong impulses
    /// raise; standard deviation 1 / sqrt n (sqrt(8/3) / sqrt n). The second is ln E\[p\] - E\[ln p\] - gamma
    /// (less ln 2 more, for real samples), which also shows noise that is strong most of the time; standard
    /// deviation sqrt((pi^2/6 - 1) / n), or sqrt((pi^2/2 - 2) / n).
    pub fn excess(&self, real: bool) -> f64 {
        use std::f64::consts::{LN_2, PI};
        const EULER: f64 = 0.577_215_664_901_532_9;
        let n = self.total();
        let mean = self.mean();
        let (square, log) = self.cells().fold((0.0, 0.0), |(square, log), (power, count)| {
            (square + count * (power / mean).powi(2), log + count * (power / mean).ln())
        });
        let (fourth, below, sd) = if real {
            (3.0, EULER + LN_2, [(8f64 / 3.0).sqrt(), (PI * PI / 2.0 - 2.0).sqrt()])
        } else {
            (2.0, EULER, [1.0, (PI * PI / 6.0 - 1.0).sqrt()])
        };
        let spread = [square / n / fourth - 1.0, -log / n - below];
        // No mixture of Gaussians has a negative first measure; a tone, or a signal without noise, has.
        if spread[0] < 0.0 {
            return spread[0] / sd[0] * n.sqrt();
        }
        (spread[0] / sd[0]).max(spread[1] / sd[1]) * n.sqrt()
    }
}

/// A mixture of two Gaussians of zero mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture {
    /// Probability of an impulse, 0 to 1.
    pub probability: f64,
    /// Variance of the background, E|z|^2.
    pub background: f64,
    /// Variance of impulses.
    pub impulse: f64,
    /// Whether samples are real.
    pub real: bool,
}

impl Mixture {
    /// Noise without impulses.
    pub fn gaussian(variance: f64, real: bool) -> Self {
        Self { probability: 0.0, background: variance, impulse: variance, real }
    }

    /// The maximum-likelihood mixture of the powers counted; `None` where none were.
    ///
    /// Cost: some 150 iterations of one exponential for each bin that is not empty, 0.3 ms in all.
    pub fn fit(powers: &PowerHistogram, real: bool) -> Option<Self> {
        // Median of |z|^2: ln 2 of the variance, of real samples 0.4549 (chi-square of one degree).
        let gaussian = powers.quantile(0.5)? / if real { 0.4549 } else { std::f64::consts::LN_2 };
        let fits = STARTS.into_iter().map(|[probability, background, impulse]| {
            let start = Self {
                probability,
                background: background * gaussian,
                impulse: impulse * gaussian,
                real,
            };
            let fit = start.improved(powers, FIRST_ITERATIONS);
            (fit, fit.log_likelihood(powers))
        });
        let best = fits.max_by(|a, b| a.1.total_cmp(&b.1))?.0;
        Some(best.improved(powers, ITERATIONS))
    }

    /// After at most so many iterations of expectation maximisation; ends earlier when converged.
    fn improved(self, powers: &PowerHistogram, rounds: usize) -> Self {
        let mut now = self;
        for _ in 0..rounds {
            let before = now;
            now = now.round(powers);
            let same = |a: f64, b: f64| (a - b).abs() <= CONVERGED * b;
            if same(now.probability, before.probability)
                && same(now.background, before.background)
                && same(now.impulse, before.impulse)
            {
                break;
            }
        }
        now
    }

    fn round(&self, powers: &PowerHistogram) -> Self {
        let [mut n1, mut n2, mut p1, mut p2] = [0.0; 4];
        for (power, count) in powers.cells() {
            let impulse = count * self.impulse_probability(power);
            n1 += count - impulse;
            n2 += impulse;
            p1 += (count - impulse) * power;
            p2 += impulse * power;
        }
        let mean = |sum: f64, n: f64, otherwise: f64| if n > 0.0 { sum / n } else { otherwise };
        let background = mean(p1, n1, self.background);
        let impulse = mean(p2, n2, self.impulse).max(background);
        Self { probability: n2 / (n1 + n2), background, impulse, real: self.real }
    }

    /// Half the degrees of freedom of a power.
    fn half(&self) -> f64 {
        if self.real { 0.5 } else { 1.0 }
    }

    /// Probability that a sample of this power is an impulse.
    pub fn impulse_probability(&self, power: f64) -> f64 {
        if self.probability == 0.0 {
            return 0.0;
        }
        // The ratio of the two densities as a logarithm: either alone can exceed the range of numbers.
        let (half, v1, v2) = (self.half(), self.background, self.impulse);
        let log_ratio = half * (power * (1.0 / v2 - 1.0 / v1) + (v2 / v1).ln());
        let ratio = (1.0 - self.probability) / self.probability * log_ratio.min(700.0).exp();
        1.0 / (1.0 + ratio)
    }

    fn log_likelihood(&self, powers: &PowerHistogram) -> f64 {
        let log = |(power, count)| count * self.log_density(power);
        powers.cells().map(log).sum()
    }

    /// Logarithm of the density of a sample of this power, up to a constant.
    fn log_density(&self, power: f64) -> f64 {
        let half = self.half();
        let log = |probability: f64, v: f64| probability.ln() - half * (power / v + v.ln());
        let (a, b) =
            (log(1.0 - self.probability, self.background), log(self.probability, self.impulse));
        let (low, high) = (a.min(b), a.max(b));
        high + (low - high).exp().ln_1p()
    }

    /// Density of the logarithm of the power at this power.
    pub(super) fn log_power_density(&self, power: f64) -> f64 {
        // Gamma(1) = 1, and Gamma(1/2) = sqrt(pi).
        let norm = if self.real { std::f64::consts::PI.sqrt() } else { 1.0 };
        let part = |v: f64| {
            let x = self.half() * power / v;
            x.powf(self.half()) * (-x).exp() / norm
        };
        (1.0 - self.probability) * part(self.background) + self.probability * part(self.impulse)
    }

    /// Mean of 1 / variance given a sample's power: the weight of the locally optimum detector, and of
    /// maximum likelihood.
    pub fn inverse_variance(&self, power: f64) -> f64 {
        let impulse = self.impulse_probability(power);
        (1.0 - impulse) / self.background + impulse / self.impulse
    }

    /// The distribution with all variances times a factor.
    pub fn scaled(self, factor: f64) -> Self {
        let (background, impulse) = (self.background * factor, self.impulse * factor);
        Self { background, impulse, ..self }
    }

    /// Variance of the whole mixture.
    pub fn variance(&self) -> f64 {
        (1.0 - self.probability) * self.background + self.probability * self.impulse
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::front_end::{Effect, Map};
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    /// Powers of `n` samples, scaled and quantised by `converter`.
    fn powers(
        noise: Mixture,
        n: usize,
        seed: u64,
        converter: impl Fn(f64) -> f64,
    ) -> PowerHistogram {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut powers = PowerHistogram::default();
        for _ in 0..n {
            let impulse = rng.random::<f64>() < noise.probability;
            let variance = if impulse { noise.impulse } else { noise.background };
            let mut part = |fraction: f64| {
                converter((variance * fraction).sqrt() * rng.sample::<f64, _>(StandardNormal))
            };
            let power =
                if noise.real { part(1.0).powi(2) } else { part(0.5).powi(2) + part(0.5).powi(2) };
            powers.add(power as f32);
        }
        powers
    }

    #[test]
    fn the_fit_finds_the_distribution_of_the_samples() {
        for real in [false, true] {
            for (probability, ratio) in
                [(0.1, 50.0), (0.1, 1000.0), (0.01, 1e4), (0.3, 50.0), (0.7, 300.0)]
            {
                let (n, level) = (100_000, 3e-12);
                let noise =
                    Mixture { probability, background: level, impulse: ratio * level, real };
                let fit = Mixture::fit(&powers(noise, n, 5, |x| x), real).unwrap();
                // Five standard deviations of the means of exponentials (sqrt 2 more for real samples), and
                // as much for the correlation of the two components' estimates; the bins of a sixteenth of an
                // octave add nothing of note.
                let wide = 10.0 * if real { 2f64.sqrt() } else { 1.0 };
                let (n1, n2) = ((1.0 - probability) * n as f64, probability * n as f64);
                assert!(
                    (fit.background / noise.background - 1.0).abs() < wide / n1.sqrt(),
                    "{fit:?}"
                );
                assert!((fit.impulse / noise.impulse - 1.0).abs() < wide / n2.sqrt(), "{fit:?}");
                assert!((fit.probability / probability - 1.0).abs() < wide / n2.sqrt(), "{fit:?}");
            }
        }
    }

    #[test]
    fn gaussian_noise_shows_no_excess_with_any_converter() {
        // Normal with unit standard deviation: of 40 trials none beyond 4.5, which has a probability of 3e-6
        // a side; the tail of the fourth moment is longer, which for 3000 samples and more makes no more than
        // 1e-4.
        for real in [false, true] {
            for (rms, limit) in [(8.0, 127.0), (4.0, 31.0), (3.0, 7.0), (30.0, 60.0)] {
                let noise = Mixture::gaussian(rms * rms * if real { 1.0 } else { 2.0 }, real);
                for seed in 0..5 {
                    let quantised = powers(noise, 30_000, seed, |x| x.round().clamp(-limit, limit));
                    assert!(
                        quantised.excess(real) < 4.5,
                        "{real} {rms}: {}",
                        quantised.excess(real)
                    );
                }
            }
        }
    }

    #[test]
    fn impulses_show_even_where_the_converter_clips() {
        for real in [false, true] {
            let noise = Mixture { probability: 0.1, background: 32.0, impulse: 32e3, real };
            let clipped = powers(noise, 30_000, 1, |x| x.round().clamp(-127.0, 127.0));
            assert!(clipped.excess(real) > 100.0);
            let fit = Mixture::fit(&clipped, real).unwrap();
            // Clipped impulses seem more frequent and weaker than they are, and so bias the background
            // little; what matters is the loss of the map fitted to them against the optimal one: 0.05 dB.
            let effect = Effect::of(&noise, 1.0, |power| 32.0 * fit.inverse_variance(power));
            let loss_db = effect.loss_db() - Map::Optimal.loss_db(&noise);
            assert!(loss_db < 0.05, "{fit:?}: {loss_db} dB");
        }
    }

    #[test]
    fn empty_and_extreme_histograms_give_no_nan() {
        let mut none = PowerHistogram::default();
        [0.0, f32::NAN, f32::INFINITY, -f32::NAN].into_iter().for_each(|p| none.add(p));
        assert_eq!((none.total(), Mixture::fit(&none, false)), (0.0, None));
        let mut few = PowerHistogram::default();
        [1e-38, 1e38].into_iter().for_each(|p| few.add(p));
        let fit = Mixture::fit(&few, true).unwrap();
        assert!(
            [fit.probability, fit.background, fit.impulse].iter().all(|v| v.is_finite()),
            "{fit:?}"
        );
    }
}
