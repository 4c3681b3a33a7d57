//! The spatial signature of one signal: the response of each element, measured after despreading.
//!
//! Despread prompts x_k (one vector of all elements per code period) of one satellite are a d_k + n_k, with
//! its signature a, data and carrier d_k, and noise that is equal and independent between elements. The
//! maximum-likelihood signature for unknown d_k is the principal eigenvector of their covariance (van Trees,
//! Optimum Array Processing, 8.5), which requires no data, phase or geometry.

use super::{Bearing, Manifold, Point};
use crate::array::CMat;
use num_complex::Complex64;
use sdr_rx_linalg::hermitian_eigen;

/// Minimum fraction of a response's power outside of the jammers' subspace for a direction to be considered.
const MIN_VISIBLE: f64 = 0.02;

/// A measured signature.
#[derive(Clone, Debug, PartialEq)]
pub struct Signature {
    /// Response of each element: the squared norm is the number of elements, the first is real and
    /// positive (where it is not zero).
    pub response: Vec<Complex64>,
    /// Variance of each response (complex), in the same unit.
    pub variance: f64,
    /// Signal over noise power of one element in one code period.
    pub snr: f64,
}

impl Signature {
    /// From prompts, one column per code period. `None` with fewer than two elements or periods, or without
    /// any power above the noise.
    pub fn estimate(prompts: &CMat) -> Option<Self> {
        let (elements, periods) = prompts.shape();
        if elements < 2 || periods < 2 {
            return None;
        }
        let covariance = prompts * prompts.adjoint();
        let (values, vectors) = hermitian_eigen(&covariance)?;
        let total: f64 = values.iter().sum();
        let (largest, count, m) = (values[0], periods as f64, elements as f64);
        let noise = (total - largest) / ((m - 1.0) * count);
        let signal = largest / count - noise;
        if !(signal > 0.0 && signal.is_finite()) {
            return None;
        }
        let vector = vectors.col(0);
        let phase = vector[0].conj() / vector[0].norm();
        let phase = if phase.is_finite() { phase } else { Complex64::ONE };
        let response = (0..elements).map(|k| vector[k] * phase * m.sqrt()).collect();
        let snr = signal / (m * noise.max(f64::MIN_POSITIVE));
        let variance = (1.0 + 1.0 / (m * snr)) / (count * snr);
        Some(Self { response, variance, snr })
    }

    /// Fraction of this signature's power that lies along another: 1 for signals from one direction.
    pub fn coherence(&self, other: &Self) -> f64 {
        let m = self.response.len() as f64;
        inner(&self.response, &other.response).norm_sqr() / (m * m)
    }
}

/// a^H b.
fn inner(a: &[Complex64], b: &[Complex64]) -> Complex64 {
    a.iter().zip(b).map(|(a, b)| a.conj() * b).sum()
}

/// Direction of arrival of a signature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// On the manifold.
    pub point: Point,
    /// Standard deviation of each coordinate: the Cramer-Rao bound at the signature's variance.
    pub sigma: Point,
    /// As angles.
    pub bearing: Bearing,
    /// Fraction of the signature's power that the manifold does not explain, 0 to 1: noise, errors of the
    /// elements, or multipath.
    pub misfit: f64,
}

/// The direction that explains a signature best: the maximum of a beam scan, refined by Gauss-Newton. `None`
/// when the array cannot resolve directions or has another number of elements.
pub fn arrival(manifold: &Manifold, signature: &Signature) -> Option<Arrival> {
    let elements = manifold.elements();
    let z = &signature.response;
    if manifold.dimensions() == 0 || z.len() != elements {
        return None;
    }
    let explained = |point: Point| {
        let a = manifold.response(point);
        let norm = inner(&a, &a).re;
        // In the direction of a jammer that was removed nothing remains.
        if norm > MIN_VISIBLE * elements as f64 { inner(&a, z).norm_sqr() / norm } else { 0.0 }
    };
    // Four points a beamwidth in each direction; the scalloping between them is below 0.3 dB.
    let across = 4 * if manifold.dimensions() == 1 { elements } else { 8.max(elements / 2) };
    let scan = manifold.grid(across).into_iter().map(|p| (explained(p), p));
    let mut point = scan.max_by(|a, b| a.0.total_cmp(&b.0))?.1;
    let mut information = [[0.0; 2]; 2];
    for _ in 0..20 {
        let (step, fisher) = newton_step(manifold, z, point);
        information = fisher;
        let reach = step[0].hypot(step[1]);
        if !reach.is_finite() {
            break;
        }
        // Halved until the fit does not become worse.
        let now = explained(point);
        let tried = (0..8).map(|k| 0.5f64.powi(k)).map(|scale| {
            let moved = [point[0] + scale * step[0], point[1] + scale * step[1]];
            inside(moved)
        });
        let Some(better) = tried.into_iter().find(|p| explained(*p) >= now) else { break };
        point = better;
        if reach < 1e-9 {
            break;
        }
    }
    let power = inner(z, z).re;
    let [[a, b], [_, d]] = information.map(|row| row.map(|x| 2.0 * x / signature.variance));
    let sigma = match manifold.dimensions() {
        1 => [(1.0 / a).sqrt(), 0.0],
        _ => [(d / (a * d - b * b)).sqrt(), (a / (a * d - b * b)).sqrt()],
    };
    let misfit = (1.0 - explained(point) / power).max(0.0);
    Some(Arrival { point, sigma, bearing: manifold.bearing(point), misfit })
}

