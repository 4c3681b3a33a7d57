//! From observations to a position: least squares from the Earth's centre.
//!
//! [`aw_dgn_bt`] is the bare iteration on satellite positions, for a researcher; [`solve_epoch`]
//! and [`solve_snapshot`] are the receiver's, with every correction that broadcast data allow.

pub mod aw_dgn_bt;
mod fix;
pub mod least_squares;

pub use fix::{Fix, FixMethod, Residual};
