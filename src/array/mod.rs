//! The antenna array: how many sources there are, from which directions, and beams to them.
//!
//! [`geometry`] gives responses to directions; [`sparse`] reconstructs snapshots from a few of them (LDA-l1,1
//! and a splitting of the same problem); [`decision`] determines how many sources there are (JANE);
//! [`code_periods`] finds signals by what repeats; [`sky`] combines these: directions without codes, jammers,
//! beams, and the test of measured directions against the predicted ones.
//!
//! This module does not use files, data symbols or positions. Matrices are `faer` matrices; a column is a
//! snapshot (the samples of all elements at one instant) unless stated otherwise.

pub mod code_periods;
pub mod covariance;
pub mod decision;
pub mod geometry;
pub mod sky;
pub mod sparse;

pub use decision::{Decision, Group, Jane, JaneError, JaneOptions, Source, row_noise, row_rule};
pub use geometry::{
    ArrayAttitude, Arrival, Bearing, Manifold, Point, Signature, arrival, cramer_rao, degree_grid,
    dictionary, element_gains, paper_dictionary,
};
pub use sky::{
    ArraySky, Beam, BeamKind, Jammer, LookCodes, LookDecision, LookError, LookOptions, Looked,
    Prediction, SatelliteArrival, SkyEpoch, SkyPicture, SkySource, SparseLook, look,
};
pub use sparse::{Engine, Penalty, SparseError, SparseOptions, reconstruct, solve};

pub use sdr_rx_linalg::CMat;
