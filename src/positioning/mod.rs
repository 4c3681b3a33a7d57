//! From observations to a position: least squares from the Earth's centre.

mod fix;

pub use fix::{Fix, FixMethod, Residual};
