//! From observations to a position: least squares from the Earth's centre.
//!
//! [`aw_dgn_bt`] is the bare iteration on satellite positions, for a researcher; [`solve_epoch`]
//! and [`solve_snapshot`] are the receiver's, with every correction that broadcast data allow.

mod adjustment;
pub mod aw_dgn_bt;
pub mod bancroft;
mod belief;
mod blind;
mod coarse_time;
mod code_phases;
mod cold_start;
pub mod descent;
mod doppler_time;
mod error;
mod fix;
mod gram_schmidt;
pub mod least_squares;
pub mod model;
pub mod observations;
mod options;
pub mod outcome;
mod point;
mod robust;
mod selection;
mod sight;
mod snapshot;
mod solution;
pub mod solver;
mod static_point;
mod statistics;
#[cfg(test)]
mod synthetic;
mod system;
pub mod variable_projection;
mod time_window;
mod velocity;

pub use error::{DropReason, Dropped, PositioningError};
pub use fix::{Fix, FixMethod, Residual, TimeSearch};
pub use options::{
    Exclusion, Height, Observable, PositioningOptions, SnapshotOptions, SolveOptions,
};
pub use point::{solve_epoch, solve_observed};
pub use robust::Robust;
pub use snapshot::solve_snapshot;
pub use solver::Solver;
pub use static_point::solve_static;
