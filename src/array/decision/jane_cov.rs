//! JANE from a covariance: the same decision for thousands of snapshots far below the noise.
//!
//! A satellite is some 20 dB under the noise of a sample, so that 10^4 samples and more are needed. All
//! information on directions is then in R = (1 / T) sum y y^H of T samples, after impulses are suppressed
//! (see [`crate::front_end`]). Deterministic maximum likelihood minimises tr(P R), P = I - A A^+; its
//! Gauss-Newton step for uncorrelated sources is
//!
//! delta_q = \[ p_q Re D_q^H P D_q \]^-1 Re (A^+ R P D_q)_q
//!
//! with p = diag(S) - sigma^2 diag((A^H A)^-1), S = A^+ R A^+H, and the noise sigma^2 = tr(P R) / (M - Q)
//! unless given. The covariance of the result, which at such powers is far from the Cramer-Rao bound of known
//! signals, is sigma^2 S_qq / (2 T p_q^2) \[ Re D_q^H P D_q \]^-1 (Stoica and Nehorai 1990, "Performance study
//! of conditional and unconditional direction-of-arrival estimation", IEEE Trans. ASSP 38(10)).
//!
//! The tests are those of [`super::jane`]: T_q = T S_qq / (sigma^2 (A^H A)^-1_qq) and the scan's
//! T b^H R b / (sigma^2 |b|^2) are Gamma(T, 1) without a source. The elements' noise has to be of equal power
//! to within about 1 / sqrt(T).

use super::jane::{Decision, Jane, JaneError, sorted};
use crate::array::CMat;
use crate::array::geometry::{Manifold, Point, dictionary, inverse};
use crate::front_end::mixture::Mixture;
use sdr_rx_linalg::{Cholesky, adjoint_product, hermitian_eigen, product};

/// Maximum number of iterations, and the step over its standard deviation that ends them.
const ITERATIONS: usize = 60;
const CONVERGED: f64 = 0.01;

impl Jane {
    /// Sources in the sample covariance R (elements x elements) of `samples` independent samples (where
    /// neighbouring samples are correlated, fewer: their number over sum_k |rho_k|^2), whose noise is white
    /// with the variance `noise`, or estimated from R. Starts from the directions `start`, or none.
    ///
    /// Compressed snapshots u_k sqrt(lambda_k - sigma^2), columns of C, represent R = C C^H + sigma^2 I.
    ///
    /// # Errors
    /// [`JaneError::Shape`], [`JaneError::NoPower`].
    pub fn decide_covariance(
        &self,
        covariance: &CMat,
        samples: f64,
        noise: Option<f64>,
        start: &[Point],
    ) -> Result<Decision, JaneError> {
        let elements = self.check(covariance)?;
        if covariance.ncols() != elements {
            let (rows, columns) = covariance.shape();
            return Err(JaneError::Shape { rows, columns, elements });
        }
        let root = square_root(covariance).ok_or(JaneError::NoPower)?;
        let threshold = self.scan.threshold(self.options.false_alarm, samples);
        let most = self.options.max_sources.min(elements - 1);
        let data = CovarianceData { manifold: self.manifold(), r: covariance, samples, noise };

        let start = start.iter().take(most.min(elements / 3)).copied().collect();
        let (mut fit, _) = self.pruned(&data, data.settled(start, self.scan.step()), threshold);
        while fit.points.len() < most {
            let Some((point, power)) = self.scan.strongest(&root, &fit.responses) else {
                break;
            };
            let known: f64 = fit.powers.iter().sum();
            let errors = samples * known * self.mismatch_factor() / fit.noise;
            if samples * power / fit.noise < threshold + errors {
                break;
            }
            let points = fit.points.iter().copied().chain([point]).collect();
            let (next, last_stays) =
                self.pruned(&data, data.settled(points, self.scan.step()), threshold);
            // Otherwise two sources could take turns in replacing each other for ever.
            let is_better = next.points.len() > fit.points.len() || next.outside < fit.outside;
            if is_better {
                fit = next;
            }
            if !(last_stays && is_better) {
                break;
            }
        }
        let sources = (0..fit.points.len())
            .map(|q| {
                self.source(fit.points[q], fit.covariances[q], fit.powers[q], fit.statistics[q])
            })
            .collect();
        let noise =
            Mixture { probability: 0.0, background: fit.noise, impulse: fit.noise, real: false };
        Ok(sorted(Decision { sources, noise, information: 1.0 / fit.noise, threshold }))
    }

    /// Removes the sources that fail, the weakest first; also returns whether the last is kept.
    fn pruned(&self, data: &CovarianceData<'_>, mut fit: Fit, threshold: f64) -> (Fit, bool) {
        let reach = self.scan.step();
        let mut last_stays = true;
        loop {
            let fails = |q: &usize| {
                let [[xx, _], [_, yy]] = fit.covariances[*q];
                fit.statistics[*q] < threshold || xx.max(yy) > reach * reach
            };
            let failing = (0..fit.points.len()).filter(fails);
            let weakest = failing.min_by(|&a, &b| fit.statistics[a].total_cmp(&fit.statistics[b]));
            let Some(weakest) = weakest else { return (fit, last_stays) };
            last_stays &= weakest + 1 < fit.points.len();
            fit.points.remove(weakest);
            fit = data.settled(fit.points, reach);
        }
    }
}

