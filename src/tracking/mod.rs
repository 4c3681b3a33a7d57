//! Following a satellite: carrier and code loops from the first sample to the last.
//!
//! A [`Channel`] correlates one code period at a time and closes a third-order phase-locked loop, helped
//! by a frequency-locked loop while it pulls in, and a carrier-aided delay-locked loop (Kaplan & Hegarty,
//! 3rd ed., chapter 8). It gives one [`Epoch`] per code period and, once the bit edge is known, one
//! [`Bit`] per 20, those before the edge was known included.

mod bit_sync;
mod channel;
mod discriminators;
mod lock;
mod log;
mod loop_filter;

pub use bit_sync::Bit;
pub use channel::{Channel, Epoch, Quality, TrackStart, TrackingOptions};
pub use lock::LockState;
pub use log::{TrackLog, observation_epoch, observation_epochs};
