//! Signals by their code periods: what repeats every code period is separated from the noise before any code
//! is known.
//!
//! [`periods`] sorts the samples by code period. [`doppler`] separates them by Doppler modulo the inverse of a code
//! period: a small covariance of the elements for each. [`svd`] decomposes all periods of all elements at once.

pub(in crate::array) mod cells;
mod despread;
pub mod doppler;
pub mod periods;
mod search;
pub mod svd;

pub use cells::CodeFound;
pub use despread::despread;
pub use search::{CodePeriodLook, CodePeriodOptions, search_code_periods, search_periods};
