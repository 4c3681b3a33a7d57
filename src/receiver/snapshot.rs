//! A position from a snapshot: the start of a recording.

use super::ReceiverOptions;
use super::event::{NoFix, Notice};
use crate::acquisition::{Refined, snapshot_epoch};
use crate::gnss::GpsTime;
use crate::gnss::observation::ObservationEpoch;
use crate::position::{Fix, TimeSearch, solve_snapshot};

/// The samples of a snapshot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SnapshotHead {
    /// Its samples, from the first of the stream on.
    pub samples: u64,
    /// Samples a second.
    pub rate_hz: f64,
    /// Whether these are all samples of the recording.
    pub is_all: bool,
}

/// The solution.
pub(super) struct Solved {
    pub(super) epoch: Option<ObservationEpoch>,
    pub(super) fix: Result<Fix, NoFix>,
    pub(super) notice: Option<Notice>,
}

/// The fix of a snapshot.
pub(super) fn solve_snapshot_head(
    acquisitions: &[Refined],
    head: &SnapshotHead,
    options: &ReceiverOptions,
) -> Solved {
    let refused = |reason| Solved { epoch: None, fix: Err(reason), notice: None };
    let found = acquisitions.len();
    if found == 0 {
        return refused(NoFix::NothingFound);
    }
    // Without a time any instant can be the origin of the search.
    let Some(origin) = options.navigation.iter().next().map(|e| e.toe) else {
        return refused(NoFix::NoOrbits { found });
    };
    let time: GpsTime = options.time.unwrap_or(origin);
    let mut epoch = snapshot_epoch(acquisitions, time, head.samples, head.rate_hz);
    let mut positioning = options.positioning;
    if options.time.is_none() {
        positioning.time_uncertainty_s = f64::INFINITY;
    }
    let solved = solve_snapshot(&epoch, &options.navigation, &positioning);
    if let (None, Ok(fix)) = (options.time, &solved) {
        epoch.receive_time = fix.time;
    }
    let epoch = (options.time.is_some() || solved.is_ok()).then_some(epoch);
    match solved {
        Ok(fix) => {
            // Without a time the clock has no reading that could be off.
            let clock_bias_s = options.time.map_or(Some(0.0), |_| fix.clock_bias_s);
            let notice = fix.time_search.and_then(|s| left_out(&s));
            Solved { epoch, fix: Ok(Fix { clock_bias_s, ..fix }), notice }
        }
        Err(error) => Solved { epoch, fix: Err(NoFix::Solution(error)), notice: None },
    }
}

/// The part of the time window that was not searched, where it is more than rounding.
fn left_out(search: &TimeSearch) -> Option<Notice> {
    let hours = search.left_out_s / 3600.0;
    (hours.is_finite() && hours > 1.0 / 60.0).then_some(Notice::TimeLeftOut(hours))
}
