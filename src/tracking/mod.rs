//! Tracking of a satellite: carrier and code loops.
//!
//! A [`Channel`] correlates one code period at a time and closes a third-order phase-locked loop, assisted by
//! a frequency-locked loop during pull-in, and a carrier-aided delay-locked loop (Kaplan & Hegarty, 3rd ed.,
//! chapter 8). It gives one [`Epoch`] per code period and, once the symbol edge is known, a [`Symbol`] per
//! data symbol, those before the edge was known included.

mod channel;
mod discriminators;
mod lock;
mod log;
mod loop_filter;
mod overlay_sync;
mod peaks;
mod phase_lock;
mod smoothing;
mod symbol_sync;

pub use channel::{Channel, Epoch, Quality, TrackStart, TrackingOptions};
pub use lock::LockState;
pub use log::{TrackLog, observation_epoch, observation_epochs};
pub use smoothing::{Smoother, Smoothing, smooth_recording};
pub use symbol_sync::Symbol;
