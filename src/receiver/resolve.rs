//! All instants of a recording solved again, with the navigation data of the whole recording.

use super::ReceiverOptions;
use super::event::NoFix;
use crate::gnss::message::sbas;
use crate::gnss::observation::ObservationEpoch;
use crate::gnss::{GpsTime, NavigationData, Sv};
use crate::position::{Fix, PositioningError, Sequence, candidates, solve_epoch};
use crate::tracking::{TrackLog, observation_epochs, smooth_recording};
use rayon::prelude::*;

/// Propagation time of the nearest satellite for the first receive time, s.
const FLIGHT_S: f64 = 0.068;

/// Measurements of all tracks of a stream, a few numbers for each satellite and instant.
#[derive(Clone, Debug)]
pub struct Tracks {
    pub(super) logs: Vec<TrackLog>,
    pub(super) rate_hz: f64,
    pub(super) samples: u64,
    pub(super) decoded: NavigationData,
    /// The newest message of each type of each SBAS satellite.
    pub(super) sbas: Vec<(Sv, sbas::SbasMessage)>,
    /// Signal after which four satellites had transmission times and ephemerides, s.
    pub(super) ready_s: Option<f64>,
}

/// The solutions.
pub(super) struct Resolved {
    /// As they were measured.
    pub(super) epochs: Vec<ObservationEpoch>,
    pub(super) fixes: Vec<Fix>,
    /// Why there is no fix.
    pub(super) reason: Option<NoFix>,
}

impl Tracks {
    /// Observations and positions of all instants by `navigation`; `found` satellites were acquired.
    pub(super) fn resolve(
        &self,
        navigation: &NavigationData,
        found: usize,
        options: &ReceiverOptions,
    ) -> Resolved {
        let logs: Vec<&TrackLog> = self.logs.iter().collect();
        let Some(origin) = receive_origin(&logs, navigation, options.time, self.rate_hz) else {
            let dated = logs.iter().filter(|l| l.is_dated()).count();
            let reason = match found {
                0 => NoFix::NothingFound,
                found => NoFix::NotDated { found, dated },
            };
            return Resolved { epochs: Vec::new(), fixes: Vec::new(), reason: Some(reason) };
        };
        let epochs_from = |origin| observation_epochs(self.logs.iter(), origin, self.rate_hz);
        let positioning = &options.positioning;
        // The first solution tells the receiver's clock; times are then right to 0.1 us.
        let bias = |e| solve_epoch(e, navigation, positioning).ok()?.clock_bias_s;
        let bias_s = epochs_from(origin).iter().find_map(bias);
        let origin = bias_s.map_or(origin, |bias_s| round_time(origin - bias_s));
        let epochs = epochs_from(origin);
        let solve = |epoch| candidates(epoch, navigation, positioning, &mut |_| ());
        let smoothed = options.smoothing().map(|smoothing| smooth_recording(&epochs, &smoothing));
        let solved: Vec<_> = smoothed.as_ref().unwrap_or(&epochs).par_iter().map(solve).collect();
        let mut sequence = Sequence::default();
        let solved: Vec<Result<Fix, PositioningError>> =
            solved.into_iter().map(|solved| sequence.judge(solved?)).collect();
        let error = solved.iter().rev().find_map(|s| s.as_ref().err()).cloned();
        let fixes: Vec<Fix> = solved.into_iter().filter_map(Result::ok).collect();
        let reason = fixes.is_empty().then(|| error.map_or(NoFix::TooFew, NoFix::Solution));
        Resolved { epochs, fixes, reason }
    }
}

/// Receive time of sample 0, from the earliest instant with a transmission time: that time and an assumed
/// propagation time. The week comes from the navigation data, or from `time`.
pub(super) fn receive_origin(
    logs: &[&TrackLog],
    navigation: &NavigationData,
    time: Option<GpsTime>,
    rate_hz: f64,
) -> Option<GpsTime> {
    let week = time.or_else(|| navigation.iter().map(|e| e.toe).next())?;
    let (sample, tow) = logs
        .iter()
        .filter_map(|log| log.first_dated())
        .max_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)))?;
    let received = week.nearest_with_tow(tow.rem_euclid(604_800.0)) + FLIGHT_S;
    Some(received - sample as f64 / rate_hz)
}

/// Rounded to 0.1 us, as in RINEX.
pub(super) fn round_time(t: GpsTime) -> GpsTime {
    let (_, fraction) = t.parts();
    t + ((fraction * 1e7).round() / 1e7 - fraction)
}
