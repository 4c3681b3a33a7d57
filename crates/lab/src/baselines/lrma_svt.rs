//! LRMA-SVT: low-rank matrix approximation by singular value thresholding, min |A X - Y|^2 / 2 + tau |X|_*
//! (nuclear norm), by the accelerated proximal gradient (Beck and Teboulle 2009; Toh and Yun 2010):
//!
//! ```text
//! X <- SVT_{tau/Lf} (Z - A^H (A Z - Y) / Lf),   Lf = lambda_max(A^H A),   Z extrapolated from the last two X
//! ```
//!
//! The paper gives neither tau nor the number of iterations; tau from 5 to 1200 gives the same NMSE on its scene.

use faer::Scale;
use num_complex::Complex64;
use sdr_rx::array::CMat;
use sdr_rx::array::sparse::{SparseError, check, positive};
use sdr_rx_linalg::thin_svd;

/// X (L x N) after so many iterations.
///
/// # Errors
/// When shapes do not fit, tau is not above 0, or a decomposition fails.
pub fn lrma_svt(a: &CMat, y: &CMat, tau: f64, iterations: usize) -> Result<CMat, SparseError> {
    check(a, y)?;
    positive("tau", tau)?;
    let failed = || SparseError::NoConvergence { doing: "singular value decomposition" };
    let (_, values, _) = thin_svd(a).ok_or_else(failed)?;
    let lipschitz = values.into_iter().fold(0.0, f64::max).powi(2);
    let real = |v: f64| Scale(Complex64::from(v));
    let mut x = CMat::zeros(a.ncols(), y.ncols());
    let mut z = x.clone();
    let mut momentum = 1.0f64;
    for _ in 0..iterations {
        let point = &z - real(1.0 / lipschitz) * (a.adjoint() * (a * &z - y));
        let (left, values, right) = thin_svd(&point).ok_or_else(failed)?;
        let shrunk = CMat::from_fn(left.nrows(), left.ncols(), |r, c| {
            left[(r, c)] * (values[c] - tau / lipschitz).max(0.0)
        });
        let next = shrunk * right.adjoint();
        let grown = (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt()) / 2.0;
        z = &next + real((momentum - 1.0) / grown) * (&next - &x);
        (x, momentum) = (next, grown);
    }
    Ok(x)
}
