//! Signals that cannot come from satellites: all from one direction, or from where none is.
//!
//! A spoofer with one antenna gives every satellite the same signature; satellites in the sky never share
//! one (Montgomery, Humphreys and Ledvina 2009). The test needs no geometry and no calibration: the hypothesis
//! "one direction" says that all signatures are multiples of one vector.

use crate::array::CMat;
use crate::array::geometry::{Arrival, Manifold, Signature};
use nalgebra::{Unit, Vector3};
use sdr_rx_linalg::hermitian_eigen;

/// Signatures at least, for a verdict: fewer satellites share a direction by chance.
pub const LEAST_SIGNATURES: usize = 4;

/// Share of a signature's power that errors of the receiver itself may put beside the common direction:
/// crosstalk and drift of -20 dB.
const TOLERATED: f64 = 0.01;

/// How well one direction explains a set of signatures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneDirection {
    /// Mean share of the signatures' power beside the common direction.
    pub apart: f64,
    /// Share that noise alone puts there.
    pub expected: f64,
    /// Whether all come from one direction.
    pub is_one: bool,
}

/// Tests whether all signatures are multiples of one vector. `None` with too few to tell.
pub fn one_direction(signatures: &[&Signature]) -> Option<OneDirection> {
    let elements = signatures.first()?.response.len();
    let count = signatures.len();
    if count < LEAST_SIGNATURES || elements < 2 {
        return None;
    }
    let norm = (elements as f64).sqrt();
    let stacked = CMat::from_fn(elements, count, |m, k| signatures[k].response[m] / norm);
    let product = &stacked * stacked.adjoint();
    let (values, _) = hermitian_eigen(&product)?;
    let rest: f64 = values[1..].iter().sum();
    let apart = rest / count as f64;
    // Each of the M - 1 other dimensions holds the variance of a response over M; the common vector
    // itself takes one of the signatures' freedom.
    let m = elements as f64;
    let free = (count as f64 - 1.0) / count as f64;
    let mean = signatures.iter().map(|s| s.variance).sum::<f64>() / count as f64;
    let expected = free * (m - 1.0) / m * mean;
    // The sum is Gamma-distributed with (M - 1)(Q - 1) degrees: five deviations.
    let spread = 5.0 * expected / ((m - 1.0) * (count as f64 - 1.0)).sqrt();
    Some(OneDirection { apart, expected, is_one: apart < expected + spread + TOLERATED })
}

/// Difference of a measured arrival from where the satellite is (unit vector in the array's frame), in
/// direction cosines, and whether the two agree within five standard deviations and `tolerance` (for errors
/// of attitude and elements, in the same unit).
pub fn agrees(
    manifold: &Manifold,
    arrival: &Arrival,
    towards: &Unit<Vector3<f64>>,
    tolerance: f64,
) -> (f64, bool) {
    let predicted = manifold.point(towards);
    let apart = (arrival.point[0] - predicted[0]).hypot(arrival.point[1] - predicted[1]);
    let sigma = arrival.sigma[0].hypot(arrival.sigma[1]);
    (apart, apart < tolerance + 5.0 * sigma)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::antenna::AntennaArray;
    use num_complex::Complex64;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    fn signature(response: &[Complex64], variance: f64, rng: &mut impl rand::Rng) -> Signature {
        let mut part = || (variance / 2.0).sqrt() * rng.sample::<f64, _>(StandardNormal);
        let noisy: Vec<_> = response.iter().map(|a| a + Complex64::new(part(), part())).collect();
        let norm = (noisy.iter().map(|z| z.norm_sqr()).sum::<f64>() / noisy.len() as f64).sqrt();
        Signature { response: noisy.iter().map(|z| z / norm).collect(), variance, snr: 1.0 }
    }

    #[test]
    fn one_transmitter_is_told_from_a_sky() {
        let manifold = Manifold::new(AntennaArray::half_wavelength(2));
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for _ in 0..200 {
            let spoofed: Vec<_> =
                (0..5).map(|_| signature(&manifold.response([0.4, 0.0]), 0.02, &mut rng)).collect();
            let verdict = one_direction(&spoofed.iter().collect::<Vec<_>>()).unwrap();
            assert!(verdict.is_one, "{verdict:?}");
            let sky: Vec<_> = [-0.6, -0.2, 0.1, 0.5, 0.7]
                .map(|s| signature(&manifold.response([s, 0.0]), 0.02, &mut rng))
                .into();
            assert!(!one_direction(&sky.iter().collect::<Vec<_>>()).unwrap().is_one);
            assert!(one_direction(&sky[..3].iter().collect::<Vec<_>>()).is_none());
        }
    }
}
