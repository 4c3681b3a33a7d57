//! The law of the residuals.

/// The value that a chi-square variable of `degrees` degrees of freedom exceeds with probability
/// 1e-5 (Wilson and Hilferty 1931; at most 10 % above the exact quantile).
pub(super) fn chi_square_limit(degrees: usize) -> f64 {
    /// Normal quantile of 1 - 1e-5.
    const Z: f64 = 4.2649;
    let k = degrees as f64;
    let spread = 2.0 / (9.0 * k);
    k * (1.0 - spread + Z * spread.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_agrees_with_tables() {
        // For 2 degrees of freedom the tail is exp(-x/2), for 4 (1 + x/2) exp(-x/2).
        let tail2 = (-chi_square_limit(2) / 2.0).exp();
        let x = chi_square_limit(4) / 2.0;
        let tail4 = (1.0 + x) * (-x).exp();
        assert!((0.4e-5..1e-5).contains(&tail2), "{tail2}");
        assert!((0.5e-5..1e-5).contains(&tail4), "{tail4}");
    }
}
