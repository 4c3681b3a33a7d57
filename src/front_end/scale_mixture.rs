//! The score of noise of any impulsive distribution: a mixture of Gaussians on a fixed grid of variances.
//!
//! Variances are half an octave apart, from the 10 % quantile of the powers to the greatest; only their fractions are fitted, by expectation maximisation over the histogram of powers. The weight
//! `w(p) = E[1 / variance | p]` is that of the locally optimum detector, whose efficacy `E[p w^2]` is the Fisher
//! information. Alpha-stable noise, mixtures of any number of components and bursts are all scale mixtures; two
//! components are not enough for stable noise of exponents below 1.8.

use super::mixture::{BINS, PowerHistogram, middle};

/// Variances in an octave.
const PER_OCTAVE: f64 = 2.0;
/// Index of the smallest variance that is held, and their number: all that single precision has.
const FIRST: i32 = -300;
const VARIANCES: usize = 600;
/// Rounds of the fit: the first time, and from the fractions of the fit before.
const ROUNDS_FIRST: usize = 150;
const ROUNDS: usize = 12;
/// Where the grid starts: the quantile of the powers.
const QUANTILE: f64 = 0.1;
/// Fraction of the samples that the power of a converter's step has.
const STEP_FRACTION: f64 = 0.01;
/// Least fraction of a variance at the start of a fit.
const LEAST: f64 = 1e-9;

fn variance(index: usize) -> f64 {
    2f64.powf((index as f64 + f64::from(FIRST)) / PER_OCTAVE)
}

fn index(variance: f64) -> usize {
    let index = (variance.log2() * PER_OCTAVE).round() as i32 - FIRST;
    index.clamp(0, VARIANCES as i32 - 1) as usize
}

/// Fractions of the variances of a grid.
#[derive(Clone, Debug)]
pub(super) struct ScaleMixture {
    /// Of the variances in use: those from `first` on.
    fractions: Vec<f64>,
    first: usize,
    real: bool,
}

/// What the fitted noise allows: from the powers themselves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measured {
    /// Mean of p w^2: efficacy of the map.
    pub information: f64,
    /// Mean of p: one over the efficacy without a map.
    pub power: f64,
}

impl ScaleMixture {
    /// Fits the powers counted, from the fractions of an earlier fit where there is one; none where nothing was counted.
    /// Cost: one product for each bin, variance and round, 30 us to 1 ms from an earlier fit.
    pub(super) fn fit(powers: &PowerHistogram, real: bool, earlier: Option<&Self>) -> Option<Self> {
        let cells: Vec<(f64, f64)> = powers.cells().collect();
        let greatest = cells.last()?.0;
        let half = if real { 0.5 } else { 1.0 };
        let total: f64 = cells.iter().map(|c| c.1).sum();
        // Of a converter that shows its steps, variances below them would fit the steps.
        let step = cells.iter().find(|c| c.1 > STEP_FRACTION * total).map_or(0.0, |c| c.0);
        let is_step = cells.first()?.0 * 8.0 > step;
        let least = if is_step { 2.0 * step } else { 0.0 };
        let (first, last) = (index(powers.quantile(QUANTILE)?.max(least)), index(greatest));
        let count = (last + 1).saturating_sub(first).max(1);
        let start = |k: usize| {
            let known = earlier.map(|e| {
                let at = (first + k).wrapping_sub(e.first);
                e.fractions.get(at).copied().unwrap_or(0.0)
            });
            known.unwrap_or(1.0 / count as f64).max(LEAST)
        };
        let mut mixture = Self { fractions: (0..count).map(start).collect(), first, real };
        // Densities of ln p, by cell and variance; p^half is common to a cell.
        let density = |p: f64, k: usize| {
            let v = variance(first + k);
            v.powf(-half) * (-half * p / v).exp()
        };
        let table: Vec<f32> = cells
            .iter()
            .flat_map(|(p, _)| {
                let scale = p.powf(half);
                (0..count).map(move |k| (scale * density(*p, k)) as f32)
            })
            .collect();
        let rounds = if earlier.is_some() { ROUNDS } else { ROUNDS_FIRST };
        let mut sums = vec![0f32; count];
        for _ in 0..rounds {
            let fractions: Vec<f32> = mixture.fractions.iter().map(|f| *f as f32).collect();
            sums.fill(0.0);
            for ((_, n), row) in cells.iter().zip(table.chunks_exact(count)) {
                let whole: f32 = row.iter().zip(&fractions).map(|(d, f)| d * f).sum();
                if whole > 0.0 {
                    let part = (*n / total) as f32 / whole;
                    sums.iter_mut().zip(row).for_each(|(s, d)| *s += part * d);
                }
            }
            for (fraction, sum) in mixture.fractions.iter_mut().zip(&sums) {
                *fraction = (*fraction * f64::from(*sum)).max(1e-30);
            }
        }
        Some(mixture)
    }

