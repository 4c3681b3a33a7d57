//! Scenarios: simulated captures with known truth.
//!
//! A [`Scenario`] (a TOML file) describes orbits, position, motion and clock of the receiver, signal levels,
//! noise and front end.
//! [`ScenarioSource`] gives the samples as any other source does, and the truth at any sample.
//!
//! The chain, one file each: `constellation` and navigation files give ephemerides; `pseudorange` the
//! exact code and carrier range by the receiver's clock; `message` the bits; `emission` modulates
//! them on code and carrier, with each element's response, and `element` (on `kernel`) sums the signals at the
//! antenna with `noise`, `jammer` and spoofer (`direction`); `front_end` (with `fir` and `quantiser`) turns
//! that into ADC samples.

pub mod config;
pub mod constellation;
pub mod direction;
mod element;
mod emission;
mod error;
pub mod fir;
pub mod front_end;
pub mod jammer;
pub mod kernel;
pub mod message;
pub mod noise;
pub mod pseudorange;
pub mod quantiser;
mod raw_writer;
pub mod receiver;
mod sent;
mod sky;
mod source;
mod truth;
mod values;
mod variance;

pub use config::BurstSettings;
pub use config::Scenario;
pub use direction::{Direction, Spoofer};
pub use error::ScenarioError;
pub use front_end::{FrontEnd, StandardFrontEnd};
pub use jammer::{JammerKind, JammerSettings};
pub use raw_writer::{RawFormat, RawWriter};
pub use source::ScenarioSource;
pub use truth::{ArrivalTruth, JammerTruth, SatelliteTruth, Truth, TruthEpoch};
