//! Experiments: figures and tables of papers, made again from the same assumptions.

pub mod aw_dgn;
pub mod claim;
pub mod detection;
pub mod distributed_ls;
pub mod front_end;
pub mod lda_l11;
pub mod scene;

pub use crate::array::random::SplitMix64;
pub use scene::{Scene, Snapshots};
