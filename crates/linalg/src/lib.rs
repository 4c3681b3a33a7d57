//! The dense complex linear algebra of `faer` and the Fourier transforms of `rustfft` that sdr-rx needs, as functions
//! without generics.
//!
//! A crate of its own because these libraries are generic, and would be compiled in each crate that calls them, for
//! minutes. Here they are compiled once.

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use num_complex::Complex64;
pub use rustfft::Fft;
use rustfft::FftPlanner;
use std::sync::Arc;

/// The transform X_k = sum x_n exp(-j 2 pi k n / N) of so many numbers.
pub fn forward_transform(length: usize) -> Arc<dyn Fft<f32>> {
    FftPlanner::new().plan_fft_forward(length)
}

/// The transform x_n = sum X_k exp(+j 2 pi k n / N) of so many numbers: N times the inverse of the other.
pub fn inverse_transform(length: usize) -> Arc<dyn Fft<f32>> {
    FftPlanner::new().plan_fft_inverse(length)
}

/// Dynamic complex matrix.
pub type CMat = Mat<Complex64>;

/// Eigenvalues (descending) and eigenvectors (columns) of a Hermitian matrix, whose lower triangle is read;
/// `None` where it is empty or not finite.
pub fn hermitian_eigen(matrix: &CMat) -> Option<(Vec<f64>, CMat)> {
    let last = matrix.nrows().checked_sub(1)?;
    let eigen = matrix.self_adjoint_eigen(Side::Lower).ok()?;
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let values: Vec<f64> = (0..=last).map(|k| values[last - k].re).collect();
    let finite = values.iter().all(|v| v.is_finite());
    finite.then(|| (values, CMat::from_fn(last + 1, last + 1, |i, k| vectors[(i, last - k)])))
}

/// The Cholesky factor of a Hermitian positive matrix, whose lower triangle is read.
#[derive(Clone, Debug)]
pub struct Cholesky(Llt<Complex64>);

impl Cholesky {
    /// Factorises; `None` where the matrix is not positive.
    pub fn new(matrix: &CMat) -> Option<Self> {
        matrix.llt(Side::Lower).ok().map(Self)
    }

    /// Solves for each column of `right`.
    pub fn solve(&self, right: &CMat) -> CMat {
        self.0.solve(right)
    }
}

/// An orthonormal basis of the span of the columns (no more of them than rows).
pub fn orthonormal_basis(columns: &CMat) -> CMat {
    columns.qr().compute_thin_Q()
}

/// The thin singular value decomposition A = U S V^H: U, the singular values (descending), V; `None` where it
/// does not converge.
pub fn thin_svd(matrix: &CMat) -> Option<(CMat, Vec<f64>, CMat)> {
    let svd = matrix.thin_svd().ok()?;
    let values = svd.S().column_vector().iter().map(|s| s.re).collect();
    Some((svd.U().to_owned(), values, svd.V().to_owned()))
}

/// The product A B.
pub fn product(a: &CMat, b: &CMat) -> CMat {
    a * b
}

/// The product A^H B.
pub fn adjoint_product(a: &CMat, b: &CMat) -> CMat {
    a.adjoint() * b
}

/// A - B, in the place of B.
pub fn subtracted_from(a: &CMat, mut b: CMat) -> CMat {
    for k in 0..b.ncols() {
        let pairs = b.col_as_slice_mut(k).iter_mut().zip(a.col_as_slice(k));
        pairs.for_each(|(b, a)| *b = a - *b);
    }
    b
}

/// Of each column the sum of its squared moduli.
pub fn column_powers(a: &CMat) -> Vec<f64> {
    (0..a.ncols()).map(|k| a.col_as_slice(k).iter().map(|z| z.norm_sqr()).sum()).collect()
}

/// The product A B of real matrices.
pub fn real_product(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    a * b
}
