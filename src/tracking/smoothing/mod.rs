//! Carrier-smoothed pseudoranges: the codes of all tracks, each averaged along its carrier (see [`filter`]).
//!
//! Code and carrier of all tracks drift alike where the receiver samples and mixes by different clocks, or the mixer's
//! frequency is not quite what is stated: that drift, the weighted median of all, is taken out, so that tracks of different
//! ages agree. A drift of one track against the others is the ionosphere's (or a slip that went unseen): it shortens the
//! window, and enters the standard deviation.
//!
//! An average starts anew where the carrier lost lock, where its phase does not fit its Dopplers, and where code minus
//! carrier jumps: by slipped cycles, by a symbol edge that was taken back, or by samples that were lost.

mod filter;
#[cfg(test)]
mod tests;

pub use filter::Smoothing;

use crate::gnss::observation::{CodeRange, Observation, ObservationEpoch};
use crate::gnss::{GpsTime, Transmission};
use filter::{Filter, Level, Measured};
use std::collections::BTreeMap;

/// Tracks from which what all do alike is told from what one does.
const SEVERAL: usize = 3;
/// Standard deviations of the median drift from which on there is one.
const COMMON_SIGMAS: f64 = 4.0;

/// Smooths the pseudoranges of a stream, epoch by epoch: each by what came before.
///
/// Cost: some hundred operations an observation; memory: 0.3 kB a transmission.
#[derive(Clone, Debug)]
pub struct Smoother {
    smoothing: Smoothing,
    /// Receive time from which times are counted.
    origin: Option<GpsTime>,
    pass: Pass,
}

impl Smoother {
    /// Without measurements.
    pub fn new(smoothing: Smoothing) -> Self {
        Self { smoothing, origin: None, pass: Pass::default() }
    }

    /// The next epoch of the stream with smoothed pseudoranges and their standard deviations. What has no carrier phase or
    /// no whole pseudorange stays as it is.
    pub fn smooth(&mut self, epoch: &ObservationEpoch) -> ObservationEpoch {
        let origin = *self.origin.get_or_insert(epoch.receive_time);
        let measured = measured(epoch, origin);
        let steps = self.pass.advance(epoch.receive_time - origin, &measured, &self.smoothing);
        let levels = steps.iter().map(|step| step.as_ref().map(|step| step.after[0]));
        smoothed(epoch, levels)
    }
}

/// The epochs of a recording, in order of time, with smoothed pseudoranges: each by what came before and after, up to
/// the window on either side.
pub fn smooth_recording(
    epochs: &[ObservationEpoch],
    smoothing: &Smoothing,
) -> Vec<ObservationEpoch> {
    let Some(origin) = epochs.first().map(|epoch| epoch.receive_time) else { return Vec::new() };
    let tracks: Vec<Vec<Track>> = epochs.iter().map(|epoch| measured(epoch, origin)).collect();
    let time_s = |k: usize| epochs[k].receive_time - origin;
    let mut later: Vec<Vec<Option<[Level; 2]>>> = Vec::with_capacity(epochs.len());
    let mut pass = Pass::default();
    // A slip before a measurement lies, backwards, before the measurement that was made earlier.
    let mut slipped: BTreeMap<Transmission, bool> = BTreeMap::new();
    for k in (0..epochs.len()).rev() {
        let reversed: Vec<Track> = tracks[k]
            .iter()
            .map(|track| {
                let (transmission, measured, slips) = (*track)?;
                let slipped = slipped.insert(transmission, slips).unwrap_or(false);
                Some((transmission, measured.reversed(), slipped))
            })
            .collect();
        let steps = pass.advance(-time_s(k), &reversed, smoothing);
        later.push(steps.iter().map(|step| step.as_ref()?.before).collect());
    }
    later.reverse();
    let mut pass = Pass::default();
    let mut smooth = |k: usize| {
        let steps = pass.advance(time_s(k), &tracks[k], smoothing);
        let levels = steps.iter().zip(&later[k]).map(|(step, later)| {
            let before = step.as_ref()?.after;
            let Some(later) = later else { return Some(before[0]) };
            // Over the whole window on both sides, where drifts cancel there; else over as much as they allow.
            let both = [0, 1].map(|which| before[which].with_later(&later[which]));
            both.into_iter().min_by(|a, b| a.sigma_m().total_cmp(&b.sigma_m()))
        });
        smoothed(&epochs[k], levels)
    };
    (0..epochs.len()).map(&mut smooth).collect()
}

/// What is measured of a transmission, where that can be smoothed, and whether its carrier may have slipped since the
/// measurement before.
type Track = Option<(Transmission, Measured, bool)>;

fn measured(epoch: &ObservationEpoch, origin: GpsTime) -> Vec<Track> {
    let time_s = epoch.receive_time - origin;
    let measured = |o: &Observation| {
        let wavelength_m = o.transmission.wavelength_m();
        let rate =
            |doppler_hz: f64| (-wavelength_m * doppler_hz, wavelength_m * o.doppler_sigma_hz);
        let measured = Measured {
            time_s,
            code_m: o.pseudorange_m()?,
            code_sigma_m: o.range_sigma_m,
            carrier_m: wavelength_m * o.carrier_phase_cycles?,
            rate_mps: o.doppler_hz.map(rate),
        };
        measured.is_sound().then_some((o.transmission, measured, o.lost_lock))
    };
    epoch.observations.iter().map(measured).collect()
}

