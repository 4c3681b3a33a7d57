//! Measurements of each satellite at one instant.

use crate::constants::SPEED_OF_LIGHT;
use crate::{GpsTime, Sv, Transmission};

/// A measured code range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CodeRange {
    /// Full pseudorange c (t_receive - t_transmit), m.
    Pseudorange(f64),
    /// Pseudorange modulo [`Observation::code_period_m`], m, from a snapshot without its navigation message.
    ModuloCodePeriod(f64),
}

/// The measurements of one signal of one satellite.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// The satellite and its signal.
    pub transmission: Transmission,
    /// Code range, where one was measured.
    pub range: Option<CodeRange>,
    /// Standard deviation of the code range by thermal noise, m.
    pub range_sigma_m: f64,
    /// Doppler of the carrier, Hz, positive when the satellite approaches (range rate = -lambda D), where
    /// it was measured.
    pub doppler_hz: Option<f64>,
    /// Standard deviation of the Doppler, Hz.
    pub doppler_sigma_hz: f64,
    /// Carrier phase, cycles, that grows with the range, where a loop tracks it.
    pub carrier_phase_cycles: Option<f64>,
    /// Whether the carrier phase may have slipped since the observation before.
    pub lost_lock: bool,
    /// Carrier-to-noise density, dB-Hz, where it is known.
    pub cn0_dbhz: Option<f64>,
}

impl Observation {
    /// The full pseudorange, m, where that was measured.
    pub fn pseudorange_m(&self) -> Option<f64> {
        match self.range? {
            CodeRange::Pseudorange(range_m) => Some(range_m),
            CodeRange::ModuloCodePeriod(_) => None,
        }
    }
}

impl Observation {
    /// The satellite.
    pub fn sv(&self) -> Sv {
        self.transmission.sv
    }

    /// The code period as a range, m: 299 792.458 m of a C/A code.
    pub fn code_period_m(&self) -> f64 {
        SPEED_OF_LIGHT * self.transmission.signal.period_s()
    }
}

/// The observations of all satellites at one receive instant.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservationEpoch {
    /// Receive instant by the receiver's clock: the pseudoranges refer to it. Its offset from GPS time
    /// is the clock bias that the position solution finds.
    pub receive_time: GpsTime,
    /// The same instant as an index of samples from the start of the stream (may be fractional).
    pub sample: f64,
    /// One observation per transmission, in their order.
    pub observations: Vec<Observation>,
}

/// C/N0 that is assumed where a file does not state it, dB-Hz: a satellite at middle elevation.
const TYPICAL_CN0_DBHZ: f64 = 42.0;

/// Standard deviations of code (m) and Doppler (Hz) of a consumer's receiver at `cn0_dbhz`, or at a typical
/// value where none is known: 0.35 m and 0.2 Hz at 45 dB-Hz, both growing as the noise does, by 10 every
/// 20 dB.
///
/// The code is that of geodetic and u-blox receivers against known positions; a telephone's is four times that. How
/// much Dopplers are smoothed differs by a factor of 50 between receivers (0.25 Hz of a u-blox at 42 dB-Hz,
/// 0.06 Hz of a Septentrio, 0.005 Hz of a monitor station): the largest is taken, so that no good observation
/// is rejected.
pub fn typical_noise(cn0_dbhz: Option<f64>) -> (f64, f64) {
    let noise = 10f64.powf((45.0 - cn0_dbhz.unwrap_or(TYPICAL_CN0_DBHZ)) / 20.0);
    (0.35 * noise, 0.2 * noise)
}
