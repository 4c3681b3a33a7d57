//! Finding satellites: which PRN codes are there, at which Doppler and code phase.

use crate::gnss::Sv;

/// A satellite found in a block of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acquisition {
    /// The satellite.
    pub sv: Sv,
    /// Doppler of the carrier at the first sample, Hz, positive when the satellite approaches.
    pub doppler_hz: f64,
    /// Code phase at the first sample, chips in [0, 1023).
    pub code_phase_chips: f64,
    /// Carrier-to-noise density, dB-Hz.
    pub cn0_dbhz: f64,
    /// The search's test statistic: correlation power over its mean under noise alone.
    pub statistic: f64,
    /// Probability that noise alone reaches this statistic anywhere in the searched space.
    pub false_alarm: f64,
}
