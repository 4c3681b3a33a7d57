//! Robust maximum likelihood: directions and signals of a given number of sources in impulsive noise.
//!
//! The model of snapshot n is y_n = A(theta) x_n + e_n, the samples of e being independent draws from a
//! mixture of two circular Gaussians. Expectation maximisation replaces the mixture by weights w = E\[1 /
//! variance | residual\] (Dempster, Laird and Rubin 1977), so that each iteration is a weighted least-squares
//! problem: with W_n = diag(w), G_n = A^H W_n A, D the derivatives of A by the coordinates and P_n = W_n -
//! W_n A G_n^-1 A^H W_n, the Gauss-Newton step of the coordinates, signals eliminated, solves
//!
//! H delta = g,  H_pq = sum_n Re conj(x_pn) x_qn d_p^H P_n d_q,  g_p = sum_n Re conj(x_pn) d_p^H P_n r_n
//!
//! and the signals follow linearly. A step that raises sum w |r|^2 is halved, hence the likelihood never
//! falls. The distribution of the noise is improved by one iteration along with each set of weights; the
//! residuals' powers are scaled by M / (M - Q) for the Q unknowns that each snapshot of M samples determines.

use crate::array::CMat;
use crate::array::geometry::{Manifold, Point, dictionary};
use crate::front_end::mixture::{Mixture, PowerHistogram};
use faer::Mat;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use sdr_rx_linalg::{adjoint_product, product, real_product, subtracted_from};

/// Estimates of sources, their signals and the distribution of the noise during the maximisation.
pub(super) struct RobustFit<'a> {
    manifold: &'a Manifold,
    data: &'a CMat,
    /// Maximum step of a coordinate.
    reach: f64,
    points: Vec<Point>,
    /// Sources x snapshots.
    signals: CMat,
    residual: CMat,
    noise: Mixture,
    weights: Mat<f64>,
    /// Mean of w, and of w^2 |r|^2, the Fisher information of a sample.
    mean_weight: f64,
    information: f64,
    normal: Option<Normal>,
}

/// The normal equations of one iteration.
struct Normal {
    /// Of each snapshot: the Cholesky factor of G, of L^-1 A^H W D a column per coordinate, L^-1 A^H W r.
    blocks: Vec<Complex64>,
    hessian: DMatrix<f64>,
    force: DVector<f64>,
}

impl<'a> RobustFit<'a> {
    /// A fit without sources yet; `None` when there is no power in the data.
    pub fn new(manifold: &'a Manifold, data: &'a CMat, reach: f64) -> Option<Self> {
        let mut fit = Self {
            manifold,
            data,
            reach,
            points: Vec::new(),
            signals: CMat::zeros(0, data.ncols()),
            residual: data.clone(),
            noise: Mixture { probability: 0.0, background: 1.0, impulse: 1.0, real: false },
            weights: Mat::zeros(data.nrows(), data.ncols()),
            mean_weight: 0.0,
            information: 0.0,
            normal: None,
        };
        fit.start_noise();
        (fit.noise.background > 0.0 && fit.mean_weight.is_finite()).then_some(fit)
    }

    pub fn points(&self) -> &[Point] {
        &self.points
    }

    pub fn noise(&self) -> Mixture {
        self.noise
    }

    /// The mean of w^2 |r|^2: the Fisher information of a sample, 1 / variance of Gaussian noise.
    pub fn information(&self) -> f64 {
        self.information
    }

    /// Responses to the sources, a column each.
    pub fn responses(&self) -> CMat {
        dictionary(self.manifold, &self.points)
    }

    /// Adds a source without power yet. So far its power counted as noise: impulses may be weaker and rarer
    /// than they seemed, or hidden, so the mixture restarts with some.
    pub fn add(&mut self, point: Point) {
        self.noise.probability = self.noise.probability.clamp(0.05, 0.5);
        self.noise.impulse = self.noise.impulse.max(10.0 * self.noise.background);
        let (rows, columns) = self.signals.shape();
        self.points.push(point);
        self.signals.resize_with(rows + 1, columns, |_, _| Complex64::ZERO);
    }

    /// Removes the sources for which `keep` is false.
    pub fn retain(&mut self, keep: &[bool]) {
        let kept: Vec<usize> = (0..keep.len()).filter(|&q| keep[q]).collect();
        self.points = kept.iter().map(|&q| self.points[q]).collect();
        self.signals =
            CMat::from_fn(kept.len(), self.signals.ncols(), |q, n| self.signals[(kept[q], n)]);
    }

