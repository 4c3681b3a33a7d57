//! Recordings and live streams as blocks of complex baseband samples.

mod block;
mod source;

pub use block::Block;
pub use source::{SampleSource, SourceError, StreamInfo};
