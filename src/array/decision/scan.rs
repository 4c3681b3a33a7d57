//! The scan: the direction of maximum power over the manifold, and the distribution of this power under
//! noise.
//!
//! A beam's statistic is the sum over N snapshots of |a^H e_n|^2 / |a|^2, with noise e of unit variance:
//! Gamma(N, 1), half a chi-square of 2 N degrees of freedom. Its maximum over all directions exceeds t with a
//! probability below the expected Euler characteristic of the set above t (Davies 1987; Worsley 1994, table
//! II), which is exact up to e^-t:
//!
//! P(max > t) = Q(t) + L sqrt(t / pi) f(t) + S (2 t - 2 N + 1) / (2 pi) f(t)
//!
//! with f and Q the density and the tail of Gamma(N, 1), L the length of the interval of directions (half
//! the circumference of the disc) and S its area (0 for a linear array), both measured by the metric
//! Lambda_ij = Re d_i^H P d_j / |a|^2, where d_i is the response's derivative and P removes a. For a uniform
//! linear array of M elements half a wavelength apart, L = 2 pi sqrt((M^2 - 1) / 12).

use crate::array::CMat;
use crate::array::geometry::{Manifold, Point};
use num_complex::Complex64;
use sdr_rx_linalg::{adjoint_product, column_powers, orthonormal_basis, product, subtracted_from};
use std::f64::consts::PI;

/// A beam with less than this fraction of its power outside of the span of the sources found is not used: a
/// start so close to a source would be ill-conditioned, and the fit moves sources closer if the data require
/// it.
const MIN_NEW: f64 = 0.1;

/// A grid of beams over a manifold, and their distribution under noise.
#[derive(Clone, Debug)]
pub struct Scan {
    manifold: Manifold,
    points: Vec<Point>,
    responses: CMat,
    step: f64,
    length: f64,
    area: f64,
}

