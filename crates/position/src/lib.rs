//! From observations to a position: least squares from the Earth's centre.
//!
//! On plain satellite positions and velocities, for a researcher: [`solver::Solver`] runs every solver by its
//! name on pseudoranges, Dopplers or both ([`solver::observations`]), allocates nothing, and gives one
//! [`solver::outcome::Solution`] with its trace: the paper's family ([`solver::aw_dgn_bt`]), the quicker and more robust
//! [`solver::variable_projection`], [`solver::bancroft`]'s algebra, the gradient family ([`solver::descent`]). [`solve_epoch`] and
//! [`solve_snapshot`] are the receiver's, with every correction that broadcast data allow.

mod adjustment;
mod cold_start;
mod error;
mod fix;
pub mod least_squares;
mod options;
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