/// An epoch with the pseudoranges that these levels of code minus carrier make.
fn smoothed(
    epoch: &ObservationEpoch,
    levels: impl Iterator<Item = Option<Level>>,
) -> ObservationEpoch {
    let mut epoch = epoch.clone();
    for (observation, level) in epoch.observations.iter_mut().zip(levels) {
        let (Some(level), Some(cycles)) = (level, observation.carrier_phase_cycles) else {
            continue;
        };
        let carrier_m = observation.transmission.wavelength_m() * cycles;
        observation.range = Some(CodeRange::Pseudorange(carrier_m + level.mean_m));
        observation.range_sigma_m = level.sigma_m();
    }
    epoch
}

/// Epochs in one direction of time.
#[derive(Clone, Debug, Default)]
struct Pass {
    filters: BTreeMap<Transmission, Filter>,
    time_s: f64,
    /// What is taken from code minus carrier of all tracks, m, and grows by `ramp_mps`.
    common_m: f64,
    ramp_mps: f64,
    /// What they drift by alike beyond that, m/s.
    drift_mps: f64,
}

/// A track's averages before and after it took a measurement: the one that is used, and that over the whole window.
#[derive(Clone, Copy, Debug)]
struct Step {
    before: Option<[Level; 2]>,
    after: [Level; 2],
}

impl Pass {
    /// Takes the measurements of one instant.
    fn advance(
        &mut self,
        time_s: f64,
        tracks: &[Track],
        smoothing: &Smoothing,
    ) -> Vec<Option<Step>> {
        let dt_s = time_s - self.time_s;
        self.common_m += self.ramp_mps * dt_s;
        self.time_s = time_s;
        let mut continued: Vec<bool> = tracks.iter().map(|track| self.continues(track)).collect();
        let innovations = tracks.iter().zip(&continued).filter(|(_, continued)| **continued);
        let mut innovations: Vec<f64> = innovations
            .filter_map(|(track, _)| self.innovation(track))
            .map(|(m, limit)| m / limit)
            .collect();
        innovations.sort_by(f64::total_cmp);
        if innovations.len() >= SEVERAL
            && innovations[innovations.len() / 2].abs() > 1.0
            && dt_s > 0.0
        {
            // All codes jumped against their carriers, or drift fast.
            let offs = tracks.iter().filter_map(|track| Some(self.innovation(track)?.0));
            let mut offs: Vec<f64> = offs.collect();
            offs.sort_by(f64::total_cmp);
            self.ramp_mps += self.drift_mps + offs[offs.len() / 2] / dt_s;
            self.drift_mps = 0.0;
            continued.fill(false);
        }
        let take = |(track, continued): (&Track, bool)| {
            let (transmission, measured, _) = (*track)?;
            let fits =
                self.innovation(track).is_some_and(|(off_m, limit_m)| off_m.abs() <= limit_m);
            let difference_m = measured.difference_m() - self.common_m;
            match self.filters.get_mut(&transmission).filter(|_| continued && fits) {
                Some(filter) => {
                    let later_s = time_s - filter.time_s();
                    let before = filter.levels(later_s, self.drift_mps, smoothing);
                    filter.add(measured, difference_m, self.drift_mps, smoothing);
                    Some(before)
                }
                None => {
                    self.filters.insert(transmission, Filter::new(measured, difference_m));
                    None
                }
            }
        };
        let before: Vec<Option<[Level; 2]>> = tracks.iter().zip(continued).map(take).collect();
        self.drift_mps = self.common_drift();
        let step = |(track, before): (&Track, Option<[Level; 2]>)| {
            let filter = self.filters.get(&(*track)?.0)?;
            let after = filter.levels(0.0, self.drift_mps, smoothing);
            let raise = |levels: [Level; 2]| levels.map(|level| level.raised(self.common_m));
            Some(Step { before: before.map(raise), after: raise(after) })
        };
        tracks.iter().zip(before).map(step).collect()
    }

    /// Whether a track goes on without a slip of its carrier.
    fn continues(&self, track: &Track) -> bool {
        track.is_some_and(|(transmission, measured, slipped)| {
            let filter = self.filters.get(&transmission);
            filter.is_some_and(|filter| !slipped && !filter.has_slipped(&measured))
        })
    }

    /// A track's code minus carrier against its prediction, m, and how far that may be.
    fn innovation(&self, track: &Track) -> Option<(f64, f64)> {
        let (transmission, measured, _) = track.as_ref()?;
        let difference_m = measured.difference_m() - self.common_m;
        let filter = self.filters.get(transmission)?;
        Some(filter.innovation(measured, difference_m, self.drift_mps))
    }

    /// The drift of code against carrier that all tracks share, m/s; 0 where noise explains it.
    fn common_drift(&self) -> f64 {
        let mut rates: Vec<_> = self.filters.values().filter_map(Filter::rate).collect();
        if rates.len() < SEVERAL {
            return 0.0;
        }
        rates.sort_by(|a, b| a.mps.total_cmp(&b.mps));
        let total: f64 = rates.iter().map(|rate| rate.sigma_mps.powi(-2)).sum();
        let mut below = 0.0;
        let middle = rates.iter().find(|rate| {
            below += rate.sigma_mps.powi(-2);
            below >= 0.5 * total
        });
        // A median's standard deviation is sqrt(pi / 2) that of a mean.
        let sigma_mps = 1.25 / total.sqrt();
        let middle_mps = middle.map_or(0.0, |rate| rate.mps);
        if middle_mps.abs() > COMMON_SIGMAS * sigma_mps { middle_mps } else { 0.0 }
    }
}
