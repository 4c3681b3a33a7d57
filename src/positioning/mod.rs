//! From observations to a position: least squares from the Earth's centre.
//!
//! [`aw_dgn_bt`] is the bare iteration on satellite positions, for a researcher; [`solve_epoch`]
//! and [`solve_snapshot`] are the receiver's, with every correction that broadcast data allow.

pub mod aw_dgn_bt;
pub mod bancroft;
mod belief;
mod coarse_time;
pub mod descent;
mod error;
mod fix;
mod gram_schmidt;
pub mod least_squares;
pub mod model;
pub mod observations;
mod options;
pub mod outcome;
mod point;
mod selection;
mod sight;
mod snapshot;
mod solution;
pub mod solver;
mod statistics;
mod system;
#[cfg(test)]
mod synthetic;
pub mod variable_projection;
mod velocity;

pub use error::{DropReason, Dropped, PositioningError};
pub use fix::{Fix, FixMethod, Residual};
pub use options::{PositioningOptions, SnapshotOptions};
pub use point::solve_epoch;
pub use snapshot::solve_snapshot;
