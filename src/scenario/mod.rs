//! Scenarios: captures made from first principles, with known truth.

pub mod fir;
pub mod front_end;
pub mod kernel;
pub mod noise;
pub mod pseudorange;
pub mod quantiser;
pub mod receiver;
pub mod values;
