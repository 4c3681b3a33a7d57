//! Interference of constant envelope, whatever it sweeps: what crosses it at right angles survives.
//!
//! Samples lie on a ring of radius `A` with circular noise about it, a mixture of Gaussians on a grid of variances. The
//! locally optimum map is the score of that density; far from the centre, where the Bessel functions of the Rice density
//! have ratio 1,
//!
//! ```text
//! g(z) = z (1 - A / |z|) sum_k posterior_k / v_k
//! ```
//!
//! The component of a weak signal across the ring passes, that along it does not: 3.0 dB, however strong the ring.

use num_complex::Complex32;

/// Samples by which the ring is fitted.
const FITTED: usize = 4000;
/// Steps of the variances of the grid: half an octave, over so many octaves.
const VARIANCES: usize = 24;
const ROUNDS: usize = 20;
/// Bins of the weight, over this many of the smallest standard deviations to either side.
const BINS: usize = 4096;
const REACH: f64 = 64.0;

/// A ring of samples, with the weight by distance from it.
pub(super) struct Envelope {
    radius: f64,
    /// Bins of the distance per unit.
    scale: f64,
    weights: Vec<f32>,
}

impl Envelope {
    /// Fits a ring; none for samples of zeros.
    pub(super) fn fit(samples: &[Complex32]) -> Option<Self> {
        let step = samples.len().div_ceil(FITTED).max(1);
        let mut radii: Vec<f64> =
            samples.iter().step_by(step).map(|z| f64::from(z.norm())).collect();
        if radii.len() < 100 {
            return None;
        }
        radii.sort_by(f64::total_cmp);
        let mut radius = radii[radii.len() / 2];
        let mut apart: Vec<f64> = radii.iter().map(|r| 2.0 * (r - radius).powi(2)).collect();
        apart.sort_by(f64::total_cmp);
        // Smaller variances than the median of twice the squared distances fit noise.
        let smallest = apart[apart.len() / 2];
        if smallest <= 0.0 || !radii.iter().all(|r| r.is_finite()) {
            return None;
        }
        let variances: Vec<f64> =
            (0..VARIANCES).map(|k| smallest * 2f64.powf(k as f64 / 2.0)).collect();
        let mut shares = vec![1.0 / VARIANCES as f64; VARIANCES];
        for _ in 0..ROUNDS {
            let mut sums = [0.0; VARIANCES];
            let (mut moment, mut weight) = (0.0, 0.0);
            for r in &radii {
                let posterior = posterior(&shares, &variances, (r - radius).powi(2));
                for ((sum, p), v) in sums.iter_mut().zip(&posterior).zip(&variances) {
                    *sum += p;
                    moment += p / v * r;
                    weight += p / v;
                }
            }
            radius = moment / weight;
            shares = sums.iter().map(|s| s / radii.len() as f64).collect();
        }
        let half = REACH * smallest.sqrt();
        let weight = |k: usize| {
            let distance = ((k as f64 + 0.5) / BINS as f64 * 2.0 - 1.0) * half;
            let posterior = posterior(&shares, &variances, distance * distance);
            let inverse: f64 = posterior.iter().zip(&variances).map(|(p, v)| p / v).sum();
            (inverse * smallest) as f32
        };
        Some(Self {
            radius,
            scale: BINS as f64 / (2.0 * half),
            weights: (0..BINS).map(weight).collect(),
        })
    }

    /// Maps samples in place.
    pub(super) fn apply(&self, samples: &mut [Complex32]) {
        for z in samples {
            let r = f64::from(z.norm());
            let bin = ((r - self.radius) * self.scale + BINS as f64 / 2.0) as usize;
            let weight = f64::from(self.weights[bin.min(BINS - 1)]);
            // At the centre nothing says which way is along.
            *z *= if r > 0.0 { (weight * (1.0 - self.radius / r)) as f32 } else { 0.0 };
        }
    }
}

/// Probability of each variance given the squared distance from the ring.
fn posterior(shares: &[f64], variances: &[f64], square: f64) -> [f64; VARIANCES] {
    let mut out = [0.0; VARIANCES];
    for ((p, share), v) in out.iter_mut().zip(shares).zip(variances) {
        *p = share / v.sqrt() * (-square / v).exp();
    }
    let sum: f64 = out.iter().sum();
    if sum > 0.0 {
        out.iter_mut().for_each(|p| *p /= sum);
    } else {
        out[VARIANCES - 1] = 1.0;
    }
    out
}
