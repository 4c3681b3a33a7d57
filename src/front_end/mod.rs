//! Front-end processing: impulse suppression, removal of the intermediate frequency, decimation, and level
//! statistics.

mod conditioner;
mod efficacy;
mod excision;
mod impulses;
mod level;
pub mod mixture;
mod oscillator;
mod scale_mixture;
mod spectrum;

pub use conditioner::{Conditioner, conditioned_rate_hz};
pub use efficacy::{Effect, Map};
pub use excision::{Excisor, Interferer, InterfererKind};
pub use impulses::{ImpulseReport, ImpulseSuppressor, Suppression};
pub use level::{Level, LevelMeter};
pub use oscillator::Oscillator;
pub use spectrum::power_spectrum;
