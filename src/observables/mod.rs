//! What the receiver measured of each satellite at one instant.

mod noise;
pub mod rinex_obs;
mod snapshot;
mod track_log;

pub use noise::typical_noise;
pub use snapshot::snapshot_epoch;
pub use track_log::{TrackLog, observation_epochs};

use crate::gnss::{GpsTime, Sv};

/// A measured code range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CodeRange {
    /// Full pseudorange c (t_receive - t_transmit), m.
    Pseudorange(f64),
    /// Pseudorange modulo one code period (c x 1 ms = 299 792.458 m), m, from a snapshot without its
    /// navigation message.
    ModuloCodePeriod(f64),
}

/// The measurements of one satellite.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// The satellite.
    pub sv: Sv,
    /// Code range.
    pub range: CodeRange,
    /// Standard deviation of the code range by thermal noise, m.
    pub range_sigma_m: f64,
    /// Doppler of the L1 carrier, Hz, positive when the satellite approaches (range rate = -lambda D); NaN
    /// where none was measured, as the code range may be.
    pub doppler_hz: f64,
    /// Standard deviation of the Doppler, Hz.
    pub doppler_sigma_hz: f64,
    /// Carrier phase, cycles, that grows with the range, where a loop tracks it.
    pub carrier_phase_cycles: Option<f64>,
    /// Whether the carrier phase may have slipped since the observation before.
    pub lost_lock: bool,
    /// Carrier-to-noise density, dB-Hz; NaN where it is not known.
    pub cn0_dbhz: f64,
}

/// The observations of all satellites at one receive instant.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservationEpoch {
    /// Receive instant by the receiver's clock: the pseudoranges refer to it. Its offset from GPS time
    /// is the clock bias that the position solution finds.
    pub receive_time: GpsTime,
    /// The same instant as an index of samples from the start of the stream (may be fractional).
    pub sample: f64,
    /// One observation per satellite, in the order of [`Sv`].
    pub observations: Vec<Observation>,
}