    /// Initial noise: impulses with probability 0.1 and ten times the variance that the median gives.
    fn start_noise(&mut self) {
        let columns = (0..self.data.ncols()).flat_map(|n| self.residual.col_as_slice(n));
        let mut powers: Vec<f64> = columns.map(|r| r.norm_sqr()).collect();
        let middle = powers.len() / 2;
        let mean = powers.iter().sum::<f64>() / powers.len() as f64;
        let (_, median, _) = powers.select_nth_unstable_by(middle, f64::total_cmp);
        // Where most samples are zero the median is 0, and the mean is used.
        let background = if *median > 0.0 { *median / std::f64::consts::LN_2 } else { mean };
        self.noise =
            Mixture { probability: 0.1, background, impulse: 10.0 * background, real: false };
        self.weigh();
    }

    /// Fits the distribution of the noise again, from the residual alone.
    pub fn refit_noise(&mut self) {
        let mut powers = PowerHistogram::default();
        let scale = self.residual_scale();
        for n in 0..self.data.ncols() {
            let column = self.residual.col_as_slice(n).iter();
            column.for_each(|r| powers.add((scale * r.norm_sqr()) as f32));
        }
        if let Some(noise) = Mixture::fit(&powers, false) {
            self.noise = noise;
        }
        self.weigh();
    }

    /// At most so many iterations, or until no step exceeds this fraction of its standard deviation.
    pub fn settle(&mut self, rounds: usize, settled: f64) {
        // A new source has its first signal after one iteration, its first step after two.
        for k in 0..rounds {
            if self.round() < settled && k >= 2 {
                break;
            }
        }
    }

    /// M / (M - Q).
    fn residual_scale(&self) -> f64 {
        let elements = self.data.nrows() as f64;
        elements / (elements - self.points.len() as f64).max(1.0)
    }

    /// Weights of the residual under the noise, and the noise's next iteration from the same probabilities.
    fn weigh(&mut self) {
        let scale = self.residual_scale();
        let Mixture { probability, background: v1, impulse: v2, .. } = self.noise;
        let (prior, slope) = (probability / (1.0 - probability) * v1 / v2, 1.0 / v1 - 1.0 / v2);
        let [mut impulses, mut impulse_power, mut power, mut weight, mut information] = [0.0; 5];
        for n in 0..self.data.ncols() {
            let weights = self.weights.col_as_slice_mut(n);
            for (w, r) in weights.iter_mut().zip(self.residual.col_as_slice(n)) {
                let p = scale * r.norm_sqr();
                let ratio = prior * (p * slope).min(600.0).exp();
                let impulse = ratio / (1.0 + ratio);
                *w = 1.0 / v1 - impulse * slope;
                impulses += impulse;
                impulse_power += impulse * p;
                power += p;
                weight += *w;
                information += *w * *w * p;
            }
        }
        let count = (self.data.nrows() * self.data.ncols()) as f64;
        self.mean_weight = weight / count;
        self.information = information / count;
        let background = (power - impulse_power) / (count - impulses);
        if background > 0.0 && impulses > 0.0 {
            let impulse = (impulse_power / impulses).max(background);
            self.noise =
                Mixture { probability: impulses / count, background, impulse, real: false };
        }
    }

    /// One iteration; returns the longest step over its standard deviation.
    fn round(&mut self) -> f64 {
        self.weigh();
        if self.points.is_empty() {
            return 0.0;
        }
        let normal = self.normal_equations();
        let mut hessian = normal.hessian.clone();
        let ridge = 1e-9 * hessian.diagonal().max() + f64::MIN_POSITIVE;
        (0..hessian.nrows()).for_each(|p| hessian[(p, p)] += ridge);
        let solved = hessian.cholesky().map(|factor| factor.solve(&normal.force));
        let mut step = solved.unwrap_or_else(|| DVector::zeros(normal.force.len()));
        step.iter_mut().for_each(|d| *d = d.clamp(-self.reach, self.reach));

        let before = self.weighted_power(&self.residual);
        for halvings in 0..6 {
            if halvings == 5 {
                step.fill(0.0);
            }
            let points = self.moved(&step);
            let signals = self.corrected(&normal, &step);
            let model = product(&dictionary(self.manifold, &points), &signals);
            let residual = subtracted_from(self.data, model);
            if halvings == 5 || self.weighted_power(&residual) <= before {
                (self.points, self.signals, self.residual) = (points, signals, residual);
                break;
            }
            step *= 0.5;
        }
        let sizes = step.iter().enumerate().map(|(p, d)| d.abs() * normal.hessian[(p, p)].sqrt());
        let longest = sizes.fold(0.0, f64::max);
        self.normal = Some(normal);
        longest
    }

    fn weighted_power(&self, residual: &CMat) -> f64 {
        let columns = (0..residual.ncols()).map(|n| {
            let pairs = residual.col_as_slice(n).iter().zip(self.weights.col_as_slice(n));
            pairs.map(|(r, w)| w * r.norm_sqr()).sum::<f64>()
        });
        columns.sum()
    }

