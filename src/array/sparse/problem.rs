//! The problem that all engines solve: its penalty, its objective, and its errors.

use crate::array::CMat;
use thiserror::Error;

/// Errors of sparse reconstruction.
#[derive(Debug, Error)]
pub enum SparseError {
    /// Matrices of inconsistent shapes.
    #[error("{what}: {rows} x {columns}, but it must be {expected}")]
    Shape {
        /// Name of the matrix.
        what: &'static str,
        /// Its rows.
        rows: usize,
        /// Its columns.
        columns: usize,
        /// The expected shape.
        expected: String,
    },
    /// A number that is not finite.
    #[error("{what}: entry ({row}, {column}) is not a finite number")]
    NotFinite {
        /// Name of the matrix.
        what: &'static str,
        /// Row, from 0.
        row: usize,
        /// Column, from 0.
        column: usize,
    },
    /// A parameter out of its range.
    #[error("{name} = {value}: it must be {range}")]
    Parameter {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The valid range.
        range: &'static str,
    },
    /// LDA-l1,1 diverged.
    #[error(
        "LDA-l1,1 diverged by iteration {iteration}: eta mu (lambda_max + gamma^2) = {product:.3} must be \
         below 4; use a smaller eta or mu"
    )]
    Diverged {
        /// The iteration at which it was detected.
        iteration: usize,
        /// eta mu (lambda_max(A A^H) + gamma^2).
        product: f64,
    },
    /// A problem that LDA-l1,1 cannot solve.
    #[error("LDA-l1,1 has no row penalty: use the engine ADMM")]
    NoRows,
    /// A decomposition or a conic program that did not converge.
    #[error("{doing}: no convergence")]
    NoConvergence {
        /// Name of the operation.
        doing: &'static str,
    },
}

/// Penalty of X.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Penalty {
    /// The sum of all moduli; snapshots are independent.
    #[default]
    L11,
    /// The sum of the norms of the rows.
    Rows,
}

/// An estimate, and its accuracy.
#[derive(Clone, Debug)]
pub struct SparseEstimate {
    /// X, L x N.
    pub x: CMat,
    /// gamma pen(X) + sum |Y - A X|.
    pub objective: f64,
    /// Bound on (objective - optimum) / objective: the duality gap.
    pub gap: f64,
    /// Number of iterations.
    pub iterations: usize,
}

impl SparseEstimate {
    /// An estimate of the l1,1 problem with the distance from its optimum. A multiplier L (M x N) with |L| <= 1 and
    /// |A^H L| <= gamma, to which each column is scaled, is feasible in the dual problem, max Re <L, Y>: the optimum
    /// lies between that value and the objective.
    pub fn certified(
        a: &CMat,
        y: &CMat,
        x: CMat,
        multiplier: &CMat,
        gamma: f64,
        iterations: usize,
    ) -> Self {
        let objective = objective(a, y, &x, Penalty::L11, gamma);
        let correlation = a.adjoint() * multiplier;
        let value = |k: usize| -> f64 {
            let most = |matrix: &CMat| matrix.col(k).iter().map(|z| z.norm()).fold(0.0, f64::max);
            let beyond = most(multiplier).max(most(&correlation) / gamma).max(1.0);
            let pairs = multiplier.col(k).iter().zip(y.col(k).iter());
            pairs.map(|(l, y)| (l.conj() * y).re).sum::<f64>() / beyond
        };
        let dual: f64 = (0..y.ncols()).map(value).sum();
        let gap = ((objective - dual) / objective).max(0.0);
        Self { x, objective, gap, iterations }
    }

    /// Without any signal.
    pub(super) fn nothing(rows: usize, columns: usize) -> Self {
        Self { x: CMat::zeros(rows, columns), objective: 0.0, gap: 0.0, iterations: 0 }
    }
}

/// gamma pen(X) + sum |Y - A X|.
pub fn objective(a: &CMat, y: &CMat, x: &CMat, penalty: Penalty, gamma: f64) -> f64 {
    let pen = match penalty {
        Penalty::L11 => sum_modulus(x),
        Penalty::Rows => x.row_iter().map(|row| row.norm_l2()).sum(),
    };
    gamma * pen + sum_modulus(&(y - a * x))
}

/// Normalised squared error, |X - truth|^2 / |truth|^2.
pub fn nmse(x: &CMat, truth: &CMat) -> f64 {
    (x - truth).squared_norm_l2() / truth.squared_norm_l2()
}

/// Sum of moduli.
fn sum_modulus(matrix: &CMat) -> f64 {
    matrix.col_iter().flat_map(|c| c.iter()).map(|z| z.norm_sqr().sqrt()).sum()
}

/// The scale of the snapshots: the median modulus, or where that is 0 the largest; `None` of zeros alone.
pub(super) fn scale(y: &CMat) -> Option<f64> {
    let largest = y.norm_max();
    let median = median_modulus(y);
    (largest > 0.0).then_some(if median > 0.0 { median } else { largest })
}

/// Median of the moduli (the upper one of two); 0 of an empty matrix.
fn median_modulus(matrix: &CMat) -> f64 {
    let mut powers: Vec<f64> =
        matrix.col_iter().flat_map(|c| c.iter()).map(|z| z.norm_sqr()).collect();
    if powers.is_empty() {
        return 0.0;
    }
    let middle = powers.len() / 2;
    powers.select_nth_unstable_by(middle, f64::total_cmp).1.sqrt()
}

/// Checks shapes and that all entries are finite.
pub fn check(a: &CMat, y: &CMat) -> Result<(), SparseError> {
    let shape = |what, matrix: &CMat, expected: String| SparseError::Shape {
        what,
        rows: matrix.nrows(),
        columns: matrix.ncols(),
        expected,
    };
    if a.nrows() == 0 || a.ncols() == 0 {
        return Err(shape("dictionary", a, "elements x directions, at least 1 x 1".into()));
    }
    if y.nrows() != a.nrows() {
        return Err(shape("snapshots", y, format!("{} x any, as the dictionary", a.nrows())));
    }
    for (what, matrix) in [("dictionary", a), ("snapshots", y)] {
        for (column, entries) in matrix.col_iter().enumerate() {
            if let Some(row) = entries.iter().position(|z| !z.is_finite()) {
                return Err(SparseError::NotFinite { what, row, column });
            }
        }
    }
    Ok(())
}

/// Checks that a parameter is above 0.
pub fn positive(name: &'static str, value: f64) -> Result<(), SparseError> {
    match value > 0.0 && value.is_finite() {
        true => Ok(()),
        false => Err(SparseError::Parameter { name, value, range: "above 0 and finite" }),
    }
}
