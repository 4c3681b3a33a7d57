//! The methods that the paper on JANE compares LDA-l1,1 with: for the experiments, not for the receiver.

mod cvx;
mod dg_l21;
mod efrs;
mod lrma_svt;

pub use cvx::{cvx_l11, cvx_l21};
pub use dg_l21::dg_l21;
pub use efrs::efrs;
pub use lrma_svt::lrma_svt;

use sdr_rx::array::CMat;

/// Norms of the rows.
fn row_norms(matrix: &CMat) -> Vec<f64> {
    matrix.row_iter().map(|row| row.norm_l2()).collect()
}

/// Rows times factors.
fn scale_rows(matrix: &CMat, factors: &[f64]) -> CMat {
    CMat::from_fn(matrix.nrows(), matrix.ncols(), |row, column| {
        matrix[(row, column)] * factors[row]
    })
}