    /// The points after a step, inside the manifold.
    fn moved(&self, step: &DVector<f64>) -> Vec<Point> {
        let dimensions = self.manifold.dimensions();
        let moved = self.points.iter().enumerate().map(|(q, point)| {
            let mut point = *point;
            (0..dimensions).for_each(|axis| point[axis] += step[q * dimensions + axis]);
            let reach = point[0].hypot(point[1]).max(1.0);
            point.map(|c| c / reach)
        });
        moved.collect()
    }

    /// The responses of all sources, then all their derivatives, source by source.
    fn columns(&self) -> CMat {
        let responses = self.points.iter().map(|p| self.manifold.response(*p));
        let slopes = self.points.iter().flat_map(|p| self.manifold.derivatives(*p));
        let columns: Vec<_> = responses.chain(slopes).collect();
        CMat::from_fn(self.data.nrows(), columns.len(), |m, k| columns[k][m])
    }

    fn normal_equations(&self) -> Normal {
        let (elements, snapshots) = self.data.shape();
        let (sources, dimensions) = (self.points.len(), self.manifold.dimensions());
        let coordinates = sources * dimensions;
        let columns = self.columns();
        let total = columns.ncols();

        // The weighted inner products of all pairs of columns, of all snapshots at once.
        let index = |i: usize, j: usize| 2 * (j * (j + 1) / 2 + i);
        let mut products = Mat::<f64>::zeros(index(0, total), elements);
        for m in 0..elements {
            let of_element = products.col_as_slice_mut(m);
            let row: Vec<Complex64> = columns.row(m).iter().copied().collect();
            for j in 0..total {
                for i in 0..=j {
                    let product = row[i].conj() * row[j];
                    of_element[index(i, j)] = product.re;
                    of_element[index(i, j) + 1] = product.im;
                }
            }
        }
        let grams = real_product(&products, &self.weights);
        let slopes = adjoint_product(&columns, &self.weighted_residual());

        let mut blocks = vec![Complex64::ZERO; snapshots * block_length(sources, coordinates)];
        let mut hessian = DMatrix::zeros(coordinates, coordinates);
        let mut force = DVector::zeros(coordinates);
        for (n, block) in blocks.chunks_exact_mut(block_length(sources, coordinates)).enumerate() {
            let grams = grams.col_as_slice(n);
            let gram =
                |i: usize, j: usize| Complex64::new(grams[index(i, j)], grams[index(i, j) + 1]);
            let (slope, signals) = (slopes.col_as_slice(n), self.signals.col_as_slice(n));
            let (factor, rest) = block.split_at_mut(sources * sources);
            for i in 0..sources {
                (0..=i).for_each(|j| factor[i * sources + j] = gram(j, i).conj());
            }
            cholesky(factor, sources);
            let (crossed, rest) = rest.split_at_mut(coordinates * sources);
            for (p, column) in crossed.chunks_exact_mut(sources).enumerate() {
                column.iter_mut().enumerate().for_each(|(i, c)| *c = gram(i, sources + p));
                forward(factor, column);
            }
            rest.copy_from_slice(&slope[..sources]);
            forward(factor, rest);
            for q in 0..coordinates {
                let signal = signals[q / dimensions];
                let column = &crossed[q * sources..(q + 1) * sources];
                force[q] += (signal.conj() * (slope[sources + q] - dot(column, rest))).re;
                for p in 0..=q {
                    let other = &crossed[p * sources..(p + 1) * sources];
                    let outside = gram(sources + p, sources + q) - dot(other, column);
                    let product = signals[p / dimensions].conj() * signal;
                    hessian[(p, q)] += (product * outside).re;
                }
            }
        }
        hessian.fill_lower_triangle_with_upper_triangle();
        Normal { blocks, hessian, force }
    }

    /// The signals after a step of the coordinates: x + G^-1 (A^H W r - A^H W D x delta).
    fn corrected(&self, normal: &Normal, step: &DVector<f64>) -> CMat {
        let (sources, snapshots) = self.signals.shape();
        let coordinates = step.len();
        let dimensions = self.manifold.dimensions();
        let mut signals = self.signals.clone();
        let mut change = vec![Complex64::ZERO; sources];
        for n in 0..snapshots {
            let block = normal.block(n, sources);
            let (factor, rest) = block.split_at(sources * sources);
            let (crossed, rest) = rest.split_at(coordinates * sources);
            change.copy_from_slice(rest);
            let before = self.signals.col_as_slice(n);
            for (p, column) in crossed.chunks_exact(sources).enumerate() {
                let by = before[p / dimensions] * step[p];
                change.iter_mut().zip(column).for_each(|(c, v)| *c -= by * v);
            }
            backward(factor, &mut change);
            signals.col_as_slice_mut(n).iter_mut().zip(&change).for_each(|(x, c)| *x += c);
        }
        signals
    }