    /// Mean of 1 / variance given a sample's power.
    pub(super) fn inverse_variance(&self, power: f64) -> f64 {
        let half = if self.real { 0.5 } else { 1.0 };
        let log = |k: usize| {
            let v = variance(self.first + k);
            (self.fractions[k].ln() - half * (power / v + v.ln()), 1.0 / v)
        };
        let logs = || (0..self.fractions.len()).map(log);
        let most = logs().map(|l| l.0).fold(f64::NEG_INFINITY, f64::max);
        let (mut sum, mut weighted) = (0.0, 0.0);
        for (log, inverse) in logs() {
            let part = (log - most).exp();
            sum += part;
            weighted += part * inverse;
        }
        weighted / sum
    }

    /// The weights of all bins of powers, and what they do to the powers counted.
    pub(super) fn weights(&self, powers: &PowerHistogram) -> (Vec<f64>, Measured) {
        let weights: Vec<f64> = (0..BINS)
            .map(|k| {
                let power = middle(k);
                if power.is_finite() { self.inverse_variance(power) } else { 0.0 }
            })
            .collect();
        let (mut information, mut power, mut total) = (0.0, 0.0, 0.0);
        for (p, n) in powers.cells() {
            let w = self.inverse_variance(p);
            information += n * p * w * w;
            power += n * p;
            total += n;
        }
        (weights, Measured { information: information / total, power: power / total })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Exp1, StandardNormal};
    use std::f64::consts::PI;

    /// Isotropic alpha-stable noise is Gaussian with a variance that is positive stable of exponent alpha / 2
    /// (Samorodnitsky & Taqqu 1994, 2.5), drawn as Kanter (1975).
    fn stable_variance(alpha: f64, rng: &mut ChaCha8Rng) -> f64 {
        let a = alpha / 2.0;
        let u = PI * rng.random::<f64>();
        let e: f64 = rng.sample(Exp1);
        let part = (a * u).sin() / u.sin().powf(1.0 / a);
        part * (((1.0 - a) * u).sin() / e).powf((1.0 - a) / a)
    }

    /// The efficacy of a map against the Fisher information, both from draws that the fit has not seen. The information
    /// is known where the variance of each sample is not: by the characteristic function, for alpha of 1 and 2 in closed
    /// form (Cauchy in the plane: density (1 + r^2)^-1.5 / 2 pi at unit scale).
    #[test]
    fn the_score_of_cauchy_noise_is_reached_to_a_fiftieth_of_a_db() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut draw = || {
            // A bivariate t of one degree: normal over the root of a chi-square of one degree.
            let mut normal = || rng.sample::<f64, _>(StandardNormal);
            (normal().powi(2) + normal().powi(2)) / normal().powi(2)
        };
        let mut powers = PowerHistogram::default();
        (0..260_000).for_each(|_| powers.add(draw() as f32));
        let fit = ScaleMixture::fit(&powers, false, None).unwrap();
        // The score of the Cauchy distribution: z 3 / (1 + r^2) (per complex derivative, half of the gradient).
        let score = |p: f64| 1.5 / (1.0 + p);
        // Gain of a weak signal E[w + p w'] = E[p w s] with the true score s, noise E[p w^2].
        let (mut gain, mut noise, mut best) = (0.0, 0.0, 0.0);
        for _ in 0..400_000 {
            let p = draw();
            let w = fit.inverse_variance(p);
            gain += p * w * score(p);
            noise += p * w * w;
            best += p * score(p).powi(2);
        }
        let loss_db = -10.0 * (gain * gain / (noise * best)).log10();
        assert!(loss_db < 0.03, "{loss_db}");
        // E[p s^2] = 9/4 E[p / (1 + p)^2], with the density of p (1 + p)^-1.5 / 2: 9/8 B(2, 3/2) = 0.3.
        let measured = fit.weights(&powers).1.information;
        assert!((10.0 * (measured / 0.3).log10()).abs() < 0.1, "{measured}");
    }

    #[test]
    fn stable_noise_of_any_exponent_has_the_power_that_its_fit_says() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        for alpha in [1.9, 1.5, 1.2, 0.8] {
            let mut draw = || {
                let v = stable_variance(alpha, &mut rng);
                let e: f64 = rng.sample(Exp1);
                v * e
            };
            let (mut seen, mut other) = (PowerHistogram::default(), PowerHistogram::default());
            (0..260_000).for_each(|_| seen.add(draw() as f32));
            (0..260_000).for_each(|_| other.add(draw() as f32));
            let fit = ScaleMixture::fit(&seen, false, None).unwrap();
            // On powers that were not fitted: the matched map's noise is its gain (E[p w^2] = E[p w s]).
            let first = fit.weights(&seen).1.information;
            let second = fit.weights(&other).1.information;
            assert!((10.0 * (first / second).log10()).abs() < 0.05, "{alpha}: {first} {second}");
        }
    }
}
