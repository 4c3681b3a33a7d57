//! Experiments: figures and tables of papers, made again from the same assumptions.

pub mod detection;
pub mod scene;

pub use crate::array::random::SplitMix64;
pub use scene::{Scene, Snapshots};
