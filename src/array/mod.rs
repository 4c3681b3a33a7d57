//! The antenna array: how many sources there are, from where, and beams to them.
//!
//! Nothing here knows of files, codes' bits or positions. Matrices are `faer` matrices; a column is a
//! snapshot (the samples of all elements at one instant) unless said otherwise.

mod admm_kernel;
pub mod authenticity;
pub mod baselines;
pub mod beams;
pub mod code_period_svd;
pub mod covariance;
pub mod crb;
pub mod dictionary;
pub mod interference;
pub mod jane;
mod jane_cov;
pub mod l1_admm;
mod lanes;
mod lda_kernel;
pub mod lda_l11;
pub mod look;
pub mod manifold;
mod mirrored;
pub mod random;
pub mod random_matrix;
mod register;
mod robust_fit;
pub mod row_rule;
pub mod scan;
pub mod signature;
mod sky;
pub mod sparse;

pub use beams::{Beam, BeamKind};
pub use crb::cramer_rao;
pub use dictionary::{degree_grid, dictionary, paper_dictionary};
pub use jane::{Decision, Jane, JaneError, JaneOptions, Source};
pub use look::{Jammer, LookError, LookOptions, SkyPicture, look};
pub use manifold::{Bearing, Manifold, Point};
pub use row_rule::{Group, row_noise, row_rule};
pub use signature::{Arrival, Signature, arrival};
pub use sky::{ArraySky, BlindCount, Prediction, SatelliteArrival, SkyEpoch};
pub use sparse::{Engine, Penalty, SparseError, SparseOptions, solve};

pub use sdr_rx_linalg::CMat;
