//! The antenna array: how many sources there are, from where, and beams to them.
//!
//! Nothing here knows of files, codes' bits or positions. Matrices are `faer` matrices; a column is a
//! snapshot (the samples of all elements at one instant) unless said otherwise.

pub mod authenticity;
pub mod beams;
pub mod covariance;
pub mod dictionary;
pub mod manifold;
pub mod random_matrix;
pub mod signature;
mod sky;

pub use beams::Beam;
pub use dictionary::{degree_grid, dictionary, paper_dictionary};
pub use manifold::{Bearing, Manifold, Point};
pub use signature::{Arrival, Signature, arrival};
pub use sky::{ArraySky, Prediction, SatelliteArrival};

/// Dynamic complex matrix.
pub type CMat = faer::Mat<num_complex::Complex64>;
