//! From observations to a position: least squares from the Earth's centre.
//!
//! On plain satellite positions and velocities, for a researcher: [`solver::Solver`] runs every solver by its
//! name on pseudoranges, Dopplers or both ([`observations`]), allocates nothing, and gives one
//! [`outcome::Solution`] with its trace: the paper's family ([`aw_dgn_bt`]), the quicker and more robust
//! [`variable_projection`], [`bancroft`]'s algebra, the gradient family ([`descent`]). [`solve_epoch`] and
//! [`solve_snapshot`] are the receiver's, with every correction that broadcast data allow.

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
#[cfg(test)]
mod synthetic;
mod system;
pub mod variable_projection;
mod velocity;

pub use error::{DropReason, Dropped, PositioningError};
pub use fix::{Fix, FixMethod, Residual};
pub use options::{PositioningOptions, SnapshotOptions};
pub use point::solve_epoch;
pub use snapshot::solve_snapshot;
