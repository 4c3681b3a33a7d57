//! Small least-squares problems by modified Gram-Schmidt without square roots.
//!
//! Works in place on the rows of `[J | E]`, `P` columns and any number of right-hand sides, and is as
//! stable as Householder's QR for least squares (Björck 1967); scales of the columns do not matter. Cost:
//! `2 P W` multiplications a row of `W` numbers, and `P` divisions.

/// A column whose part orthogonal to the columns before it is shorter than this share of its length
/// depends on them: rounding alone leaves about 1e-15.
const RANK_TOLERANCE: f64 = 1e-12;

/// `[J | E] = Q U` with orthogonal columns in `Q`, which the rows now hold.
#[derive(Clone, Copy)]
pub(super) struct Triangle<const P: usize, const W: usize> {
    /// Unit upper triangular `U`; beyond column `P`, the projections of the right-hand sides.
    pub upper: [[f64; W]; P],
    /// Squared lengths of the columns of `Q`.
    pub squares: [f64; P],
}

impl<const P: usize, const W: usize> Triangle<P, W> {
    /// Of nothing.
    pub const ZERO: Self = Self { upper: [[0.0; W]; P], squares: [0.0; P] };

    /// Minimiser of `|J x - e|` for right-hand side `column`, or for any whose projections on the columns
    /// of `Q` (over their squared lengths) are given.
    #[inline]
    pub fn solve(&self, mut x: [f64; P]) -> [f64; P] {
        for k in (0..P).rev() {
            x[k] -= (k + 1..P).map(|j| self.upper[k][j] * x[j]).sum::<f64>();
        }
        x
    }

    /// Projections of right-hand side `column`.
    #[inline]
    pub fn right(&self, column: usize) -> [f64; P] {
        self.upper.map(|row| row[column])
    }
}

/// Orthogonalises the first `P` columns of the rows, whose squared lengths before any of their parts
/// were taken out are `squares`. `None` if they depend on each other or are not finite.
#[inline]
pub(super) fn orthogonalise<const P: usize, const W: usize>(
    rows: &mut [[f64; W]],
    squares: &[f64; P],
) -> Option<Triangle<P, W>> {
    let mut triangle = Triangle::ZERO;
    for k in 0..P {
        let sums = weighted_sum(rows, rows.iter().map(|row| row[k]));
        let square = sums[k];
        if !(square > RANK_TOLERANCE * RANK_TOLERANCE * squares[k] && square.is_finite()) {
            return None;
        }
        let upper = sums.map(|s| s / square);
        for row in rows.iter_mut() {
            let q = row[k];
            (k + 1..W).for_each(|j| row[j] -= q * upper[j]);
        }
        (triangle.upper[k], triangle.squares[k]) = (upper, square);
    }
    Some(triangle)
}

/// `sum(weight * row)`, column by column.
#[inline]
pub(super) fn weighted_sum<const W: usize>(
    rows: &[[f64; W]],
    weights: impl Iterator<Item = f64>,
) -> [f64; W] {
    let mut sum = [0.0; W];
    for (row, weight) in rows.iter().zip(weights) {
        (0..W).for_each(|j| sum[j] += weight * row[j]);
    }
    sum
}
