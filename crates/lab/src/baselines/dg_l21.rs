//! DG-l2,1: the (sub)gradient descent on gamma sum |rows of X| + sum |rows of A X - Y|:
//!
//! ```text
//! R = A X - Y;   X <- X - eta/2 (A^H (R / |rows|) + gamma X / |rows|)
//! ```
//!
//! from X = 0, with a constant step; a row of zeros has the subgradient 0.

use super::{row_norms, scale_rows};
use faer::Scale;
use num_complex::Complex64;
use sdr_rx::array::CMat;
use sdr_rx::array::sparse::{SparseError, check, positive};

/// X (L x N) after so many iterations of step eta.
///
/// # Errors
/// When shapes do not fit, or gamma or eta is not above 0.
pub fn dg_l21(
    a: &CMat,
    y: &CMat,
    gamma: f64,
    eta: f64,
    iterations: usize,
) -> Result<CMat, SparseError> {
    check(a, y)?;
    positive("gamma", gamma)?;
    positive("eta", eta)?;
    let unit_rows = |matrix: &CMat| {
        let inverse = |norm: f64| if norm > 0.0 { 1.0 / norm } else { 0.0 };
        scale_rows(matrix, &row_norms(matrix).into_iter().map(inverse).collect::<Vec<_>>())
    };
    let [half_step, gamma] = [eta / 2.0, gamma].map(|v| Scale(Complex64::from(v)));
    let mut x = CMat::zeros(a.ncols(), y.ncols());
    for _ in 0..iterations {
        let residual = a * &x - y;
        x = &x - half_step * (a.adjoint() * unit_rows(&residual) + gamma * unit_rows(&x));
    }
    Ok(x)
}
