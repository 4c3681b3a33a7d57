//! The law of impulsive noise, from the samples themselves: a Gaussian mixture of two components.
//!
//! A sample comes from the background (variance v1) with probability 1 - share, and from an impulse
//! (variance v2 > v1) with probability `share`. Both are circular Gaussian (complex samples) or Gaussian
//! (real ones). The fit is by expectation and maximisation (Dempster, Laird and Rubin 1977) over a
//! histogram of powers, so that its cost does not grow with the number of samples.

/// Bins per octave of power, as a power of two.
const BITS: u32 = 4;
/// Bins: the 8 bits of the exponent of a single-precision number and `BITS` of its fraction.
const BINS: usize = 1 << (8 + BITS);

/// Powers |z|^2 of samples, counted in sixteenths of an octave.
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
    /// Counts one power; zero and what is not finite are not counted.
    pub fn add(&mut self, power: f32) {
        if power > 0.0 && power.is_finite() {
            self.counts[(power.to_bits() >> (23 - BITS)) as usize] += 1;
        }
    }

    /// Mean power of each bin that is not empty, and its count.
    fn cells(&self) -> Vec<(f64, f64)> {
        let middle = |bin: usize| f32::from_bits(((2 * bin + 1) as u32) << (22 - BITS));
        let filled = self.counts.iter().enumerate().filter(|(_, n)| **n > 0);
        filled.map(|(bin, &n)| (f64::from(middle(bin)), f64::from(n))).collect()
    }
}

/// A mixture of two Gaussians of zero mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture {
    /// Share of impulses, 0 to 1.
    pub share: f64,
    /// Variance of the background, E|z|^2.
    pub background: f64,
    /// Variance of impulses.
    pub impulse: f64,
    /// Whether samples are real.
    pub real: bool,
}

impl Mixture {
    /// The likeliest mixture of the powers counted; `None` where none were.
    pub fn fit(powers: &PowerHistogram, real: bool) -> Option<Self> {
        const ROUNDS: usize = 60;
        let cells = powers.cells();
        let total: f64 = cells.iter().map(|c| c.1).sum();
        let mut seen = 0.0;
        let median = cells.iter().find(|c| {
            seen += c.1;
            seen >= total / 2.0
        })?;
        // Median of |z|^2: ln 2 of the variance, of real samples 0.4549 (chi-square of one degree).
        let floor = median.0 / if real { 0.4549 } else { std::f64::consts::LN_2 };
        let starts = [(0.1, 10.0), (0.1, 100.0), (0.05, 1000.0), (0.02, 1e4)];
        let fits = starts.into_iter().map(|(share, ratio)| {
            let mut now = Self { share, background: floor, impulse: ratio * floor, real };
            for _ in 0..ROUNDS {
                now = now.improved(&cells);
            }
            (now, now.log_likelihood(&cells))
        });
        fits.max_by(|a, b| a.1.total_cmp(&b.1)).map(|f| f.0)
    }

    /// One round of expectation and maximisation.
    fn improved(&self, cells: &[(f64, f64)]) -> Self {
        let [mut n1, mut n2, mut p1, mut p2] = [0.0; 4];
        for &(power, count) in cells {
            let [a, b] = self.densities(power);
            let impulse = count * b / (a + b).max(f64::MIN_POSITIVE);
            n1 += count - impulse;
            n2 += impulse;
            p1 += (count - impulse) * power;
            p2 += impulse * power;
        }
        let tiny = f64::MIN_POSITIVE;
        Self {
            share: n2 / (n1 + n2),
            background: p1 / n1.max(tiny),
            impulse: (p2 / n2.max(tiny)).max(p1 / n1.max(tiny)),
            real: self.real,
        }
    }

    fn log_likelihood(&self, cells: &[(f64, f64)]) -> f64 {
        let log = |&(power, count): &(f64, f64)| {
            count * self.densities(power).iter().sum::<f64>().max(f64::MIN_POSITIVE).ln()
        };
        cells.iter().map(log).sum()
    }

    /// Densities of a sample of this power as background and as impulse, each times its share, but for a
    /// common constant.
    fn densities(&self, power: f64) -> [f64; 2] {
        let half = if self.real { 0.5 } else { 1.0 };
        let density = |variance: f64| (-half * power / variance).exp() / variance.powf(half);
        [(1.0 - self.share) * density(self.background), self.share * density(self.impulse)]
    }

    /// Mean of 1 / variance given a sample's power: the weight of the locally optimum detector, and of
    /// maximum likelihood.
    pub fn inverse_variance(&self, power: f64) -> f64 {
        let [a, b] = self.densities(power);
        let sum = a + b;
        if sum > 0.0 { (a / self.background + b / self.impulse) / sum } else { 1.0 / self.impulse }
    }

    /// Variance of the whole mixture.
    pub fn variance(&self) -> f64 {
        (1.0 - self.share) * self.background + self.share * self.impulse
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    #[test]
    fn the_fit_finds_the_law_that_made_the_samples() {
        for (share, ratio) in [(0.1, 50.0), (0.1, 1000.0), (0.01, 1e4), (0.3, 50.0)] {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
            let mut powers = PowerHistogram::default();
            let n = 100_000;
            for _ in 0..n {
                let variance = 3.0 * if rng.random::<f64>() < share { ratio } else { 1.0 };
                let mut part = || -> f64 { rng.sample::<f64, _>(StandardNormal) };
                powers.add((variance * (part().powi(2) + part().powi(2)) / 2.0) as f32);
            }
            let fit = Mixture::fit(&powers, false).unwrap();
            // Five standard deviations of the means of exponentials, and as much for what the two
            // components take from each other; a sixteenth of an octave per bin adds nothing of note.
            let n1 = (1.0 - share) * f64::from(n);
            let n2 = share * f64::from(n);
            assert!((fit.background / 3.0 - 1.0).abs() < 10.0 / n1.sqrt(), "{fit:?}");
            assert!((fit.impulse / (3.0 * ratio) - 1.0).abs() < 10.0 / n2.sqrt(), "{fit:?}");
            assert!((fit.share / share - 1.0).abs() < 10.0 / n2.sqrt(), "{fit:?}");
        }
    }
}
