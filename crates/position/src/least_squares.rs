//! Linear least squares of a few shared unknowns, with any number of clock terms eliminated.
//!
//! Row `i` says `w_i (g_i . x + c_k) = e_i`: shared unknowns `x`, a term `c_k` of the clock that it contains
//! (or none: a prior), the weight `w_i = 1/sigma_i`. Taking the weighted mean of a term's rows out of them
//! ("centring") eliminates it exactly, and is the first stage of modified Gram-Schmidt on `[clocks | G | e]`;
//! the rest of it, without square roots, is as stable as Householder's QR for least squares (Björck 1967),
//! whatever the scales of the columns. Cost: `2 P (P + 2)` multiplications a row and `P` divisions; buffers are
//! kept from one solution to the next, so that with up to two clock terms nothing is allocated again.

use crate::point::{Point, Terms};
use nalgebra::{SMatrix, SVector};

/// One value for each row.
pub(crate) type Buffer<T> = Vec<T>;

/// A column whose part orthogonal to the columns before it is shorter than this fraction of its length
/// depends on them: rounding alone leaves about 1e-15.
const RANK_TOLERANCE: f64 = 1e-12;

/// A weighted row: `P` derivatives, then right-hand sides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinearRow<const W: usize> {
    pub row: [f64; W],
    /// Derivative by the clock term.
    pub weight: f64,
    /// Which clock term it contains.
    pub term: Option<usize>,
}

impl<const W: usize> LinearRow<W> {
    /// From the row as it is, with its right-hand side last, and its standard deviation.
    pub fn new(row: [f64; W], sigma: f64, term: Option<usize>) -> Self {
        Self { row: row.map(|v| v / sigma), weight: 1.0 / sigma, term }
    }

    fn same_term(&self, other: &Self) -> bool {
        self.term == other.term
    }
}

/// The system, and once it is solved its factors `[G | e] = Q [U | ..]` with orthogonal columns in `Q`.
pub(crate) struct LeastSquares<const P: usize, const W: usize> {
    /// Once solved, `Q`.
    rows: Buffer<LinearRow<W>>,
    /// Weighted means of each clock term's rows, and the sums of its squared weights.
    means: Terms<[f64; W]>,
    term_squares: Terms<f64>,
    /// Unit upper triangular `U`; beyond column `P`, the projections of the right-hand sides.
    upper: [[f64; W]; P],
    /// Squared lengths of the columns of `Q`.
    squares: [f64; P],
}

impl<const P: usize, const W: usize> Default for LeastSquares<P, W> {
    fn default() -> Self {
        Self {
            rows: Buffer::new(),
            means: Terms::new(),
            term_squares: Terms::new(),
            upper: [[0.0; W]; P],
            squares: [0.0; P],
        }
    }
}

impl<const P: usize, const W: usize> LeastSquares<P, W> {
    /// Takes these rows in place of those before.
    #[inline]
    pub fn set(&mut self, rows: impl Iterator<Item = LinearRow<W>>) {
        self.rows.clear();
        self.rows.extend(rows);
    }

    /// The rows, before the system is solved.
    pub fn rows(&self) -> &[LinearRow<W>] {
        &self.rows
    }

    /// Sum of the squares of the first right-hand side, before the system is solved.
    #[inline]
    pub fn cost(&self) -> f64 {
        self.rows.iter().map(|row| row.row[P] * row.row[P]).sum()
    }

    /// Takes the clocks' part out of the first right-hand side, and puts it into `clocks` (0 for terms that no
    /// row contains); gives what is left of the cost.
    #[inline]
    pub fn fit_clocks(&mut self, clocks: &mut [f64]) -> f64 {
        self.term_squares.clear();
        self.term_squares.resize(clocks.len(), 0.0);
        clocks.fill(0.0);
        for rows in self.rows.chunk_by(LinearRow::same_term) {
            let Some(term) = rows[0].term else { continue };
            clocks[term] += rows.iter().map(|row| row.row[P] * row.weight).sum::<f64>();
            self.term_squares[term] += rows.iter().map(|row| row.weight * row.weight).sum::<f64>();
        }
        for (clock, square) in clocks.iter_mut().zip(&self.term_squares) {
            *clock = if *square > 0.0 { *clock / square } else { 0.0 };
        }
        let mut cost = 0.0;
        for rows in self.rows.chunk_by_mut(LinearRow::same_term) {
            let clock = rows[0].term.map_or(0.0, |term| clocks[term]);
            for LinearRow { row, weight, .. } in rows {
                row[P] -= clock * *weight;
                cost += row[P] * row[P];
            }
        }
        cost
    }

