//! What a whole run found.

use super::event::{NoFix, Notice};
use crate::acquisition::Refined;
use crate::array::{ArraySky, SkyEpoch};
use crate::front_end::{ImpulseReport, Interferer};
use crate::gnss::message::sbas;
use crate::gnss::observation::ObservationEpoch;
use crate::gnss::{NavigationData, Sv};
use crate::position::Fix;

/// What a run found.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// Satellites found at the start, refined over it, strongest first.
    pub acquisitions: Vec<Refined>,
    /// Measurements at the common instants, in order of time.
    pub epochs: Vec<ObservationEpoch>,
    /// Positions, in order of time.
    pub fixes: Vec<Fix>,
    /// Navigation data, known and decoded.
    pub navigation: NavigationData,
    /// Navigation data that came from the signals alone.
    pub decoded: NavigationData,
    /// The newest message of each type of each SBAS satellite.
    pub sbas: Vec<(Sv, sbas::SbasMessage)>,
    /// Signal that the first fix needed, s from the first sample.
    pub first_fix_s: Option<f64>,
    /// Samples of each channel, at the receiver's rate.
    pub samples: u64,
    /// Sources and directions by an array; absent with one channel.
    pub sky: Option<ArraySky>,
    /// The same during tracking, about once a second.
    pub sky_epochs: Vec<SkyEpoch>,
    /// Impulsive noise, where some was found and suppressed.
    pub noise: Option<ImpulseReport>,
    /// Interference that was excised from the samples of one antenna, strongest first.
    pub interferers: Vec<Interferer>,
    /// Notices to the user.
    pub notices: Vec<Notice>,
    /// Why there is no fix.
    pub reason: Option<NoFix>,
}
