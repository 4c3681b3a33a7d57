//! Readers and writers of files: RINEX navigation and observation files, SP3, two-line elements. Files that gzip or
//! compress packed are read too.

mod lzw;
pub(crate) mod records;
pub mod rinex_nav;
pub mod rinex_obs;
pub mod sp3;
pub mod tle;
pub(crate) mod unpack;

pub use records::{LeftOut, LeftOutKind, ReadError};
pub use unpack::{MOST_TEXT_BYTES, MOST_UNPACKED_BYTES};