    /// Minimiser for the first right-hand side, into `step`: the shared unknowns, and its clock terms (0 for
    /// those that no row contains). `None` if the columns depend on each other, the rows are too few, or a number
    /// is not finite.
    #[inline]
    pub fn solve(&mut self, step: &mut Point<P>) -> Option<()> {
        self.factor(step.clocks.len())?;
        let x = self.minimiser(P);
        for (clock, mean) in step.clocks.iter_mut().zip(&self.means) {
            *clock = (0..P).fold(mean[P], |c, k| c - mean[k] * x[k]);
        }
        step.x = x;
        x.iter().chain(&step.clocks).all(|v| v.is_finite()).then_some(())
    }

    /// Eliminates the clock terms and makes the columns orthogonal.
    pub fn factor(&mut self, terms: usize) -> Option<()> {
        let lengths = self.centre(terms);
        for k in 0..P {
            let sums = weighted_sum(&self.rows, |row| row.row[k]);
            let square = sums[k];
            if !(square > RANK_TOLERANCE * RANK_TOLERANCE * lengths[k] && square.is_finite()) {
                return None;
            }
            let upper = sums.map(|s| s / square);
            for LinearRow { row, .. } in &mut self.rows {
                let q = row[k];
                (k + 1..W).for_each(|j| row[j] -= q * upper[j]);
            }
            (self.upper[k], self.squares[k]) = (upper, square);
        }
        Some(())
    }

    /// Takes each clock term's weighted mean out of its rows. Gives the squared lengths of the columns before.
    #[inline]
    fn centre(&mut self, terms: usize) -> [f64; P] {
        self.means.clear();
        self.means.resize(terms, [0.0; W]);
        self.term_squares.clear();
        self.term_squares.resize(terms, 0.0);
        let mut lengths = [0.0; P];
        for rows in self.rows.chunk_by(LinearRow::same_term) {
            let (mut sums, mut squares) = ([0.0; W], 0.0);
            for LinearRow { row, weight, .. } in rows {
                (0..P).for_each(|k| lengths[k] += row[k] * row[k]);
                (0..W).for_each(|j| sums[j] += weight * row[j]);
                squares += weight * weight;
            }
            if let Some(term) = rows[0].term {
                (0..W).for_each(|j| self.means[term][j] += sums[j]);
                self.term_squares[term] += squares;
            }
        }
        for (mean, square) in self.means.iter_mut().zip(&self.term_squares) {
            if *square > 0.0 {
                *mean = mean.map(|sum| sum / square);
            }
        }
        for rows in self.rows.chunk_by_mut(LinearRow::same_term) {
            let Some(mean) = rows[0].term.map(|term| self.means[term]) else { continue };
            for LinearRow { row, weight, .. } in rows {
                (0..W).for_each(|j| row[j] -= *weight * mean[j]);
            }
        }
        lengths
    }

    /// Minimiser for the right-hand side in a column.
    #[inline]
    pub fn minimiser(&self, column: usize) -> SVector<f64, P> {
        self.back_substitute(self.upper.map(|row| row[column]))
    }

    /// Solves `U x = parts`, the projections of a right-hand side over the squared lengths of the columns.
    #[inline]
    fn back_substitute(&self, mut x: [f64; P]) -> SVector<f64, P> {
        for k in (0..P).rev() {
            x[k] -= (k + 1..P).map(|j| self.upper[k][j] * x[j]).sum::<f64>();
        }
        SVector::from(x)
    }

    /// The minimiser for another right-hand side of the same rows, which it uses up. (Taking the clocks' part
    /// out of it beforehand changes nothing but rounding.)
    #[inline]
    pub fn solve_again(&self, right: &mut [f64]) -> SVector<f64, P> {
        self.back_substitute(std::array::from_fn(|k| {
            let pairs = self.rows.iter().zip(&*right);
            let part = pairs.map(|(q, e)| q.row[k] * e).sum::<f64>() / self.squares[k];
            self.rows.iter().zip(&mut *right).for_each(|(q, e)| *e -= part * q.row[k]);
            part
        }))
    }

    /// By how much the last step would lower the cost if the rows were linear.
    pub fn promise(&self) -> f64 {
        self.upper.iter().zip(&self.squares).map(|(row, square)| square * row[P] * row[P]).sum()
    }

    /// The last step confined to the span of the orthonormal columns of `basis`, by the normal equations:
    /// right to what a start needs.
    pub fn solve_within<const K: usize>(&self, basis: &SMatrix<f64, P, K>) -> SVector<f64, P> {
        let scale = SMatrix::<f64, P, P>::from_diagonal(&SVector::from(self.squares));
        let inner = self.unit_upper() * basis;
        let normal =
            (inner.transpose() * scale * inner).try_inverse().unwrap_or_else(SMatrix::zeros);
        let right = SVector::from(self.upper.map(|row| row[P]));
        basis * (normal * (inner.transpose() * scale * right))
    }

    fn unit_upper(&self) -> SMatrix<f64, P, P> {
        SMatrix::from_fn(|k, j| if k <= j { self.upper[k][j] } else { 0.0 })
    }

