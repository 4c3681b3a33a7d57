//! From observations to a position: least squares from the Earth's centre.
//!
//! For a researcher, on plain satellite positions and velocities: [`solver::Solver`] runs every solver by its
//! name on [`Row`]s, pseudoranges, Dopplers or both, by any number of clocks, and gives one
//! [`solver::point_solution::PointSolution`] with its trace: the paper's family ([`solver::aw_dgn_bt`]), the
//! quicker and more robust [`solver::variable_projection`], [`solver::bancroft`]'s algebra, the gradient family
//! ([`solver::descent`]). For a receiver, with every correction that broadcast data allow: [`solve_epoch`],
//! [`solve_static`] and [`solve_snapshot`].

mod epoch;
mod error;
mod fix;
mod gauss_newton;
mod integrity;
mod least_squares;
mod loss;
mod options;
mod place;
mod point;
mod problem;
#[cfg(test)]
mod simulated;
mod snapshot;
pub mod solver;

pub use epoch::sequence::Sequence;
pub use epoch::static_point::solve_static;
pub use epoch::{Candidates, candidates, solve_epoch, solve_traced};
pub use error::{DropReason, Dropped, PositioningError};
pub use fix::{
    Doubt, FailedStart, FailedStartCause, Fix, FixMethod, FixStart, Integrity, InterSystemOffset,
    ProtectionLevel, Residual, TimeSearch,
};
pub use loss::Robust;
pub use options::{Exclusion, Height, Observable, ParseSystemsError, PositioningOptions, Systems};
pub use place::Place;
pub use problem::{Row, RowKind, Satellite, Seen};
pub use snapshot::solve_snapshot;
pub use solver::Solver;
