//! Scenarios: captures made from first principles, with known truth.

pub mod kernel;
pub mod noise;
