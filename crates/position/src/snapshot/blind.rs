//! The position from a snapshot whose time is known to hours, a day, or not at all.
//!
//! 1. The window of time is cut into cells of an hour in which ephemerides are in force. In each the
//!    Dopplers alone give every place and time that explains them ([`super::doppler_time`]); each that
//!    passes the residual test of the full model is a hypothesis.
//! 2. Each hypothesis is given to the code phases ([`super::code_phases`]): all sets of whole periods that
//!    they allow are solved jointly with the Dopplers.
//! 3. The best is a fix when its cost is below that of the snapshot with known time, when no other place or
//!    time comes near it, and when the number of false solutions to be expected that cost as little, over
//!    all that was searched, is below [`MOST_FALSE`].
//!
//! The code phases have to decide between a time and one of the satellites' periods (11 h 58 m) later with
//! the longitude turned by 180 degrees, where the Dopplers are the same, and a sidereal day (23 h 56 m)
//! later at the same place.

use super::coarse_time::{CoarseFix, CoarseTime};
use super::code_phases::Prediction;
use super::doppler_time::{Minimum, minima};
use super::time_window::TimeWindow;
use super::{Found, NEEDED, finish, limit};
use crate::epoch::sighting::Sighting;
use crate::error::PositioningError;
use crate::{Fix, FixStart, PositioningOptions, TimeSearch};
use nalgebra::{Vector3, Vector4};
use sdr_rx_gnss::constants::OMEGA_EARTH;
use sdr_rx_gnss::observation::ObservationEpoch;
use sdr_rx_gnss::{GpsTime, NavigationData, Sv};

/// How far beyond the edges of a cell its minima may lie, s.
const MARGIN_S: f64 = 300.0;
/// Deviation of the time within a hypothesis, s: no knowledge, but the least squares stay regular.
const FREE_TIME_S: f64 = 3600.0;
/// Hypotheses nearer than this in place (m) and time (s) are one.
const SAME_PLACE_M: f64 = 3e3;
const SAME_TIME_S: f64 = 5.0;
/// Below this elevation, rad, no satellite is received: 10 degrees, for the region is wide.
const LOWEST: f64 = -0.17;
/// Places and times nearer than this are the same solution, m and s.
const ONE_PLACE_M: f64 = 500.0;
const ONE_TIME_S: f64 = 1.0;
/// The next best solution must cost more than this above the best: odds of e^20.
const DISTINCT_COST: f64 = 40.0;
/// False solutions that may be expected in a search whose result is believed.
const MOST_FALSE: f64 = 1e-3;
/// With this many satellites one that is false can be told from the others.
const NEEDED_AFTER_EXCLUSION: usize = 7;

/// Half a sidereal day, s, in which GPS satellites go round once; how many either way are thought of: a week;
/// how far a satellite's range is from repeating after one, m.
const ALIAS_S: f64 = std::f64::consts::PI / OMEGA_EARTH;
const MOST_ALIASES: i32 = 14;
const ALIAS_SPREAD_M: f64 = 500.0;

/// The times at which a snapshot of `time` has its aliases, with the number of half sidereal days between.
fn aliases(time: GpsTime) -> impl Iterator<Item = (i32, GpsTime)> {
    let all = (-MOST_ALIASES..=MOST_ALIASES).filter(|k| *k != 0);
    all.map(move |k| (k, time + f64::from(k) * ALIAS_S))
}

/// A place and time that explain the Dopplers, with the satellites whose ephemerides are in force then.
struct Hypothesis<'a> {
    time: GpsTime,
    set: Vec<Sighting<'a>>,
    region: CoarseFix,
    iterations: usize,
    start: FixStart,
}

/// A set of whole periods that explains the code phases of a hypothesis.
struct Candidate<'a> {
    hypothesis: usize,
    found: Found<'a>,
}

/// All that one choice of satellites gives.
struct Search<'a> {
    hypotheses: Vec<Hypothesis<'a>>,
    /// In the order of their costs.
    candidates: Vec<Candidate<'a>>,
}

impl Search<'_> {
    fn sort(&mut self) {
        self.candidates.sort_by(|a, b| a.found.fix.cost.total_cmp(&b.found.fix.cost));
    }

    /// Position (m, ECEF) and time of a candidate.
    fn place(&self, candidate: &Candidate) -> (Vector3<f64>, GpsTime) {
        let fix = &candidate.found.fix;
        (fix.position_m(), self.hypotheses[candidate.hypothesis].time + fix.late_s())
    }
}

