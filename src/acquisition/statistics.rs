//! The distribution of the search's statistic, and the threshold that follows from it.
//!
//! One cell (code phase, Doppler) of a search sums the power |C|^2 of K coherent correlations, each
//! over its mean under noise. Without signal each is exponential with mean 1 (C is complex Gaussian by
//! the central limit theorem), so the sum is Gamma(K, 1) (Kaplan & Hegarty, 3rd ed., 8.4.1):
//!
//! P(statistic > t) = Q(K, t) = exp(-t) sum_{i < K} t^i / i!
//!
//! The lines of a carrier, or the cross-correlation with a strong satellite, are alike in all K: their sum varies from
//! cell to cell as one of K' = mean^2 / variance < K powers does, and P = Q(K', K' t / K).
//!
//! A search of N cells raises a false alarm with probability 1 - (1 - P)^N. Neighbouring cells are
//! correlated, which makes that a slight overestimate: with four samples per chip and Doppler bins of
//! half the inverse coherent time, fewer than one exceedance in ten has a neighbour that exceeds too.

use statrs::function::gamma::{gamma_ur, ln_gamma};

/// Terms of the continued fraction at most; where it is used some 50 suffice.
const TERMS: usize = 500;

/// ln Q(looks, t), the logarithm of the probability that noise of one cell exceeds `t` after so many non-coherent
/// sums. The number need not be whole: sums of unequal or dependent powers have the distribution of fewer.
pub fn ln_cell_false_alarm(t: f64, looks: f64) -> f64 {
    if t <= 0.0 {
        return 0.0;
    }
    if t < looks + 1.0 {
        return gamma_ur(looks, t).ln();
    }
    // Legendre's continued fraction by Lentz's method (Numerical Recipes, 3rd ed., 6.2.7): no underflow.
    let mut b = t + 1.0 - looks;
    let mut c = f64::INFINITY;
    let mut d = b.recip();
    let mut h = d;
    for i in 1..TERMS {
        let a = -(i as f64) * (i as f64 - looks);
        b += 2.0;
        d = (a * d + b).recip();
        c = b + a / c;
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-12 {
            break;
        }
    }
    looks * t.ln() - t - ln_gamma(looks) + h.ln()
}

/// Probability that the noise of one cell exceeds `t` after `looks` non-coherent sums.
pub fn cell_false_alarm(t: f64, looks: f64) -> f64 {
    ln_cell_false_alarm(t, looks).exp().min(1.0)
}

/// Probability that noise exceeds `t` in at least one of `cells` cells.
pub fn search_false_alarm(t: f64, looks: f64, cells: f64) -> f64 {
    -(cells * (-cell_false_alarm(t, looks)).ln_1p()).exp_m1()
}

/// Threshold that noise exceeds with probability `false_alarm` in a search of `cells` cells.
pub fn threshold(false_alarm: f64, looks: f64, cells: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1000.0 + 10.0 * looks);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if search_false_alarm(middle, looks, cells) > false_alarm {
            low = middle
        } else {
            high = middle
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_without_non_coherent_sums_is_the_closed_form() {
        // One exponential cell: t = -ln P.
        for pfa in [1e-2, 1e-3, 1e-6] {
            assert!((threshold(pfa, 1.0, 1.0) + pfa.ln()).abs() < 1e-9);
        }
        // Chi-square with 2K degrees of freedom at twice the value: tables, K = 5: P(X > 18.307) = 5 %.
        assert!((cell_false_alarm(18.307 / 2.0, 5.0) - 0.05).abs() < 1e-5);
        // Whole numbers have a finite sum, exp(-t) (1 + t + t^2/2); half a degree is the normal distribution's:
        // Q(1/2, 50) = erfc(sqrt(50)) = 1.5239706e-23.
        let t: f64 = 700.0;
        let sum = (1.0 + t + t * t / 2.0).ln() - t;
        assert!((ln_cell_false_alarm(t, 3.0) / sum - 1.0).abs() < 1e-12);
        assert!((cell_false_alarm(50.0, 0.5) / 1.523_970_6e-23 - 1.0).abs() < 1e-6);
        // N cells: 1 - (1 - P)^N.
        let p: f64 = cell_false_alarm(12.0, 3.0);
        assert!(
            (search_false_alarm(12.0, 3.0, 1000.0) - (1.0 - (1.0 - p).powi(1000))).abs() < 1e-12
        );
    }
}
