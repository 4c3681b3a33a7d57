//! From prompt correlations to navigation data: bits, words, subframes, ephemerides.
//!
//! [`FrameDecoder`] turns the bits of one satellite into [`Subframe`]s; [`NavigationCollector`] turns the
//! subframes of all satellites into [`crate::gnss::NavigationData`].

mod collector;
mod frame;

pub use collector::{NavigationCollector, Update};
pub use frame::{FrameDecoder, Subframe};