/// See [`crate::solve_snapshot`].
pub(super) fn solve_blind(
    epoch: &ObservationEpoch,
    nav: &NavigationData,
    options: &PositioningOptions,
) -> Result<Fix, PositioningError> {
    let blind = Blind::new(epoch, nav, options)?;
    let all: Vec<Sv> = epoch.observations.iter().map(|o| o.sv()).collect();
    let (mut false_ones, mut error) = (0.0, None);
    for excluded in std::iter::once(None).chain(all.iter().copied().map(Some)) {
        if excluded.is_some() && blind.window.most_satellites < NEEDED_AFTER_EXCLUSION + 1 {
            break;
        }
        let search = blind.search(excluded);
        match blind.judge(&search, &mut false_ones) {
            Ok(best) => return blind.fix(epoch, &search, best, excluded, false_ones),
            Err(cause @ PositioningError::TimeNotFound { .. }) => {
                error.get_or_insert(cause);
            }
            Err(cause) => return Err(cause),
        }
    }
    Err(error.unwrap_or(blind.unexplained("Dopplers", 0)))
}

/// The search: where, and with what.
struct Blind<'a> {
    window: TimeWindow<'a>,
    nav: &'a NavigationData,
    options: PositioningOptions,
}

impl<'a> Blind<'a> {
    fn new(
        epoch: &'a ObservationEpoch,
        nav: &'a NavigationData,
        options: &PositioningOptions,
    ) -> Result<Self, PositioningError> {
        let window = TimeWindow::new(epoch, nav, options.time_uncertainty_s)?;
        let options = PositioningOptions { time_uncertainty_s: FREE_TIME_S, ..*options };
        Ok(Self { window, nav, options })
    }

