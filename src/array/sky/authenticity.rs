//! Signals that cannot come from satellites: all from one direction, or from wrong directions.
//!
//! A spoofer with one antenna gives every satellite the same signature; real satellites never have equal ones
//! (Montgomery, Humphreys and Ledvina 2009). The test requires no geometry and no calibration: under the
//! hypothesis "one direction" all signatures are multiples of one vector.

use crate::array::CMat;
use crate::array::geometry::{Arrival, Manifold, Signature};
use nalgebra::{Unit, Vector3};
use sdr_rx_linalg::hermitian_eigen;

/// Minimum number of signatures for a result: fewer satellites may have one direction by chance.
pub const MIN_SIGNATURES: usize = 4;

/// Fraction of a signature's power orthogonal to the common direction that errors of the receiver itself may
/// cause: crosstalk and drift of -20 dB.
const TOLERATED: f64 = 0.01;

/// Test of one direction for a set of signatures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneDirection {
    /// Mean fraction of the signatures' power orthogonal to the common direction.
    pub apart: f64,
    /// The fraction expected from noise alone.
    pub expected: f64,
    /// Whether all come from one direction.
    pub is_one: bool,
}

/// Tests whether all signatures are multiples of one vector. `None` with too few for a result.
pub fn one_direction(signatures: &[&Signature]) -> Option<OneDirection> {
    let elements = signatures.first()?.response.len();
    let count = signatures.len();
    if count < MIN_SIGNATURES || elements < 2 {
        return None;
    }
    let norm = (elements as f64).sqrt();
    let stacked = CMat::from_fn(elements, count, |m, k| signatures[k].response[m] / norm);
    let product = &stacked * stacked.adjoint();
    let (values, _) = hermitian_eigen(&product)?;
    let rest: f64 = values[1..].iter().sum();
    let apart = rest / count as f64;
    // Each of the M - 1 other dimensions holds the variance of a response over M; the common vector takes one
    // degree of freedom of the signatures.
    let m = elements as f64;
    let free = (count as f64 - 1.0) / count as f64;
    let mean = signatures.iter().map(|s| s.variance).sum::<f64>() / count as f64;
    let expected = free * (m - 1.0) / m * mean;
    // The sum is Gamma-distributed with (M - 1)(Q - 1) degrees of freedom: five standard deviations.
    let spread = 5.0 * expected / ((m - 1.0) * (count as f64 - 1.0)).sqrt();
    Some(OneDirection { apart, expected, is_one: apart < expected + spread + TOLERATED })
}

/// Difference of a measured arrival from the direction of the satellite (unit vector in the array's frame),
/// in direction cosines, and whether the two agree within five standard deviations and `tolerance` (for
/// errors of attitude and elements, in the same unit).
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
    fn one_transmitter_is_distinguished_from_several_satellites() {
        let manifold = Manifold::new(AntennaArray::half_wavelength(2));
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for _ in 0..200 {
            let spoofed: Vec<_> =
                (0..5).map(|_| signature(&manifold.response([0.4, 0.0]), 0.02, &mut rng)).collect();
            let verdict = one_direction(&spoofed.iter().collect::<Vec<_>>()).unwrap();
            assert!(verdict.is_one, "{verdict:?}");
            let satellites: Vec<_> = [-0.6, -0.2, 0.1, 0.5, 0.7]
                .map(|s| signature(&manifold.response([s, 0.0]), 0.02, &mut rng))
                .into();
            assert!(!one_direction(&satellites.iter().collect::<Vec<_>>()).unwrap().is_one);
            assert!(one_direction(&satellites[..3].iter().collect::<Vec<_>>()).is_none());
        }
    }
}
