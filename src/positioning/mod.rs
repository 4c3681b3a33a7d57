//! From observations to a position: least squares from the Earth's centre.
//!
//! [`aw_dgn_bt`] is the bare iteration on satellite positions, for a researcher; [`solve_epoch`]
//! and [`solve_snapshot`] are the receiver's, with every correction that broadcast data allow.

pub mod aw_dgn_bt;
mod blind;
mod coarse_time;
mod code_phases;
mod doppler_time;
mod error;
mod fix;
pub mod least_squares;
mod options;
mod point;
mod selection;
mod sight;
mod snapshot;
mod solution;
mod statistics;
#[cfg(test)]
mod synthetic;
mod time_window;
mod velocity;

pub use error::{DropReason, Dropped, PositioningError};
pub use fix::{Fix, FixMethod, Residual, TimeSearch};
pub use options::{PositioningOptions, SnapshotOptions};
pub use point::solve_epoch;
pub use snapshot::solve_snapshot;
