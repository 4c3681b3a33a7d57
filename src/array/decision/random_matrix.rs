//! The distribution of a covariance's eigenvalues under noise alone, and the threshold that follows.
//!
//! Let X be p x n with independent entries of zero mean and unit variance (complex). The eigenvalues of
//! X X^H / n fill the interval (1 +- sqrt(p/n))^2 (Marchenko and Pastur 1967). The largest, l, follows the
//! distribution of Tracy and Widom for beta = 2 (Johansson 2000; Johnstone, Ann. Statist. 29, 2001, of whom
//! this is the complex case):
//!
//! (n l - mu) / sigma ~ TW2, mu = (sqrt n + sqrt p)^2, sigma = (sqrt n + sqrt p)(1/sqrt n + 1/sqrt p)^(1/3)
//!
//! This holds for any independent entries with four moments, so also for noise after a memoryless map.

/// Mean of the Tracy-Widom distribution of beta = 2 (Bornemann, Markov Process. Related Fields 16, 2010).
#[cfg(test)]
const TW2_MEAN: f64 = -1.771_086_807_4;
/// Its variance.
#[cfg(test)]
const TW2_VARIANCE: f64 = 0.813_194_792_8;
/// Its skewness.
#[cfg(test)]
const TW2_SKEWNESS: f64 = 0.224_084_203_6;

/// The gamma distribution, shifted, that has the first three moments of TW2 (Chiani, J. Multivar. Anal. 129,
/// 2014, table 1): shape, scale, shift.
const TW2_GAMMA: (f64, f64, f64) = (79.659_5, 0.101_037, 9.819_61);

/// Centre and width of the largest eigenvalue of X X^H / `samples` for noise of unit variance.
pub fn largest_eigenvalue(dimension: usize, samples: usize) -> (f64, f64) {
    let (p, n) = ((dimension.max(1) as f64).sqrt(), (samples.max(1) as f64).sqrt());
    let centre = (n + p).powi(2);
    let width = (n + p) * (1.0 / n + 1.0 / p).cbrt();
    (centre / (n * n), width / (n * n))
}

/// Probability that a variable of the Tracy-Widom distribution (beta = 2) exceeds `s`; to a few per cent of
/// itself down to 1e-5.
pub fn tracy_widom_tail(s: f64) -> f64 {
    let (shape, scale, shift) = TW2_GAMMA;
    gamma_tail(shape, (s + shift) / scale)
}

/// Value that a variable of the Tracy-Widom distribution (beta = 2) exceeds with probability `false_alarm`.
pub fn tracy_widom_quantile(false_alarm: f64) -> f64 {
    let (mut low, mut high) = (-9.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if tracy_widom_tail(middle) > false_alarm { low = middle } else { high = middle }
    }
    high
}

/// Value that the largest eigenvalue of X X^H / `samples` exceeds with probability `false_alarm` for noise of
/// unit variance.
pub fn eigenvalue_threshold(dimension: usize, samples: usize, false_alarm: f64) -> f64 {
    let (centre, width) = largest_eigenvalue(dimension, samples);
    centre + width * tracy_widom_quantile(false_alarm)
}

/// The same for the largest singular value of X itself.
pub fn singular_value_threshold(dimension: usize, samples: usize, false_alarm: f64) -> f64 {
    (eigenvalue_threshold(dimension, samples, false_alarm) * samples as f64).sqrt()
}

/// A spectrum of eigenvalues divided into signals and noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Division {
    /// Number of eigenvalues that noise alone does not explain.
    pub rank: usize,
    /// Variance of the noise.
    pub noise_variance: f64,
    /// The threshold that those eigenvalues exceed.
    pub threshold: f64,
}

/// Divides the eigenvalues of X X^H / `samples` (descending) into signals and noise of unknown variance; of
/// these, the `nulled` smallest are ignored (directions that were projected away). Noise alone gives a rank
/// above 0 with probability `false_alarm`.
///
/// The noise variance is the mean of the noise eigenvalues over 1 - rank/samples, the fraction of the noise
/// that is not in the span of the signals' right singular vectors; rank and variance are iterated until they
/// agree.
pub fn divide(eigenvalues: &[f64], samples: usize, nulled: usize, false_alarm: f64) -> Division {
    let count = eigenvalues.len().saturating_sub(nulled);
    let mut rank = 0;
    loop {
        let noise = &eigenvalues[rank.min(count)..count];
        let seen = 1.0 - rank as f64 / samples.max(rank + 1) as f64;
        let noise_variance = noise.iter().sum::<f64>() / noise.len().max(1) as f64 / seen;
        let threshold = noise_variance * eigenvalue_threshold(noise.len(), samples, false_alarm);
        let more = noise.iter().take_while(|&&l| l > threshold).count();
        // At least one eigenvalue must remain to estimate the noise variance.
        if more == 0 || rank + more >= count {
            return Division { rank, noise_variance, threshold };
        }
        rank += more;
    }
}

