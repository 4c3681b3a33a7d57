//! From observations to a position: least squares from the Earth's centre.
//!
//! On plain satellite positions and velocities, for a researcher: [`solver::Solver`] runs every solver by its
//! name on pseudoranges, Dopplers or both ([`observations`]), allocates nothing, and gives one
//! [`outcome::Solution`] with its trace: the paper's family ([`aw_dgn_bt`]), the quicker and more robust
//! [`variable_projection`], [`bancroft`]'s algebra, the gradient family ([`descent`]). [`solve_epoch`] and
//! [`solve_snapshot`] are the receiver's, with every correction that broadcast data allow.

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
