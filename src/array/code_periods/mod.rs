//! Signals by their code periods: what repeats every code period is separated from the noise before any code
//! is known, and the codes are then searched in a few singular vectors.

mod despread;
mod search;
pub mod svd;

pub use despread::despread;
pub use search::{CodeFound, CodePeriodLook, CodePeriodOptions, search_code_periods};
