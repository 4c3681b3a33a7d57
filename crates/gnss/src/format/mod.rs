//! Readers and writers of files: RINEX navigation and observation files, SP3, two-line elements.

pub(crate) mod records;
pub mod rinex_nav;
pub mod rinex_obs;
pub mod sp3;
pub mod tle;

pub use records::{LeftOut, LeftOutKind, ReadError};