/// The nearest point in the visible disc.
fn inside(point: Point) -> Point {
    let reach = point[0].hypot(point[1]).max(1.0);
    point.map(|p| p / reach)
}

/// One Gauss-Newton step of min |z - c a(point)|^2 over c and the point, and the Fisher information of the
/// coordinates for noise of unit variance up to a factor of 2: |c|^2 Re D^H P D, where P projects a out.
fn newton_step(manifold: &Manifold, z: &[Complex64], point: Point) -> (Point, [[f64; 2]; 2]) {
    let a = manifold.response(point);
    let norm = inner(&a, &a).re;
    let gain = inner(&a, z) / norm;
    let residual: Vec<Complex64> = z.iter().zip(&a).map(|(z, a)| z - gain * a).collect();
    let slopes: Vec<Vec<Complex64>> = manifold
        .derivatives(point)
        .into_iter()
        .map(|d| {
            let along = inner(&a, &d) / norm;
            d.iter().zip(&a).map(|(d, a)| gain * (d - along * a)).collect()
        })
        .collect();
    let product = |i: usize, k: usize| inner(&slopes[i], &slopes[k]).re;
    let score = |i: usize| inner(&slopes[i], &residual).re;
    if slopes.len() == 1 {
        let fisher = product(0, 0);
        return ([score(0) / fisher, 0.0], [[fisher, 0.0], [0.0, 0.0]]);
    }
    let (a, b, d) = (product(0, 0), product(0, 1), product(1, 1));
    let determinant = a * d - b * b;
    let step =
        [(d * score(0) - b * score(1)) / determinant, (a * score(1) - b * score(0)) / determinant];
    (step, [[a, b], [b, d]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::antenna::AntennaArray;
    use nalgebra::Vector3;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    fn square() -> Manifold {
        let half = crate::gnss::signal::L1_WAVELENGTH / 2.0;
        let at = |x: f64, y: f64| Vector3::new(x * half, y * half, 0.0);
        Manifold::new(AntennaArray::new(vec![at(0., 0.), at(1., 0.), at(0., 1.), at(1., 1.)]))
    }

    /// Prompts of a signal from `point` with `snr` per element and period, data symbols and a carrier offset.
    fn prompts(manifold: &Manifold, point: Point, snr: f64, periods: usize, seed: u64) -> CMat {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let a = manifold.response(point);
        CMat::from_fn(manifold.elements(), periods, |m, k| {
            let bit = if (k / 20) % 3 == 1 { -1.0 } else { 1.0 };
            let carrier = Complex64::from_polar(snr.sqrt() * bit, 0.07 * k as f64);
            let mut part = || 0.5f64.sqrt() * rng.sample::<f64, _>(StandardNormal);
            a[m] * carrier + Complex64::new(part(), part())
        })
    }

    #[test]
    fn directions_reach_the_cramer_rao_bound() {
        let line = Manifold::new(AntennaArray::half_wavelength(8));
        for (manifold, point) in
            [(line, [0.3, 0.0]), (square(), [0.3, -0.5]), (square(), [-0.1, 0.2])]
        {
            let runs = 200;
            let mut squares = [0.0; 2];
            for seed in 0..runs {
                let signature =
                    Signature::estimate(&prompts(&manifold, point, 0.5, 100, seed)).unwrap();
                let found = arrival(&manifold, &signature).unwrap();
                for axis in 0..manifold.dimensions() {
                    let error = (found.point[axis] - point[axis]) / found.sigma[axis];
                    squares[axis] += error * error / runs as f64;
                }
                // Noise alone explains the misfit: M - 1 of M dimensions.
                assert!(found.misfit < 10.0 * signature.variance);
            }
            for square in &squares[..manifold.dimensions()] {
                // Chi-square of 200 degrees over 200: 1 +- 5 x 0.1.
                assert!((0.5..1.5).contains(square), "{squares:?}");
            }
        }
    }

    #[test]
    fn the_signature_has_the_stated_variance_and_strength() {
        let manifold = square();
        let (point, snr, periods) = ([0.2, 0.6], 2.0, 50);
        let truth = manifold.response(point);
        let turn = truth[0].conj() / truth[0].norm();
        let runs = 400;
        let mut error = 0.0;
        let mut strength = 0.0;
        for seed in 0..runs {
            let s = Signature::estimate(&prompts(&manifold, point, snr, periods, seed)).unwrap();
            strength += s.snr / runs as f64;
            // Apart from the common factor, which is arbitrary.
            let c = inner(&truth, &s.response) / 4.0;
            let apart: f64 =
                truth.iter().zip(&s.response).map(|(t, z)| (z - c * t).norm_sqr()).sum();
            error += apart / (3.0 * s.variance * runs as f64);
            assert!((s.response[0].im).abs() < 1e-12 && (turn * truth[1]).norm() > 0.0);
        }
        // Means of 400 values of relative standard deviations 1/sqrt(3) and 0.25 at most: five of theirs.
        assert!((error - 1.0).abs() < 0.15, "{error}");
        assert!((strength / snr - 1.0).abs() < 0.07, "{strength}");
    }
}
