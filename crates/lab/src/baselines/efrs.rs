//! EFRS: efficient and robust feature selection via joint l2,1-norms minimisation (Nie, Huang, Cai and Ding,
//! NIPS 2010), the method after which the paper compares: with B = \[A  gamma I\] and U = \[X; E\],
//!
//! ```text
//! min sum |row i of U|  subject to  B U = Y:      D = diag(1 / (2 |row i of U|))
//!                                                 U = D^-1 B^H (B D^-1 B^H)^-1 Y
//! ```
//!
//! in turn. It converges to the optimum of CVX-l2,1. D starts as the identity; a row that has become zero
//! stays so. The paper names no number of iterations: 50 are enough for four digits of the objective, while X
//! still moves after a thousand.

use super::{row_norms, scale_rows};
use num_complex::Complex64;
use sdr_rx::array::CMat;
use sdr_rx::array::sparse::{SparseError, check, positive};
use sdr_rx_linalg::Cholesky;

/// X (L x N) after so many iterations.
///
/// # Errors
/// When shapes do not fit, gamma is not above 0, or B D^-1 B^H loses its rank.
pub fn efrs(a: &CMat, y: &CMat, gamma: f64, iterations: usize) -> Result<CMat, SparseError> {
    check(a, y)?;
    positive("gamma", gamma)?;
    let (m, l) = (a.nrows(), a.ncols());
    let b_adjoint = CMat::from_fn(l + m, m, |row, column| match row.checked_sub(l) {
        None => a[(column, row)].conj(),
        Some(row) => Complex64::from(if row == column { gamma } else { 0.0 }),
    });
    let mut u = CMat::zeros(l + m, y.ncols());
    let mut inverse_d = vec![1.0; l + m];
    for _ in 0..iterations {
        let weighted = scale_rows(&b_adjoint, &inverse_d);
        // A term of the order of rounding on the diagonal keeps it positive when rows of both X and E vanish.
        let mut gram = b_adjoint.adjoint() * &weighted;
        let floor = 1e-13 * gram.norm_max();
        (0..m).for_each(|k| gram[(k, k)] += floor);
        let factor = Cholesky::new(&gram)
            .ok_or(SparseError::NoConvergence { doing: "Cholesky factor of B D^-1 B^H" })?;
        u = weighted * factor.solve(y);
        inverse_d = row_norms(&u).into_iter().map(|norm| 2.0 * norm).collect();
    }
    Ok(u.subrows(0, l).to_owned())
}
