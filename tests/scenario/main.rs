//! Simulated captures: against their own truth, theory, an independent simulator, and bad input.

mod array;
#[path = "../common/mod.rs"]
mod common;
mod correlator;
mod independent;
mod refusals;
mod theory;
