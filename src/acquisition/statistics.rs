//! The distribution of the search's statistic, and the threshold that follows from it.
//!
//! One cell (code phase, Doppler) of a search sums the power |C|^2 of K coherent correlations, each
//! over its mean under noise. Without signal each is exponential with mean 1 (C is complex Gaussian by
//! the central limit theorem), so the sum is Gamma(K, 1) (Kaplan & Hegarty, 3rd ed., 8.4.1):
//!
//! P(statistic > t) = exp(-t) sum_{i < K} t^i / i!
//!
//! A search of N cells raises a false alarm with probability 1 - (1 - P)^N. Neighbouring cells are
//! correlated, which makes that a slight overestimate: with four samples per chip and Doppler bins of
//! half the inverse coherent time, fewer than one exceedance in ten has a neighbour that exceeds too.

/// Probability that the noise of one cell exceeds `t` after `k` non-coherent sums.
pub fn cell_false_alarm(t: f64, k: usize) -> f64 {
    let (mut term, mut sum) = (1.0, 1.0);
    for i in 1..k {
        term *= t / i as f64;
        sum += term;
    }
    // exp(-t) and the sum are multiplied as logarithms: each alone can exceed the range of f64.
    if t <= 0.0 { 1.0 } else { (sum.ln() - t).exp().min(1.0) }
}

/// Probability that noise exceeds `t` in at least one of `cells` cells.
pub fn search_false_alarm(t: f64, k: usize, cells: f64) -> f64 {
    -(cells * (-cell_false_alarm(t, k)).ln_1p()).exp_m1()
}

/// Threshold that noise exceeds with probability `false_alarm` in a search of `cells` cells.
pub fn threshold(false_alarm: f64, k: usize, cells: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1000.0 + 10.0 * k as f64);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if search_false_alarm(middle, k, cells) > false_alarm {
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
            assert!((threshold(pfa, 1, 1.0) + pfa.ln()).abs() < 1e-9);
        }
        // Chi-square with 2K degrees of freedom at twice the value: tables, K = 5: P(X > 18.307) = 5 %.
        assert!((cell_false_alarm(18.307 / 2.0, 5) - 0.05).abs() < 1e-5);
        // N cells: 1 - (1 - P)^N.
        let p: f64 = cell_false_alarm(12.0, 3);
        assert!((search_false_alarm(12.0, 3, 1000.0) - (1.0 - (1.0 - p).powi(1000))).abs() < 1e-12);
    }
}