/// P(X > x) for the gamma distribution of this shape (at least 10) and scale 1: by its series or its
/// continued fraction (Abramowitz and Stegun 6.5.29 and 6.5.31).
fn gamma_tail(shape: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    // Stirling's series (6.1.41), to 1e-9 from a shape of 10 on.
    let log_gamma = (shape - 0.5) * shape.ln() - shape
        + 0.5 * std::f64::consts::TAU.ln()
        + 1.0 / (12.0 * shape)
        - 1.0 / (360.0 * shape.powi(3));
    let front = (shape * x.ln() - x - log_gamma).exp();
    if x < shape + 1.0 {
        let (mut term, mut sum) = (1.0 / shape, 1.0 / shape);
        for k in 1..1000 {
            term *= x / (shape + f64::from(k));
            sum += term;
        }
        return (1.0 - front * sum).clamp(0.0, 1.0);
    }
    // Backwards from a depth where it has converged.
    let fraction = (1..500)
        .rev()
        .map(f64::from)
        .fold(0.0, |rest, k| k * (k - shape) / (x + 2.0 * k + 1.0 - shape - rest));
    front / (x + 1.0 - shape - fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ai(x) and Ai'(x), integrated backwards (the stable direction) from the asymptotic expansion at 12.
    fn airy(x: f64) -> [f64; 2] {
        let start = 12f64;
        let zeta = 2.0 / 3.0 * start.powf(1.5);
        let front = (-zeta).exp() / (2.0 * std::f64::consts::PI.sqrt());
        // Abramowitz and Stegun 10.4.59 and 10.4.61, two terms: 1e-5 relative at 12.
        let a = front * start.powf(-0.25) * (1.0 - 5.0 / 72.0 / zeta);
        let d = -front * start.powf(0.25) * (1.0 + 7.0 / 72.0 / zeta);
        let steps = 20_000;
        let h = (x - start) / f64::from(steps);
        let slope = |t: f64, y: [f64; 2]| [y[1], t * y[0]];
        (0..steps).fold([a, d], |y, k| {
            let t = start + h * f64::from(k);
            let at = |y: [f64; 2], d: [f64; 2], h: f64| [y[0] + h * d[0], y[1] + h * d[1]];
            let k1 = slope(t, y);
            let k2 = slope(t + h / 2.0, at(y, k1, h / 2.0));
            let k3 = slope(t + h / 2.0, at(y, k2, h / 2.0));
            let k4 = slope(t + h, at(y, k3, h));
            [0, 1].map(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
        })
    }

    #[test]
    fn the_gamma_distribution_has_the_moments_and_tail_of_the_tracy_widom_distribution() {
        let (shape, scale, shift) = TW2_GAMMA;
        assert!((shape * scale - shift - TW2_MEAN).abs() < 1e-4);
        assert!((shape * scale * scale - TW2_VARIANCE).abs() < 1e-4);
        assert!((2.0 / shape.sqrt() - TW2_SKEWNESS).abs() < 1e-4);
        // 1 - F2(s) is 1 - det(I - K) = Tr K - ..., within Tr K / 2 of itself; the trace of the Airy
        // kernel over (s, inf) is the closed form below (Tracy and Widom 1994).
        for s in [0.0, 1.0, 2.0, 2.5] {
            let [a, d] = airy(s);
            let trace = (2.0 * s * s * a * a - 2.0 * s * d * d - a * d) / 3.0;
            let tail = tracy_widom_tail(s);
            // The gamma distribution's own error (Chiani's figure 2) is below 7 % where probabilities exceed
            // 1e-5.
            assert!((tail / trace - 1.0).abs() < 0.07 + trace, "{s}: {tail:e} against {trace:e}");
            assert!((tracy_widom_quantile(tail) - s).abs() < 1e-9);
        }
    }

    #[test]
    fn signals_above_the_edge_are_counted_and_the_noise_variance_is_correct() {
        // The Marchenko-Pastur distribution of ratio 1/4 is replaced by evenly spread eigenvalues of mean 1
        // in it.
        let noise = (0..40).map(|k| 1.9 - 1.8 * f64::from(k) / 39.0);
        let spectrum: Vec<f64> =
            [90.0, 8.0, 3.0].into_iter().chain(noise).map(|l| 2.0 * l).collect();
        let division = divide(&spectrum, 160, 0, 1e-4);
        assert_eq!(division.rank, 3);
        assert!((division.noise_variance - 2.0 / (1.0 - 3.0 / 160.0)).abs() < 1e-9);
        assert_eq!(divide(&spectrum[3..], 160, 0, 1e-4).rank, 0);
        // Directions that were projected away do not lower the noise variance.
        let nulled: Vec<f64> = spectrum.iter().copied().chain([1e-9, 0.0]).collect();
        assert_eq!(divide(&nulled, 160, 2, 1e-4), division);
    }
}
