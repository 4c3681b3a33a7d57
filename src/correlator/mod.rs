//! Correlation of samples with a code replica and a carrier: the kernel used by the refinement of
//! acquisitions and by tracking.
//!
//! Cost: one pass over the samples per satellite and correlation interval, with all three taps. Samples are held in
//! planes of bytes, or of words where more than noise is in them (2 or 4 bytes a complex sample, converted once and
//! shared by all channels).

mod buffer;
pub mod carrier;
mod code_table;
mod kernel;
mod lateness;
#[cfg(test)]
pub(crate) mod test_signal;

pub use buffer::{Depth, SampleBuffer};
pub use code_table::{CodeTable, Taps};
pub use kernel::{VECTOR, Window, correlate, correlate_scalar, sign};
pub use lateness::lateness_chips;
