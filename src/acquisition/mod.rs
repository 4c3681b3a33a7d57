//! Acquisition: which satellites are present, at which Doppler and code phase.
//!
//! [`SearchPlan`] searches every code phase and Doppler over a few tens of milliseconds, [`Refiner`] then
//! measures what was found to a fraction of a chip and of a hertz over the whole signal available.

mod consistency;
mod cross_correlation;
mod refine;
pub(crate) mod search;
mod snapshot;
pub mod statistics;
mod subtract;

pub use consistency::{MissingSamples, common_code_offset, find_missing_samples, is_mirrored};
pub use refine::{Refined, Refiner};
pub(crate) use search::masking;
pub use search::{AcquisitionError, SearchOptions, SearchPlan};
pub use snapshot::snapshot_epoch;
pub(crate) use subtract::subtract;

use crate::gnss::{Sv, Transmission};

/// A satellite found in a block of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acquisition {
    /// The satellite and its signal.
    pub transmission: Transmission,
    /// Doppler of the carrier, Hz, positive when the satellite approaches.
    pub doppler_hz: f64,
    /// Code phase at the first sample, chips from 0 to below a code period.
    pub code_phase_chips: f64,
    /// Carrier-to-noise density, dB-Hz.
    pub cn0_dbhz: f64,
    /// The search's test statistic: correlation power over its mean under noise alone.
    pub statistic: f64,
    /// Probability that noise alone reaches this statistic anywhere in the searched space.
    pub false_alarm: f64,
}

impl Acquisition {
    /// The satellite.
    pub fn sv(&self) -> Sv {
        self.transmission.sv
    }

    /// Time from the first sample to the start of the next code period at the nominal chip rate, s.
    pub fn code_offset_s(&self) -> f64 {
        self.transmission.clock(0.0).seconds_to_start(self.code_phase_chips)
    }
}
