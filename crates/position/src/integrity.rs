//! What makes a solution plausible: the distribution of its residuals, its distance from the Earth's centre,
//! and its geometry.

use super::error::PositioningError;
use nalgebra::{Matrix3, Vector3};
use sdr_rx_gnss::coordinates::Geodetic;

/// Smallest distance from the Earth's centre, m, of a place that is believed: the poles lie at 6357 km.
pub(crate) const MIN_RADIUS: f64 = 6.33e6;
/// Largest such distance, m: 3000 km high, above any low orbit.
pub(crate) const MAX_RADIUS: f64 = 9.4e6;
/// Prior probability of a fault of a satellite at an epoch.
pub(crate) const PRIOR_FAULT: f64 = 1e-3;
/// Probability that the error exceeds the protection level.
pub(crate) const RISK: f64 = 1e-5;
/// Largest protection level of a place that counts as proved, m.
pub(crate) const ALERT_LIMIT_M: f64 = 75.0;
/// Places nearer to each other than this, m, are the same for a person who looks for one.
pub(crate) const DISTINCT_M: f64 = 25.0;
/// Beyond this dilution a range error of 3 m is one of 300 m in position.
const MAX_PDOP: f64 = 100.0;

/// Dilutions of precision, and the rotation to local axes.
pub(crate) struct Geometry {
    to_enu: Matrix3<f64>,
    pub pdop: f64,
    pub hdop: f64,
    pub vdop: f64,
}

impl Geometry {
    /// From the position's part (ECEF) of `(H^T H)^-1`, for `satellites` satellites.
    pub fn new(
        position_m: &Vector3<f64>,
        cofactor: &Matrix3<f64>,
        satellites: usize,
    ) -> Result<Self, PositioningError> {
        let to_enu = Geodetic::from_ecef(position_m).ecef_to_enu();
        let local = to_enu * cofactor * to_enu.transpose();
        let hdop = (local[(0, 0)] + local[(1, 1)]).sqrt();
        let vdop = local[(2, 2)].sqrt();
        let pdop = hdop.hypot(vdop);
        if pdop <= MAX_PDOP {
            return Ok(Self { to_enu, pdop, hdop, vdop });
        }
        let name = "position dilution of precision";
        Err(PositioningError::DegenerateGeometry { satellites, name, value: pdop, limit: MAX_PDOP })
    }

    /// A covariance of the position, from ECEF to east, north, up.
    pub fn local(&self, covariance: &Matrix3<f64>) -> Matrix3<f64> {
        self.to_enu * covariance * self.to_enu.transpose()
    }
}

/// The value that a chi-square variable of `degrees` degrees of freedom exceeds with probability
/// 1e-5 (Wilson and Hilferty 1931; at most 10 % above the exact quantile).
pub(crate) fn chi_square_limit(degrees: usize) -> f64 {
    /// Normal quantile of 1 - 1e-5.
    const Z: f64 = 4.2649;
    let k = degrees as f64;
    let spread = 2.0 / (9.0 * k);
    k * (1.0 - spread + Z * spread.sqrt()).powi(3)
}

/// The value that a standard normal variable exceeds with `probability`, to 5e-4 (Abramowitz and Stegun 26.2.23); 0 for
/// a half and more.
pub(crate) fn tail_quantile(probability: f64) -> f64 {
    if probability >= 0.5 {
        return 0.0;
    }
    let t = (-2.0 * probability.ln()).sqrt();
    let above = 2.515517 + t * (0.802853 + t * 0.010328);
    t - above / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_agree_with_tables() {
        // Abramowitz and Stegun, table 26.6.
        for (probability, z) in [(0.5, 0.0), (0.1, 1.28155), (1e-3, 3.09023), (1e-7, 5.19934)] {
            assert!((tail_quantile(probability) - z).abs() < 5e-4, "{probability}");
        }
    }

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