    /// Covariance of the shared unknowns if each row's residual, divided by its standard deviation, has unit
    /// variance.
    pub fn covariance(&self) -> SMatrix<f64, P, P> {
        let identity = SMatrix::<f64, P, P>::identity();
        // A unit triangle has an inverse.
        let inverse = self.unit_upper().solve_upper_triangular(&identity).unwrap_or(identity);
        let weights = SVector::from(self.squares.map(f64::recip));
        inverse * SMatrix::from_diagonal(&weights) * inverse.transpose()
    }

    /// What each row's weighted right-hand side does to the shared unknowns: `x = sum influence_i e_i`.
    pub fn influences(&self) -> impl Iterator<Item = SVector<f64, P>> + '_ {
        self.rows
            .iter()
            .map(|row| self.back_substitute(std::array::from_fn(|k| row.row[k] / self.squares[k])))
    }

    /// The same for a clock term.
    pub fn clock_influences(&self, term: usize) -> impl Iterator<Item = f64> + '_ {
        let (mean, square) = (self.means[term], self.term_squares[term]);
        self.rows.iter().zip(self.influences()).map(move |(row, shared)| {
            let own = if row.term == Some(term) { row.weight / square } else { 0.0 };
            (0..P).fold(own, |c, k| c - mean[k] * shared[k])
        })
    }
}

/// `sum(weight * row)`, column by column.
#[inline]
fn weighted_sum<const W: usize>(
    rows: &[LinearRow<W>],
    weight: impl Fn(&LinearRow<W>) -> f64,
) -> [f64; W] {
    let mut sum = [0.0; W];
    for row in rows {
        let weight = weight(row);
        (0..W).for_each(|j| sum[j] += weight * row.row[j]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector, Vector3};

    /// 300 rows of three unknowns and five clocks, and a prior.
    fn rows() -> Vec<LinearRow<4>> {
        let row = |k: usize| {
            let t = k as f64;
            let row = [t.sin(), (2.0 * t).cos(), (0.1 * t).sin(), (3.0 * t).sin()];
            LinearRow::new(row, 1.0 + (k % 3) as f64, Some(k % 5))
        };
        let prior = LinearRow::new([0.6, 0.0, 0.8, 0.5], 2.0, None);
        (0..300).map(row).chain([prior]).collect()
    }

    #[test]
    fn unknowns_clocks_and_covariance_are_those_of_the_dense_normal_equations() {
        let rows = rows();
        let mut system = LeastSquares::<3, 4>::default();
        system.set(rows.iter().copied());
        let mut step = Point { x: Vector3::zeros(), clocks: Terms::from_elem(0.0, 5) };
        system.solve(&mut step).unwrap();
        let Point { x, clocks } = step;
        let j = DMatrix::from_fn(rows.len(), 8, |i, k| match k {
            0..3 => rows[i].row[k],
            _ => {
                if rows[i].term == Some(k - 3) {
                    rows[i].weight
                } else {
                    0.0
                }
            }
        });
        let e = DVector::from_fn(rows.len(), |i, _| rows[i].row[3]);
        let inverse = (j.transpose() * &j).try_inverse().unwrap();
        let dense = &inverse * j.transpose() * e;
        let ours = DVector::from_iterator(8, x.iter().chain(&clocks).copied());
        // Condition of some ten, rounding of 300 products of order one.
        assert!((ours - dense).norm() < 1e-12);
        assert!((system.covariance() - inverse.fixed_view::<3, 3>(0, 0)).norm() < 1e-13);
        let propagated: nalgebra::Matrix3<f64> =
            system.influences().map(|g| g * g.transpose()).sum();
        assert!((system.covariance() - propagated).norm() < 1e-13);
        let clock: f64 = system.clock_influences(2).map(|g| g * g).sum();
        assert!((clock - inverse[(5, 5)]).abs() < 1e-13);
        // Another right-hand side: the first column itself.
        let mut right: Vec<f64> = rows.iter().map(|row| row.row[0]).collect();
        assert!((system.solve_again(&mut right) - Vector3::x()).norm() < 1e-12);
    }

    #[test]
    fn dependent_columns_too_few_rows_and_numbers_that_are_none_are_refused() {
        let solves = |rows: Vec<LinearRow<4>>| {
            let mut system = LeastSquares::<3, 4>::default();
            system.set(rows.into_iter());
            let mut step = Point { x: Vector3::zeros(), clocks: Terms::from_elem(0.0, 5) };
            system.solve(&mut step).is_some()
        };
        let changed = |change: fn([f64; 4]) -> [f64; 4]| {
            rows().into_iter().map(|r| LinearRow { row: change(r.row), ..r }).collect()
        };
        assert!(solves(changed(|row| row)));
        assert!(!solves(changed(|[x, y, _, e]| [x, y, x - 2.0 * y, e])));
        assert!(!solves(changed(|[x, y, z, _]| [x, y, z, f64::NAN])));
        assert!(!solves(rows().into_iter().take(7).collect()), "seven rows for eight unknowns");
    }
}
