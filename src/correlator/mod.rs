//! Correlation of samples with a code replica and a carrier: the kernel that acquisition refines with
//! and tracking runs on.
//!
//! Cost: one pass over the samples per satellite and code period, all three taps in it. Samples are
//! held as planar `i16` (4 bytes a complex sample, converted once and shared by all channels).

mod buffer;
pub mod carrier;
mod code_table;
mod kernel;
#[cfg(test)]
pub(crate) mod test_signal;

pub use buffer::SampleBuffer;
pub use code_table::{CodeTable, Taps};
pub use kernel::{correlate, correlate_scalar};
