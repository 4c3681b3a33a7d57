//! The antenna array: how many sources there are, from where, and beams to them.
//!
//! Nothing here knows of files, codes' bits or positions. Matrices are `faer` matrices; a column is a
//! snapshot (the samples of all elements at one instant) unless said otherwise.

pub mod crb;
pub mod dictionary;
pub mod jane;
mod jane_cov;
pub mod manifold;
mod robust_fit;
pub mod row_rule;
pub mod scan;

pub use crb::cramer_rao;
pub use dictionary::{degree_grid, dictionary, paper_dictionary};
pub use jane::{Decision, Jane, JaneError, JaneOptions, Source};
pub use manifold::{Bearing, Manifold, Point};
pub use row_rule::{Group, row_noise, row_rule};

/// Dynamic complex matrix.
pub type CMat = faer::Mat<num_complex::Complex64>;
