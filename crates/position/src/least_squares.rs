//! Linear least squares of a few unknowns and up to [`MAX_ROWS`] rows, without heap allocation.
//!
//! Modified Gram-Schmidt on the augmented matrix `[J | e]`, which is as stable as Householder's QR
//! for least squares (Björck 1967). Cost: about `P (P + 1) n` multiplications for n rows.

use nalgebra::{SMatrix, SVector};

/// Largest number of rows of a system.
pub const MAX_ROWS: usize = 128;

/// A column whose part orthogonal to the columns before it is shorter than this share of its length
/// depends on them: rounding alone leaves about 1e-15.
const RANK_TOLERANCE: f64 = 1e-12;

/// The system `J x = e` in the making: rows are pushed one by one.
pub struct LeastSquares<const P: usize> {
    columns: [[f64; MAX_ROWS]; P],
    right: [f64; MAX_ROWS],
    rows: usize,
}

/// Minimiser of `|J x - e|`.
pub struct LinearSolution<const P: usize> {
    /// The unknowns.
    pub x: SVector<f64, P>,
    /// Upper triangular factor of `J = Q R`.
    r: SMatrix<f64, P, P>,
}

impl<const P: usize> LinearSolution<P> {
    /// `(J^T J)^-1`: the covariance of the unknowns if each row was divided by its deviation.
    pub fn cofactor(&self) -> SMatrix<f64, P, P> {
        let identity = SMatrix::<f64, P, P>::identity();
        // R has no zero on its diagonal, or no solution would have been given.
        let inverse = self.r.solve_upper_triangular(&identity).unwrap_or(identity * f64::NAN);
        inverse * inverse.transpose()
    }
}

impl<const P: usize> Default for LeastSquares<P> {
    fn default() -> Self {
        Self { columns: [[0.0; MAX_ROWS]; P], right: [0.0; MAX_ROWS], rows: 0 }
    }
}

impl<const P: usize> LeastSquares<P> {
    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.rows = 0;
    }

    /// Adds the row `row . x = right`.
    ///
    /// # Panics
    /// If [`MAX_ROWS`] rows were pushed before: callers bound the number of their satellites.
    pub fn push(&mut self, row: &SVector<f64, P>, right: f64) {
        for (column, &value) in self.columns.iter_mut().zip(row.iter()) {
            column[self.rows] = value;
        }
        self.right[self.rows] = right;
        self.rows += 1;
    }

    /// Solves the system and forgets its rows; `None` if the columns depend on each other, the rows
    /// are too few, or a number is not finite.
    pub fn solve(&mut self) -> Option<LinearSolution<P>> {
        let n = std::mem::take(&mut self.rows);
        let mut r = SMatrix::<f64, P, P>::zeros();
        let mut projection = SVector::<f64, P>::zeros();
        let lengths: [f64; P] = std::array::from_fn(|k| norm(&self.columns[k][..n]));
        for k in 0..P {
            let (head, tail) = self.columns.split_at_mut(k + 1);
            let q = &mut head[k][..n];
            let length = norm(q);
            if !(length > RANK_TOLERANCE * lengths[k] && length.is_finite()) {
                return None;
            }
            r[(k, k)] = length;
            q.iter_mut().for_each(|v| *v /= length);
            for (j, column) in tail.iter_mut().enumerate() {
                r[(k, k + 1 + j)] = remove_part(&mut column[..n], q);
            }
            projection[k] = remove_part(&mut self.right[..n], q);
        }
        let x = r.solve_upper_triangular(&projection)?;
        x.iter().all(|v| v.is_finite()).then_some(LinearSolution { x, r })
    }
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Takes from `v` its part along the unit vector `q`, and gives the length of that part.
fn remove_part(v: &mut [f64], q: &[f64]) -> f64 {
    let part: f64 = v.iter().zip(q).map(|(a, b)| a * b).sum();
    v.iter_mut().zip(q).for_each(|(a, b)| *a -= part * b);
    part
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn the_normal_equations_hold_and_dependent_columns_are_refused() {
        let rows: Vec<(Vector3<f64>, f64)> = (0..9)
            .map(f64::from)
            .map(|k| (Vector3::new(k.sin(), (2.0 * k).cos(), 1.0), (3.0 * k).sin()))
            .collect();
        let mut system = LeastSquares::<3>::default();
        rows.iter().for_each(|(row, right)| system.push(row, *right));
        let solution = system.solve().unwrap();
        let gradient: Vector3<f64> =
            rows.iter().map(|(row, right)| row * (row.dot(&solution.x) - right)).sum();
        let normal =
            rows.iter().map(|(row, _)| row * row.transpose()).sum::<nalgebra::Matrix3<f64>>();
        // Rounding of nine products of order one.
        assert!(gradient.norm() < 1e-14);
        assert!((normal * solution.cofactor() - nalgebra::Matrix3::identity()).norm() < 1e-13);

        for (row, right) in &rows {
            system.push(&Vector3::new(row.x, row.y, row.x - 2.0 * row.y), *right);
        }
        assert!(system.solve().is_none());
        rows.iter().take(2).for_each(|(row, right)| system.push(row, *right));
        assert!(system.solve().is_none(), "two rows for three unknowns");
        rows.iter().for_each(|(row, _)| system.push(row, f64::NAN));
        assert!(system.solve().is_none());
    }
}