impl Scan {
    /// Beams a quarter of a beamwidth apart. A manifold without dimension has one beam.
    pub fn new(manifold: &Manifold) -> Self {
        let [[xx, xy], [_, yy]] = metric(manifold);
        let mean = 0.5 * (xx + yy);
        let half_gap = (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        let (major, minor) = (mean + half_gap, (mean - half_gap).max(0.0));
        let (length, area) = match manifold.dimensions() {
            0 => (0.0, 0.0),
            1 => (2.0 * major.sqrt(), 0.0),
            // The circumference of an ellipse is about 2 pi times the root mean square of its axes.
            _ => (PI * mean.sqrt(), PI * (major * minor).sqrt()),
        };
        // A uniform linear array of equal spread would have this many elements.
        let elements = (12.0 * major).sqrt() / PI;
        let per_axis = (4.0 * elements).ceil().max(8.0);
        let points = manifold.grid(per_axis as usize);
        let columns: Vec<_> = points.iter().map(|p| manifold.response(*p)).collect();
        let responses = CMat::from_fn(manifold.elements(), points.len(), |m, l| columns[l][m]);
        Self { manifold: manifold.clone(), points, responses, step: 2.0 / per_axis, length, area }
    }

    /// The array's manifold.
    pub fn manifold(&self) -> &Manifold {
        &self.manifold
    }

    /// Distance of neighbouring beams along an axis, a quarter of a beamwidth.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Probability that noise alone makes a beam's statistic exceed `t` somewhere, of `n` snapshots; valid
    /// where it is small, `t` well above `n`.
    pub fn false_alarm(&self, t: f64, n: f64) -> f64 {
        if t <= n {
            return 1.0;
        }
        let density = gamma_density(t, n);
        let line = self.length * (t / PI).sqrt();
        let plane = self.area * (2.0 * t - 2.0 * n + 1.0) / (2.0 * PI);
        (gamma_tail(t, n) + (line + plane) * density).min(1.0)
    }

    /// The value that noise alone exceeds somewhere with this probability, of `n` snapshots.
    pub fn threshold(&self, false_alarm: f64, n: f64) -> f64 {
        let (mut low, mut high) = (n, n + 1.0);
        while self.false_alarm(high, n) > false_alarm {
            high += high - n;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.false_alarm(middle, n) > false_alarm { low = middle } else { high = middle }
        }
        high
    }

    /// The point with the maximum sum of |b^H e|^2 / |b|^2 over the columns e of `data`, and that sum, where
    /// b is the part of the point's response outside of the span of the columns of `known`. `None` when no
    /// part of the manifold lies outside.
    pub fn strongest(&self, data: &CMat, known: &CMat) -> Option<(Point, f64)> {
        let basis = (known.ncols() > 0).then(|| orthonormal_basis(known));
        // A column per beam.
        let mut seen = adjoint_product(data, &self.responses);
        let mut new = column_powers(&self.responses);
        if let Some(basis) = &basis {
            let inside = adjoint_product(basis, &self.responses);
            seen = subtracted_from(&seen, product(&adjoint_product(data, basis), &inside));
            for (new, inside) in new.iter_mut().zip(column_powers(&inside)) {
                let left = *new - inside;
                *new = if left > MIN_NEW * *new { left } else { f64::INFINITY };
            }
        }
        let seen = column_powers(&seen);
        let scores = seen.iter().zip(&new).map(|(seen, new)| seen / new);
        let (best, score) = scores.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        (score > 0.0).then(|| self.climb(self.points[best], score, data, basis.as_ref()))
    }

    /// Refines the maximum between the grid's points.
    fn climb(&self, from: Point, score: f64, data: &CMat, basis: Option<&CMat>) -> (Point, f64) {
        let (mut best, mut step) = ((from, score), self.step);
        for _ in 0..4 {
            step *= 0.5;
            for axis in 0..self.manifold.dimensions() {
                let from = best.0;
                for sign in [-1.0, 1.0] {
                    let mut point = from;
                    point[axis] += sign * step;
                    let score = self.score(point, data, basis);
                    if score > best.1 {
                        best = (point, score);
                    }
                }
            }
        }
        best
    }

    fn score(&self, point: Point, data: &CMat, basis: Option<&CMat>) -> f64 {
        if point[0].hypot(point[1]) > 1.0 {
            return 0.0;
        }
        let response = self.manifold.response(point);
        let mut a = CMat::from_fn(response.len(), 1, |m, _| response[m]);
        let whole = column_powers(&a)[0];
        if let Some(basis) = basis {
            a = subtracted_from(&a, product(basis, &adjoint_product(basis, &a)));
        }
        let new = column_powers(&a)[0];
        if new > MIN_NEW * whole { column_powers(&adjoint_product(data, &a))[0] / new } else { 0.0 }
    }
}

/// Lambda of the module's documentation, at the middle of the manifold.
fn metric(manifold: &Manifold) -> [[f64; 2]; 2] {
    let dot = |a: &[Complex64], b: &[Complex64]| -> Complex64 {
        a.iter().zip(b).map(|(a, b)| a.conj() * b).sum()
    };
    let a = manifold.response([0.0; 2]);
    let slopes = manifold.derivatives([0.0; 2]);
    let power = dot(&a, &a).re;
    let mut metric = [[0.0; 2]; 2];
    for (i, di) in slopes.iter().enumerate() {
        for (j, dj) in slopes.iter().enumerate() {
            let along = dot(di, &a) * dot(&a, dj) / power;
            metric[i][j] = (dot(di, dj) - along).re / power;
        }
    }
    metric
}

/// Density of Gamma(n, 1).
fn gamma_density(t: f64, n: f64) -> f64 {
    ((n - 1.0) * t.ln() - t - ln_gamma(n)).exp()
}

/// Probability that Gamma(n, 1), n a whole number, exceeds t: f(t) (1 + (n-1)/t + (n-1)(n-2)/t^2 + ...).
fn gamma_tail(t: f64, n: f64) -> f64 {
    let (mut term, mut sum, mut left) = (1.0, 1.0, n - 1.0);
    while left > 0.0 && term > 1e-17 * sum {
        term *= left / t;
        sum += term;
        left -= 1.0;
    }
    gamma_density(t, n) * sum
}

/// Logarithm of the gamma function for x >= 1: Stirling's series after eight steps up; the first term
/// omitted, 1 / (1188 x^9) at 9, is 2e-12.
fn ln_gamma(x: f64) -> f64 {
    let product: f64 = (0..8).map(|k| x + f64::from(k)).product();
    let x = x + 8.0;
    let series = 1.0 / (12.0 * x) - 1.0 / (360.0 * x.powi(3)) + 1.0 / (1260.0 * x.powi(5))
        - 1.0 / (1680.0 * x.powi(7));
    (x - 0.5) * x.ln() - x + 0.5 * (2.0 * PI).ln() + series - product.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::antenna::AntennaArray;

    #[test]
    fn the_gamma_distribution_is_the_closed_form() {
        // 19! from tables, and chi-square tables: P(chi2 of 10 > 18.307) = 5 %, of 100: > 149.449 = 0.1 %.
        assert!((ln_gamma(20.0) - 121_645_100_408_832_000f64.ln()).abs() < 1e-11);
        assert!((ln_gamma(1.0)).abs() < 1e-11);
        assert!((gamma_tail(18.307 / 2.0, 5.0) - 0.05).abs() < 1e-5);
        // The last digit of the table is half a thousandth, the density there 3.4e-4.
        assert!((gamma_tail(149.449 / 2.0, 50.0) - 1e-3).abs() < 1e-7);
        // The 2e-12 of ln_gamma(1), of a twentieth.
        assert!((gamma_tail(3.0, 1.0) - (-3f64).exp()).abs() < 2e-13);
        // Many snapshots: normal, with a skewness of 2 / sqrt n. P(z > 3.0902) = 1e-3.
        let (n, z) = (1e6f64, 3.0902f64);
        let skewed = z + (z * z - 1.0) * 2.0 / n.sqrt() / 6.0;
        assert!((gamma_tail(n + skewed * n.sqrt(), n) / 1e-3 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_metric_of_a_uniform_line_is_its_closed_form() {
        let scan = Scan::new(&Manifold::new(AntennaArray::half_wavelength(8)));
        assert!((scan.length - 2.0 * PI * (63.0f64 / 12.0).sqrt()).abs() < 1e-9);
        assert_eq!(scan.area, 0.0);
    }

    #[test]
    fn the_maximum_of_noise_exceeds_the_threshold_with_the_requested_probability() {
        use crate::gnss::random::SplitMix64;
        use crate::gnss::signal::L1_WAVELENGTH;
        use nalgebra::Vector3;
        let at =
            |k: usize| Vector3::new((k % 3) as f64, (k / 3) as f64, 0.0) * (L1_WAVELENGTH / 2.0);
        let arrays =
            [AntennaArray::half_wavelength(8), AntennaArray::new((0..9).map(at).collect())];
        for array in arrays {
            let elements = array.len();
            let scan = Scan::new(&Manifold::new(array));
            let (mut rng, snapshots, runs) = (SplitMix64::new(3), 10, 3000);
            let threshold = scan.threshold(0.02, snapshots as f64);
            let exceeds = |_: &i32| {
                let noise = CMat::from_fn(elements, snapshots, |_, _| rng.complex_normal());
                scan.strongest(&noise, &CMat::zeros(elements, 0)).unwrap().1 > threshold
            };
            // Binomial: mean 60, standard deviation 7.7, four of them. The formula counts double exceedances
            // twice (some 2 %), and the last step of the refinement, 1/64 of a beam, misses 0.1 % of the
            // power.
            let alarms = (0..runs).filter(exceeds).count();
            assert!((29..=91).contains(&alarms), "{elements} elements: {alarms} of {runs}");
        }
    }

    #[test]
    fn a_plane_wave_is_found_between_the_beams() {
        let manifold = Manifold::new(AntennaArray::half_wavelength(8));
        let scan = Scan::new(&manifold);
        let at = [0.3217, 0.0];
        let a = manifold.response(at);
        let data = CMat::from_fn(8, 1, |m, _| a[m]);
        let (point, score) = scan.strongest(&data, &CMat::zeros(8, 0)).unwrap();
        // The refinement ends within a thirty-second of the grid's step, 1/16: 1e-3 of the power there.
        assert!((point[0] - at[0]).abs() < 2e-3 && (score / 8.0 - 1.0).abs() < 1e-3);
        // Nothing of it remains outside of its own response.
        let (_, rest) = scan.strongest(&data, &data).unwrap();
        assert!(rest < 1e-20);
    }
}