struct CovarianceData<'a> {
    manifold: &'a Manifold,
    r: &'a CMat,
    samples: f64,
    noise: Option<f64>,
}

/// Sources at the minimum of tr(P R), and the estimates of each.
struct Fit {
    points: Vec<Point>,
    responses: CMat,
    noise: f64,
    powers: Vec<f64>,
    statistics: Vec<f64>,
    covariances: Vec<[[f64; 2]; 2]>,
    /// Gauss-Newton step.
    steps: Vec<Point>,
    /// tr(P R).
    outside: f64,
}

impl CovarianceData<'_> {
    /// Descends from these points to the minimum.
    fn settled(&self, points: Vec<Point>, reach: f64) -> Fit {
        let mut fit = self.at(points);
        for _ in 0..ITERATIONS {
            let Some(next) = self.downhill(&fit, reach) else { break };
            let longest = fit.points.iter().zip(&next.points).zip(&fit.covariances);
            let longest = longest.map(|((from, to), covariance)| {
                let relative =
                    |k: usize| (to[k] - from[k]).abs() / covariance[k][k].sqrt().max(1e-300);
                (0..self.manifold.dimensions()).map(relative).fold(0.0, f64::max)
            });
            let longest = longest.fold(0.0, f64::max);
            fit = next;
            if longest < CONVERGED {
                break;
            }
        }
        fit
    }

    /// The step, halved until it descends.
    fn downhill(&self, fit: &Fit, reach: f64) -> Option<Fit> {
        let mut scale = 1.0;
        for _ in 0..5 {
            let moved = fit.points.iter().zip(&fit.steps).map(|(point, step)| {
                let moved = [0, 1].map(|k| point[k] + scale * step[k].clamp(-reach, reach));
                let radius = moved[0].hypot(moved[1]).max(1.0);
                moved.map(|c| c / radius)
            });
            let next = self.at(moved.collect());
            if next.outside < fit.outside {
                return Some(next);
            }
            scale *= 0.5;
        }
        None
    }

    /// All estimates at these points.
    fn at(&self, points: Vec<Point>) -> Fit {
        let (elements, dimensions) = (self.manifold.elements(), self.manifold.dimensions());
        let responses = dictionary(self.manifold, &points);
        let mut gram = adjoint_product(&responses, &responses);
        // Two sources in one position: separated by rounding.
        (0..points.len()).for_each(|q| gram[(q, q)] *= 1.0 + 1e-12);
        let unit = CMat::identity(points.len(), points.len());
        let inverse_gram = match Cholesky::new(&gram) {
            Some(factor) => factor.solve(&unit),
            None => unit,
        };
        let pseudo = product(&inverse_gram, &responses.adjoint().to_owned());
        let seen = product(&pseudo, self.r);
        let signals = product(&seen, &pseudo.adjoint().to_owned());
        // A^+ R P.
        let crossed = &seen - product(&signals, &responses.adjoint().to_owned());
        let total: f64 = (0..elements).map(|m| self.r[(m, m)].re).sum();
        let inside: f64 =
            product(&seen, &responses).diagonal().column_vector().iter().map(|s| s.re).sum();
        let outside = (total - inside).max(f64::MIN_POSITIVE);
        let noise = self.noise.unwrap_or(outside / (elements - points.len()) as f64);

        let mut fit = Fit {
            points,
            responses,
            noise,
            powers: Vec::new(),
            statistics: Vec::new(),
            covariances: Vec::new(),
            steps: Vec::new(),
            outside,
        };
        for (q, point) in fit.points.iter().enumerate() {
            let slopes = self.manifold.derivatives(*point);
            let d = CMat::from_fn(elements, dimensions, |m, k| slopes[k][m]);
            let projection = adjoint_product(&fit.responses, &d);
            let inside = adjoint_product(&projection, &product(&inverse_gram, &projection));
            let curvature = adjoint_product(&d, &d) - inside;
            let slope = product(&crossed, &d);
            let signal = signals[(q, q)].re;
            let beam = noise * inverse_gram[(q, q)].re;
            // A power below its own uncertainty is not divided by.
            let power = (signal - beam).max(beam / self.samples.sqrt());
            let inverse = inverse(|i, j| curvature[(i, j)].re, dimensions);
            let step = |i: usize| {
                let along = (0..dimensions).map(|j| inverse[i][j] * slope[(q, j)].re);
                along.sum::<f64>() / power
            };
            fit.steps.push([step(0), if dimensions > 1 { step(1) } else { 0.0 }]);
            let spread = noise * signal / (2.0 * self.samples * power * power);
            fit.covariances.push(inverse.map(|row| row.map(|v| spread * v)));
            fit.statistics.push(self.samples * signal / beam);
            fit.powers.push((signal - beam).max(0.0));
        }
        fit
    }
}

/// A matrix B with B B^H = R, negative eigenvalues left out; `None` where there is none.
fn square_root(r: &CMat) -> Option<CMat> {
    let (values, mut root) = hermitian_eigen(r)?;
    for (k, value) in values.iter().enumerate() {
        let scale = value.max(0.0).sqrt();
        root.col_as_slice_mut(k).iter_mut().for_each(|u| *u *= scale);
    }
    Some(root)
}
