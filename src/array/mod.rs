//! The antenna array: how many sources there are, from where, and beams to them.
//!
//! Nothing here knows of files, codes' bits or positions. Matrices are `faer` matrices; a column is a
//! snapshot (the samples of all elements at one instant) unless said otherwise.

mod admm_kernel;
pub mod baselines;
pub mod dictionary;
pub mod l1_admm;
mod lanes;
mod lda_kernel;
pub mod lda_l11;
pub mod manifold;
pub mod random;
mod register;
pub mod sparse;

pub use dictionary::{degree_grid, dictionary, paper_dictionary};
pub use manifold::{Bearing, Manifold, Point};
pub use sparse::{Engine, Penalty, SparseError, SparseOptions, solve};

/// Dynamic complex matrix.
pub type CMat = faer::Mat<num_complex::Complex64>;
