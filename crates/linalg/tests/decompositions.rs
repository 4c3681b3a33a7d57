//! Decompositions, multiplied together again. An integration test, so that `faer` is not compiled again for it.

use num_complex::Complex64;
use sdr_rx_linalg::*;

/// A matrix without structure.
fn matrix(rows: usize, columns: usize) -> CMat {
    let entry = |i: usize, k: usize| ((i * 7 + k * 13 + 3) as f64 * 1.7).sin();
    CMat::from_fn(rows, columns, |i, k| Complex64::new(entry(i, k), entry(k + 5, i)))
}

fn distance(a: &CMat, b: &CMat) -> f64 {
    (a - b).norm_l2()
}

#[test]
fn decompositions_reproduce_their_matrix() {
    let a = matrix(7, 4);
    let gram = adjoint_product(&a, &a);
    let (values, vectors) = hermitian_eigen(&gram).unwrap();
    assert!(values.is_sorted_by(|a, b| a >= b));
    let scaled = CMat::from_fn(4, 4, |i, k| vectors[(i, k)] * values[k]);
    assert!(distance(&product(&scaled, &vectors.adjoint().to_owned()), &gram) < 1e-12);
    let (u, s, v) = thin_svd(&a).unwrap();
    let scaled = CMat::from_fn(7, 4, |i, k| u[(i, k)] * s[k]);
    assert!(distance(&product(&scaled, &v.adjoint().to_owned()), &a) < 1e-12);
    let b = matrix(4, 2);
    let solved = Cholesky::new(&gram).unwrap().solve(&b);
    // The condition of the Gram matrix is some hundred.
    assert!(distance(&product(&gram, &solved), &b) < 1e-11);
    assert!(Cholesky::new(&CMat::from_fn(2, 2, |_, _| Complex64::ONE * -1.0)).is_none());
    let basis = orthonormal_basis(&a);
    assert!(distance(&adjoint_product(&basis, &basis), &CMat::identity(4, 4)) < 1e-13);
    let projected = product(&basis, &adjoint_product(&basis, &a));
    assert!(distance(&projected, &a) < 1e-12);
    assert!(hermitian_eigen(&CMat::zeros(0, 0)).is_none());
}