    fn search(&self, excluded: Option<Sv>) -> Search<'a> {
        let mut hypotheses: Vec<Hypothesis> = Vec::new();
        for &cell in &self.window.cells {
            let (set, _) = self.window.sightings(cell.centre, excluded);
            let rows = set.iter().filter(|s| s.range_rate().is_some()).count();
            for minimum in
                minima(&set, cell.centre, cell.half_s + MARGIN_S, limit(rows), &self.options)
            {
                let Some(hypothesis) = self.hypothesis(cell.centre, &minimum, excluded) else {
                    continue;
                };
                if !hypotheses.iter().any(|h| h.is(&hypothesis)) {
                    hypotheses.push(hypothesis);
                }
            }
        }
        let mut candidates: Vec<Candidate> = Vec::new();
        for (index, hypothesis) in hypotheses.iter().enumerate() {
            let found = self.code_phases(hypothesis).into_iter();
            candidates.extend(found.map(|found| Candidate { hypothesis: index, found }));
        }
        let mut search = Search { hypotheses, candidates };
        search.sort();
        self.add_aliases(&mut search, excluded);
        search
    }

    /// Looks where the best candidate has its aliases, for what the starts may have missed.
    fn add_aliases(&self, search: &mut Search<'a>, excluded: Option<Sv>) {
        let Some((at, time)) = search.candidates.first().map(|c| search.place(c)) else { return };
        let Found { fix: CoarseFix { drift_mps, .. }, start, .. } =
            search.candidates[0].found.clone();
        for (k, time) in aliases(time).filter(|(_, t)| self.window.is_searched(*t, 0.0)) {
            let turn = if k % 2 == 0 { 1.0 } else { -1.0 };
            let place_time = Vector4::new(turn * at.x, turn * at.y, at.z, 0.0);
            let start = start.clone();
            let minimum = Minimum { place_time, drift_mps, iterations: 0, start };
            let Some(hypothesis) = self.hypothesis(time, &minimum, excluded) else { continue };
            if search.hypotheses.iter().any(|h| h.is(&hypothesis)) {
                continue;
            }
            let index = search.hypotheses.len();
            let found = self.code_phases(&hypothesis).into_iter();
            search.candidates.extend(found.map(|found| Candidate { hypothesis: index, found }));
            search.hypotheses.push(hypothesis);
        }
        search.sort();
    }

    /// A minimum under the full model, with the ephemerides of its own time, if it passes there.
    fn hypothesis(
        &self,
        cell: GpsTime,
        minimum: &Minimum,
        excluded: Option<Sv>,
    ) -> Option<Hypothesis<'a>> {
        let time = cell + minimum.place_time.w;
        let (set, _) = self.window.sightings(time, excluded);
        if set.len() < NEEDED {
            return None;
        }
        let start = minimum.place_time.xyz().push(0.0);
        let region = self.problem(time).solve(&set, None, start, minimum.drift_mps)?;
        let found = time + region.late_s();
        let rows = set.iter().filter(|s| s.range_rate().is_some()).count();
        let holds = region.cost <= limit(rows)
            && region.predictions.iter().all(|s| s.elevation > LOWEST)
            && self.window.is_searched(found, MARGIN_S);
        let iterations = minimum.iterations + region.iterations;
        let start = minimum.start.clone();
        holds.then_some(Hypothesis { time, set, region, iterations, start })
    }

    fn problem(&self, time: GpsTime) -> CoarseTime<'_> {
        CoarseTime { time, nav: self.nav, options: &self.options, speed_mps: 0.0 }
    }

    /// All whole periods that pass with this hypothesis, within the window.
    fn code_phases(&self, hypothesis: &Hypothesis<'a>) -> Vec<Found<'a>> {
        let problem = self.problem(hypothesis.time);
        let (set, region) = (&hypothesis.set, &hypothesis.region);
        let prediction = Prediction::new(set, region);
        let cost_limit = limit(2 * set.len());
        let (start, bias_m) = (region.place_time, prediction.bias_m);
        let solve = |integers: Vec<i32>| {
            let fix = problem.solve(set, Some((&integers, bias_m)), start, region.drift_mps)?;
            let time = hypothesis.time + fix.late_s();
            let holds = fix.cost <= cost_limit && self.window.is_searched(time, ONE_TIME_S);
            let iterations = hypothesis.iterations + fix.iterations;
            // What is expected by chance has a bound of its own here.
            let (set, below, start) = (set.to_vec(), Vec::new(), hypothesis.start.clone());
            holds.then_some(Found { fix, set, below, integers, start, iterations, tried: 1 })
        };
        prediction.integers(cost_limit - region.cost).into_iter().filter_map(solve).collect()
    }

    /// The best candidate, if it is proved; adds what false ones are to be expected to `false_ones`.
    fn judge<'s>(
        &self,
        search: &'s Search<'a>,
        false_ones: &mut f64,
    ) -> Result<&'s Candidate<'a>, PositioningError> {
        let hypotheses = search.hypotheses.len();
        let best = search.candidates.first();
        let cost = best.map_or(limit(2 * self.window.most_satellites), |b| b.found.fix.cost);
        *false_ones += search.hypotheses.iter().map(|h| h.chance(cost)).sum::<f64>();
        let Some(best) = best else {
            let what = if hypotheses == 0 { "Dopplers" } else { "code phases" };
            return Err(self.unexplained(what, hypotheses));
        };
        let at = search.place(best);
        let contests = |c: &&Candidate| {
            let (position_m, time) = search.place(c);
            ((position_m - at.0).norm() > ONE_PLACE_M || (time - at.1).abs() > ONE_TIME_S)
                && c.found.fix.cost < cost + DISTINCT_COST
        };
        if let Some(other) = search.candidates.iter().find(contests) {
            let (position_m, time) = search.place(other);
            return Err(PositioningError::Ambiguous {
                satellites: best.found.integers.len(),
                distance_m: (position_m - at.0).norm(),
                apart_s: (time - at.1).abs(),
            });
        }
        let hypothesis = &search.hypotheses[best.hypothesis];
        let prediction = Prediction::new(&hypothesis.set, &hypothesis.region);
        let unseen =
            |(_, t): &(i32, GpsTime)| self.window.is_asked(*t) && !self.window.is_searched(*t, 0.0);
        *false_ones += aliases(at.1)
            .filter(unseen)
            .map(|(k, _)| {
                let spread_m = f64::from(k.abs()) * ALIAS_SPREAD_M;
                prediction.chance_of_alias(cost - hypothesis.region.cost, spread_m)
            })
            .sum::<f64>();
        if *false_ones > MOST_FALSE {
            return Err(PositioningError::Unproved {
                satellites: best.found.integers.len(),
                searched_s: self.window.searched_s(),
                hypotheses,
                expected: *false_ones,
            });
        }
        Ok(best)
    }

    fn unexplained(&self, what: &'static str, hypotheses: usize) -> PositioningError {
        let (from, to) = self.window.ends();
        PositioningError::TimeNotFound {
            what,
            satellites: self.window.most_satellites,
            from,
            to,
            searched_s: self.window.searched_s(),
            left_out_s: self.window.left_out_s,
            hypotheses,
        }
    }

    fn fix(
        &self,
        epoch: &ObservationEpoch,
        search: &Search,
        best: &Candidate,
        excluded: Option<Sv>,
        false_ones: f64,
    ) -> Result<Fix, PositioningError> {
        let hypothesis = &search.hypotheses[best.hypothesis];
        let problem = self.problem(hypothesis.time);
        let excluded = excluded.into_iter().collect();
        let fix = finish(&problem, epoch, best.found.clone(), excluded)?;
        Ok(Fix {
            clock_bias_s: Some(epoch.receive_time - fix.time),
            time_search: Some(TimeSearch {
                searched_s: self.window.searched_s(),
                left_out_s: self.window.left_out_s,
                hypotheses: search.hypotheses.len(),
                false_expected: false_ones,
            }),
            ..fix
        })
    }
}

impl Hypothesis<'_> {
    fn is(&self, other: &Self) -> bool {
        let time = |h: &Self| h.time + h.region.late_s();
        (self.region.position_m() - other.region.position_m()).norm() < SAME_PLACE_M
            && (time(self) - time(other)).abs() < SAME_TIME_S
    }

    /// Bound on the probability that code phases of nothing give a joint cost of at most `cost` here.
    fn chance(&self, cost: f64) -> f64 {
        Prediction::new(&self.set, &self.region).chance(cost - self.region.cost)
    }
}

#[cfg(test)]
mod tests;