    /// W.R, the data of the scan for another source.
    pub fn weighted_residual(&self) -> CMat {
        let mut weighted = self.residual.clone();
        for n in 0..weighted.ncols() {
            let pairs = weighted.col_as_slice_mut(n).iter_mut().zip(self.weights.col_as_slice(n));
            pairs.for_each(|(r, w)| *r *= w);
        }
        weighted
    }

    /// For each source: the statistic, Gamma(N, 1) without a source, its power, and the covariance of its
    /// coordinates. Valid after [`RobustFit::settle`].
    pub fn tested(&self) -> Vec<Tested> {
        let Some(normal) = &self.normal else { return Vec::new() };
        let (sources, snapshots) = self.signals.shape();
        let dimensions = self.manifold.dimensions();
        // The maximum-likelihood signals have the mean variance G^-1 E[w] / I.
        let gain = self.information / self.mean_weight;
        let (mut statistics, mut noise) = (vec![0.0; sources], vec![0.0; sources]);
        let mut unit = vec![Complex64::ZERO; sources];
        for n in 0..snapshots {
            let factor = &normal.block(n, sources)[..sources * sources];
            let signals = self.signals.col_as_slice(n);
            for q in 0..sources {
                unit.fill(Complex64::ZERO);
                unit[q] = Complex64::ONE;
                forward(factor, &mut unit);
                let variance = unit.iter().map(|u| u.norm_sqr()).sum::<f64>() / gain;
                statistics[q] += signals[q].norm_sqr() / variance;
                noise[q] += variance / snapshots as f64;
            }
        }
        let inverse = normal.hessian.clone().try_inverse();
        let tested = (0..sources).map(|q| {
            let seen = self.signals.row(q).squared_norm_l2() / snapshots as f64;
            let power = (seen - noise[q]).max(0.0);
            // The Hessian took the noise in the signals for signal (Stoica and Nehorai 1990, as in jane_cov).
            let doubt = (seen / power.max(0.05 * seen)).powi(2);
            let covariance = |i: usize, j: usize| match &inverse {
                _ if i.max(j) >= dimensions => 0.0,
                Some(h) => doubt * h[(q * dimensions + i, q * dimensions + j)] / (2.0 * gain),
                None if i == j => f64::INFINITY,
                None => 0.0,
            };
            let covariance = [0, 1].map(|i| [0, 1].map(|j| covariance(i, j)));
            Tested { statistic: statistics[q], power, covariance }
        });
        tested.collect()
    }
}

/// Test results of a source.
pub(super) struct Tested {
    pub statistic: f64,
    pub power: f64,
    pub covariance: [[f64; 2]; 2],
}

impl Normal {
    fn block(&self, snapshot: usize, sources: usize) -> &[Complex64] {
        let length = block_length(sources, self.force.len());
        &self.blocks[snapshot * length..(snapshot + 1) * length]
    }
}

fn block_length(sources: usize, coordinates: usize) -> usize {
    sources * (sources + coordinates + 1)
}

fn dot(a: &[Complex64], b: &[Complex64]) -> Complex64 {
    a.iter().zip(b).map(|(a, b)| a.conj() * b).sum()
}

/// The lower Cholesky factor of a Hermitian matrix (row by row, lower triangle), in place. A pivot lost to
/// rounding, of two sources in one position, becomes as large as rounding.
fn cholesky(a: &mut [Complex64], size: usize) {
    for i in 0..size {
        for j in 0..=i {
            let (above, row) = a.split_at_mut(i * size);
            if i == j {
                let before = row[i].re;
                let pivot = before - row[..i].iter().map(|v| v.norm_sqr()).sum::<f64>();
                row[i] = pivot.max(1e-12 * before).max(f64::MIN_POSITIVE).sqrt().into();
            } else {
                let other = &above[j * size..j * size + size];
                let rest = row[j] - dot(&other[..j], &row[..j]);
                row[j] = rest / other[j].re;
            }
        }
    }
}

/// L^-1 b, in place.
fn forward(factor: &[Complex64], b: &mut [Complex64]) {
    let size = b.len();
    for i in 0..size {
        let row = &factor[i * size..];
        let sum: Complex64 = row[..i].iter().zip(&b[..i]).map(|(l, b)| l * b).sum();
        b[i] = (b[i] - sum) / row[i].re;
    }
}

/// L^-H b, in place.
fn backward(factor: &[Complex64], b: &mut [Complex64]) {
    let size = b.len();
    for i in (0..size).rev() {
        let sum: Complex64 = (i + 1..size).map(|k| factor[k * size + i].conj() * b[k]).sum();
        b[i] = (b[i] - sum) / factor[i * size + i].re;
    }
}
