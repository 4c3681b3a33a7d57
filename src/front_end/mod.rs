//! Conditioning: the intermediate frequency removed, the rate lowered, and the level measured.

mod conditioner;
mod level;
pub mod mixture;
mod oscillator;
mod spectrum;

pub use conditioner::Conditioner;
pub use level::{Level, LevelMeter};
pub use oscillator::Oscillator;
pub use spectrum::power_spectrum;
