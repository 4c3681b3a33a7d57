//! Sparse reconstruction over a dictionary: snapshots Y as a few of the responses A, in impulsive noise.
//!
//! All engines solve, for Y (M x N, a column a snapshot) and A (M x L, a column a direction),
//!
//! ```text
//! min over X   gamma pen(X) + sum |Y - A X|
//! ```
//!
//! with pen(X) the sum of all moduli ([`Penalty::L11`]: eq. (8) of the paper on JANE times gamma, columns
//! apart) or of the Euclidean norms of the rows ([`Penalty::Rows`]: directions are shared by all snapshots).
//! The absolute loss is what makes impulses harmless.

use super::CMat;
use super::l1_admm::{AdmmPlan, AdmmSettings};
use super::lda_l11::{self, LdaSettings};
use thiserror::Error;

/// What goes wrong in sparse reconstruction.
#[derive(Debug, Error)]
pub enum SparseError {
    /// Matrices that do not fit.
    #[error("{what}: {rows} x {columns}, but it must be {expected}")]
    Shape {
        /// Which matrix.
        what: &'static str,
        /// Its rows.
        rows: usize,
        /// Its columns.
        columns: usize,
        /// What would be right.
        expected: String,
    },
    /// A number that is not finite.
    #[error("{what}: entry ({row}, {column}) is not a finite number")]
    NotFinite {
        /// Which matrix.
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
        /// What would be right.
        range: &'static str,
    },
    /// LDA-l1,1 has left every bound.
    #[error(
        "LDA-l1,1 diverged by iteration {iteration}: eta mu (lambda_max + gamma^2) = {product:.3} must be \
         below 4; a smaller eta or mu would be right"
    )]
    Diverged {
        /// The iteration at which it was seen.
        iteration: usize,
        /// eta mu (lambda_max(A A^H) + gamma^2).
        product: f64,
    },
    /// LDA-l1,1 asked for another problem.
    #[error("LDA-l1,1 knows no row penalty: the engine ADMM solves it")]
    NoRows,
    /// A decomposition or a conic program that came to no end.
    #[error("{doing}: no convergence")]
    NoConvergence {
        /// What was being done.
        doing: &'static str,
    },
}

/// The algorithm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Engine {
    /// Douglas-Rachford splitting ([`l1_admm`](super::l1_admm)): reaches the optimum, 25 to 40 times faster.
    #[default]
    Admm,
    /// LDA-l1,1 ([`lda_l11`]) as the paper names it: ends a little above the optimum.
    Lda,
}

/// What X costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Penalty {
    /// The sum of all moduli; snapshots do not meet.
    #[default]
    L11,
    /// The sum of the norms of the rows.
    Rows,
}

/// How to reconstruct.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SparseOptions {
    /// The algorithm.
    pub engine: Engine,
    /// What X costs.
    pub penalty: Penalty,
    /// Weight of that cost against the residual; `None`: [`default_gamma`].
    pub gamma: Option<f64>,
}

/// The gamma at which noise alone hardly stirs a row: of l1,1 1.2 sqrt(M) (|a^H sign(noise)| is sqrt(M) in the
/// mean square; the paper's 5 at M = 50 is 0.7 sqrt(M), which overfits where L > M), of rows sqrt(M N).
pub fn default_gamma(penalty: Penalty, elements: usize, snapshots: usize) -> f64 {
    match penalty {
        Penalty::L11 => 1.2 * (elements as f64).sqrt(),
        Penalty::Rows => ((elements * snapshots) as f64).sqrt(),
    }
}

/// Reconstructs X (L x N) from a dictionary A (M x L) and snapshots Y (M x N), each engine with its default
/// settings. Cost: 2 r (M + L) complex multiplications per iteration and snapshot (r the rank of A) and about
/// 200 iterations; LDA-l1,1 2 M L and 10^4.
///
/// Y may have any scale: LDA-l1,1, which is not equivariant, is given Y with a median modulus of 60 (that of
/// the paper's scene) and the eta of its settings, or half the stability bound if that is less.
///
/// # Errors
/// When shapes do not fit, an entry is not finite, gamma is not above 0, or LDA is asked for rows.
pub fn solve(
    dictionary: &CMat,
    snapshots: &CMat,
    options: &SparseOptions,
) -> Result<CMat, SparseError> {
    check(dictionary, snapshots)?;
    let standard = default_gamma(options.penalty, dictionary.nrows(), snapshots.ncols());
    let gamma = options.gamma.unwrap_or(standard);
    match options.engine {
        Engine::Admm => {
            let settings = AdmmSettings { gamma, penalty: options.penalty, ..Default::default() };
            Ok(AdmmPlan::new(dictionary)?.solve(snapshots, &settings)?.x)
        }
        Engine::Lda if options.penalty == Penalty::Rows => Err(SparseError::NoRows),
        Engine::Lda => {
            let median = median_modulus(snapshots);
            if median == 0.0 {
                return Ok(CMat::zeros(dictionary.ncols(), snapshots.ncols()));
            }
            let mut settings = LdaSettings { gamma, ..Default::default() };
            let bound = lda_l11::stability_bound(dictionary, gamma)?;
            settings.eta = settings.eta.min(bound / 2.0 / settings.mu);
            let unit = 60.0 / median;
            let scaled = CMat::from_fn(snapshots.nrows(), snapshots.ncols(), |m, n| {
                snapshots[(m, n)] * unit
            });
            let x = lda_l11::solve(dictionary, &scaled, &settings)?;
            Ok(CMat::from_fn(x.nrows(), x.ncols(), |l, n| x[(l, n)] / unit))
        }
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
pub(super) fn sum_modulus(matrix: &CMat) -> f64 {
    matrix.col_iter().flat_map(|c| c.iter()).map(|z| z.norm_sqr().sqrt()).sum()
}

/// Median of the moduli (the upper one of two); 0 of an empty matrix.
pub(super) fn median_modulus(matrix: &CMat) -> f64 {
    let mut powers: Vec<f64> =
        matrix.col_iter().flat_map(|c| c.iter()).map(|z| z.norm_sqr()).collect();
    if powers.is_empty() {
        return 0.0;
    }
    let middle = powers.len() / 2;
    powers.select_nth_unstable_by(middle, f64::total_cmp).1.sqrt()
}

/// Refuses what no engine can take.
pub(super) fn check(a: &CMat, y: &CMat) -> Result<(), SparseError> {
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

/// Refuses a parameter that is not above 0.
pub(super) fn positive(name: &'static str, value: f64) -> Result<(), SparseError> {
    match value > 0.0 && value.is_finite() {
        true => Ok(()),
        false => Err(SparseError::Parameter { name, value, range: "above 0 and finite" }),
    }
}
