//! The position from a capture too short for its navigation message.
//!
//! 1. The solver of the options on Dopplers from the Earth's centre (AW-DGN-BT by default), then Dopplers with time and a soft height
//!    ([`coarse_time`]): the region, to some 10 km.
//! 2. Candidates every 80 km on rings around it, and every 40 s of the time that the Dopplers leave
//!    open, each give the whole code periods against the highest satellite; every distinct set of
//!    integers is solved jointly with the Dopplers.
//! 3. The best must have a cost below `2 m + 4 sqrt(4 m)` for m satellites, and no other place may
//!    come near it: a wrong integer leaves residuals of kilometres, and is refused. If no set of
//!    integers passes, one and then two satellites are left out, as long as six remain.

mod blind;
mod coarse_time;
mod code_phases;
mod doppler_time;
mod time_window;

use crate::epoch::sighting::{Sighting, reference_clock, select, system_of};
use crate::epoch::velocity::motion;
use crate::error::{DropReason, Dropped, PositioningError};
use crate::fix::{Doubt, Fix, FixMethod, FixStart, Integrity, Residual};
use crate::integrity::{Geometry, MAX_RADIUS, MIN_RADIUS};
use crate::least_squares::{LeastSquares, LinearRow};
use crate::options::PositioningOptions;
use blind::solve_blind;
use coarse_time::{CODE_PERIOD_M, CoarseFix, CoarseTime, TIME};
use doppler_time::{rows, starts};
use nalgebra::{Vector3, Vector4};
use sdr_rx_gnss::constants::{EARTH_RADIUS, SPEED_OF_LIGHT};
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::observation::{CodeRange, Observation, ObservationEpoch};
use sdr_rx_gnss::{Constellation, GpsTime, NavigationData, Sv};
use std::collections::BTreeSet;

/// Unknowns of the code phases: position, bias and time.
const NEEDED: usize = 5;
/// With this many satellites the integers still prove themselves after a search over exclusions.
const NEEDED_AFTER_EXCLUSION: usize = 6;
/// Most satellites that are left out.
const MAX_EXCLUDED: usize = 2;
/// Speeds that the Dopplers are tried with, m/s: the lowest that explains them leaves the smallest region.
const SPEEDS_MPS: [f64; 8] = [0.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0];
/// Standard deviation of a code phase, m, of weak satellites near the horizon.
const PASSING_SIGMA_M: f64 = 10.0;
/// Most sets of integers that may be expected to agree by chance in a proved position.
const MOST_FALSE_EXPECTED: f64 = 0.01;
/// Spacing of candidates, m and s: half of it moves no code phase by more than a third of a period.
const RING_M: f64 = 80e3;
const TIME_STEP_S: f64 = 40.0;
/// Largest standard deviation of the position that is printed, m, and the same with five satellites,
/// whose code phases have no redundancy.
const MAX_SIGMA_M: f64 = 300.0;
const MAX_SIGMA_OF_FIVE_M: f64 = 150.0;
/// The next best place must cost more than this above the best: odds of e^20.
const DISTINCT_COST: f64 = 40.0;
/// Places nearer than this are the same, m.
const SAME_PLACE_M: f64 = 500.0;
/// A solution may be this many uncertainties from the time given: its own time has an error too.
const LATEST: f64 = 1.25;
/// Beyond this uncertainty of the time, s, it is searched for.
const SEARCHED_S: f64 = 600.0;

/// Position, time and clock from code phases modulo 1 ms and Dopplers; the epoch's receive time is
/// good to `options.time_uncertainty_s`. Where that is more than ten minutes, the time is searched for
/// ([`Fix::time_search`] tells how): over all times that the ephemerides cover if it is infinite.
///
/// # Errors
/// [`PositioningError`] names the cause: too few satellites (five are needed), stale ephemerides, no
/// place that explains the Dopplers or the code phases, two places that do, or weak geometry.
pub fn solve_snapshot(
    epoch: &ObservationEpoch,
    nav: &NavigationData,
    options: &PositioningOptions,
) -> Result<Fix, PositioningError> {
    if options.time_uncertainty_s > SEARCHED_S {
        let mut epoch = epoch.clone();
        epoch.observations.retain(|o| options.systems.contains(o.sv().constellation()));
        return solve_blind(&epoch, nav, options);
    }
    let time = epoch.receive_time;
    let (sightings, dropped) =
        select(epoch, options.systems, |observation| sighting(observation, time, nav), NEEDED)?;
    let problem = CoarseTime { time: epoch.receive_time, nav, options, speed_mps: 0.0 };
    let speeds = SPEEDS_MPS.iter().copied().filter(|&v| v < options.user_speed_mps);
    let speeds: Vec<f64> = speeds.chain([options.user_speed_mps]).collect();
    let mut error = None;
    let mut searches = 0;
    // Before a satellite is left out, the receiver may move.
    let attempts = (0..=MAX_EXCLUDED).flat_map(|count| speeds.iter().map(move |&v| (count, v)));
    for (count, speed_mps) in attempts {
        let problem = CoarseTime { speed_mps, ..problem };
        if count > 0 && sightings.len() < NEEDED_AFTER_EXCLUSION + count {
            break;
        }
        let mut solutions = Vec::new();
        for excluded in choices(sightings.len(), count) {
            let set: Vec<Sighting> = (0..sightings.len())
                .filter(|k| !excluded.contains(k))
                .map(|k| sightings[k])
                .collect();
            searches += 1;
            match search(&problem, &set) {
                Ok(found) if problem.is_timely(&found) => solutions.push((found, set, excluded)),
                Ok(found) => {
                    error.get_or_insert(problem.unexplained(found.set.len()));
                }
                Err(cause) => {
                    error.get_or_insert(cause);
                }
            }
        }
        solutions.sort_by(|a, b| a.0.fix.cost.total_cmp(&b.0.fix.cost));
        let mut solutions = solutions.into_iter();
        let Some((mut best, set, excluded)) = solutions.next() else { continue };
        // Each search may agree by chance.
        best.tried *= searches;
        if let Some((other, ..)) = solutions.find(|(s, ..)| s.contests(&best.fix)) {
            return Err(other.ambiguous(&best.fix));
        }
        alias(&problem, &set, &best)?;
        let excluded = excluded.iter().map(|&k| sightings[k].observation.sv()).collect();
        match finish(&problem, epoch, best, excluded) {
            Ok(mut fix) => {
                fix.unused.extend(dropped);
                return Ok(fix);
            }
            Err(cause) => {
                error.get_or_insert(cause);
            }
        }
    }
    Err(error.unwrap_or(PositioningError::TooFewSatellites {
        usable: sightings.len(),
        needed: NEEDED,
        dropped: Vec::new(),
    }))
}

/// Half a sidereal day later or earlier the satellites stand where they were, and the Earth has turned by 180 degrees: a
/// place opposite explains as much of what few satellites say.
const ALIAS_S: f64 = 43_082.0;

/// An error if the code phases are explained half a sidereal day off as well.
fn alias<'a>(
    problem: &CoarseTime<'a>,
    set: &[Sighting<'a>],
    best: &Found,
) -> Result<(), PositioningError> {
    for offset_s in [ALIAS_S, -ALIAS_S] {
        let time = problem.time + offset_s;
        let moved = |s: &Sighting<'a>| {
            Some(Sighting { orbit: problem.nav.orbit(s.sv(), time).ok()?, ..*s })
        };
        let set: Option<Vec<Sighting>> = set.iter().map(moved).collect();
        // Where no ephemerides are in force then, those of now are right to some kilometres: nothing is seen.
        let Some(set) = set else { continue };
        if let Ok(mut other) = search(&CoarseTime { time, ..*problem }, &set) {
            other.fix.place_time[TIME] += offset_s;
            return Err(other.ambiguous(&best.fix));
        }
    }
    Ok(())
}

impl CoarseTime<'_> {
    /// Whether a solution is at a time that the given one allows.
    fn is_timely(&self, found: &Found) -> bool {
        found.fix.late_s().abs() <= LATEST * self.options.time_uncertainty_s
    }

    fn unexplained(&self, satellites: usize) -> PositioningError {
        PositioningError::Unexplained {
            what: "code phases",
            satellites,
            time: self.time,
            uncertainty_s: self.options.time_uncertainty_s,
        }
    }
}

/// An observation of a snapshot, with its orbit at about `time`.
fn sighting<'a>(
    observation: &'a Observation,
    time: GpsTime,
    nav: &'a NavigationData,
) -> Result<Sighting<'a>, DropReason> {
    match observation.range {
        Some(CodeRange::ModuloCodePeriod(code_m)) => {
            // One clock and one period for all: codes of more milliseconds start with a millisecond too.
            let offset_m = SPEED_OF_LIGHT * system_offset_s(observation.sv(), time, nav);
            Sighting::new(observation, (code_m + offset_m).rem_euclid(CODE_PERIOD_M), time, nav)
        }
        Some(CodeRange::Pseudorange(_)) => Err(DropReason::WrongKindOfRange),
        None => Err(DropReason::NotANumber),
    }
}

/// By how much the time of a satellite's system is ahead of GPS time, s, as far as it is known: some nanoseconds.
fn system_offset_s(sv: Sv, time: GpsTime, nav: &NavigationData) -> f64 {
    let galileo = nav.galileo.gps_offset.filter(|_| sv.constellation() == Constellation::Galileo);
    galileo.map_or(0.0, |offset| offset.at(time))
}

/// All ways to choose `count` (0 to 2) of `n`.
fn choices(n: usize, count: usize) -> Vec<Vec<usize>> {
    match count {
        0 => vec![Vec::new()],
        1 => (0..n).map(|k| vec![k]).collect(),
        _ => (0..n).flat_map(|j| (j + 1..n).map(move |k| vec![j, k])).collect(),
    }
}

/// A solution with its integers, and the iterations spent since the Earth's centre.
#[derive(Clone)]
struct Found<'a> {
    fix: CoarseFix,
    /// The satellites used, and those of the set that are below the mask.
    set: Vec<Sighting<'a>>,
    below: Vec<Dropped>,
    integers: Vec<i32>,
    start: FixStart,
    iterations: usize,
    /// Sets of integers that were tried.
    tried: usize,
}

impl Found<'_> {
    /// Whether this is another place than `best` and not much less likely.
    fn contests(&self, best: &CoarseFix) -> bool {
        (self.fix.position_m() - best.position_m()).norm() > SAME_PLACE_M
            && self.fix.cost < best.cost + DISTINCT_COST
    }

    fn ambiguous(&self, best: &CoarseFix) -> PositioningError {
        PositioningError::Ambiguous {
            satellites: self.integers.len(),
            distance_m: (self.fix.position_m() - best.position_m()).norm(),
            apart_s: (self.fix.late_s() - best.late_s()).abs(),
        }
    }
}

/// Largest cost of `rows` rows: their mean and four standard deviations.
fn limit(rows: usize) -> f64 {
    let rows = rows as f64;
    rows + 4.0 * (2.0 * rows).sqrt()
}

/// From the Earth's centre to the one set of integers that explains the code phases.
fn search<'a>(problem: &CoarseTime, set: &[Sighting<'a>]) -> Result<Found<'a>, PositioningError> {
    let (region, start) = region(problem, set)?;
    let (above, below) = masked(problem, set, &region);
    // Atmosphere and reflections at the horizon are worse than their models.
    let (set, below, region) = if above.len() < NEEDED {
        (set.to_vec(), Vec::new(), region)
    } else {
        let region = CoarseFix {
            predictions: above.iter().map(|&k| region.predictions[k]).collect(),
            ..region
        };
        (above.iter().map(|&k| set[k]).collect(), below, region)
    };
    let set = &set[..];
    let mut tried = BTreeSet::new();
    let mut solutions: Vec<Found> = Vec::new();
    for offset in candidates(&region) {
        let (integers, bias_m) = integers(set, &region, &offset);
        if !tried.insert(integers.clone()) {
            continue;
        }
        let (at, drift_mps) = (region.place_time + offset, region.drift_mps);
        if let Some(fix) = problem.solve(set, Some((&integers, bias_m)), at, drift_mps) {
            let iterations = start.iterations + region.iterations + fix.iterations;
            let (set, below, start) = (set.to_vec(), below.clone(), start.clone());
            solutions.push(Found { fix, set, below, integers, start, iterations, tried: 0 });
        }
    }
    solutions.sort_by(|a, b| a.fix.cost.total_cmp(&b.fix.cost));
    let mut solutions = solutions.into_iter();
    let cost_limit = limit(2 * set.len());
    let best = solutions.next().filter(|best| best.fix.cost <= cost_limit);
    let Some(best) = best else {
        return Err(problem.unexplained(set.len()));
    };
    match solutions.find(|s| s.contests(&best.fix)) {
        Some(other) => Err(other.ambiguous(&best.fix)),
        None => Ok(Found { tried: tried.len(), ..best }),
    }
}

/// Which of the satellites of a solution are above the mask, and the others.
fn masked(problem: &CoarseTime, set: &[Sighting], fix: &CoarseFix) -> (Vec<usize>, Vec<Dropped>) {
    let elevation = |k: usize| fix.predictions[k].elevation;
    let (above, below): (Vec<usize>, Vec<usize>) =
        (0..set.len()).partition(|&k| elevation(k) >= problem.options.elevation_mask);
    let dropped =
        |k: usize| Dropped { sv: set[k].sv(), reason: DropReason::BelowMask(elevation(k)) };
    (above, below.into_iter().map(dropped).collect())
}

/// Where the Dopplers put the receiver, and how it came there.
fn region(
    problem: &CoarseTime,
    set: &[Sighting],
) -> Result<(CoarseFix, FixStart), PositioningError> {
    let rows = rows(set, problem.time);
    let cost_limit = limit(rows.len());
    starts(&rows, problem.options)
        .into_iter()
        .filter_map(|(place, start)| {
            let at = (place.xyz().normalize() * EARTH_RADIUS).push(0.0);
            problem.solve(set, None, at, place.w).map(|fix| (fix, start))
        })
        .find(|(fix, _)| fix.cost <= cost_limit)
        .ok_or(PositioningError::Unexplained {
            what: "Dopplers",
            satellites: set.len(),
            time: problem.time,
            uncertainty_s: problem.options.time_uncertainty_s,
        })
}

/// Offsets of position and time from the region, most likely first within each time step.
fn candidates(region: &CoarseFix) -> Vec<Vector4<f64>> {
    let covariance = &region.covariance;
    let time_variance = covariance[(TIME, TIME)];
    let per_second = covariance.fixed_view::<3, 1>(0, TIME) / time_variance;
    let at_fixed_time =
        covariance.fixed_view::<3, 3>(0, 0) - per_second * per_second.transpose() * time_variance;
    let rings =
        (3.0 * at_fixed_time.trace().max(0.0).sqrt() / RING_M).ceil().clamp(1.0, 5.0) as i32;
    let time_steps = (2.0 * time_variance.sqrt() / TIME_STEP_S).ceil().min(6.0) as i32;
    let to_ecef = Geodetic::from_ecef(&region.position_m()).ecef_to_enu().transpose();
    let mut offsets = Vec::new();
    for step in -time_steps..=time_steps {
        let dt = f64::from(step) * TIME_STEP_S;
        for ring in 0..=rings {
            for k in 0..(6 * ring).max(1) {
                let angle = std::f64::consts::TAU * f64::from(k) / f64::from((6 * ring).max(1));
                let local = Vector3::new(angle.sin(), angle.cos(), 0.0) * RING_M * f64::from(ring);
                let shift = to_ecef * local + per_second * dt;
                offsets.push(shift.push(dt));
            }
        }
    }
    offsets
}

/// Whole code periods of each satellite against the highest, and the bias, m, that fits that one,
/// with ranges linearised around the region.
fn integers(set: &[Sighting], region: &CoarseFix, offset: &Vector4<f64>) -> (Vec<i32>, f64) {
    let shift = offset.xyz();
    let predicted: Vec<f64> = region
        .predictions
        .iter()
        .map(|s| {
            let rate = s.range_rate(&Vector3::zeros(), 0.0);
            s.range_m - s.direction.dot(&shift) + rate * offset[TIME]
        })
        .collect();
    let elevation = |k: &usize| region.predictions[*k].elevation;
    let highest = (0..set.len()).max_by(|a, b| elevation(a).total_cmp(&elevation(b))).unwrap_or(0);
    let observed = code_phases(set);
    let bias_m = observed[highest] - predicted[highest];
    let whole = |(o, p): (&f64, &f64)| ((p + bias_m - o) / CODE_PERIOD_M).round() as i32;
    (observed.iter().zip(&predicted).map(whole).collect(), bias_m)
}

/// Code phases of a snapshot's satellites, m; each has one.
fn code_phases(set: &[Sighting]) -> Vec<f64> {
    set.iter().filter_map(|s| s.range_m).collect()
}

/// Applies the elevation mask and the last checks, and makes the fix.
fn finish(
    problem: &CoarseTime,
    epoch: &ObservationEpoch,
    found: Found,
    excluded: Vec<Sv>,
) -> Result<Fix, PositioningError> {
    let set = &found.set[..];
    let (above, below) = masked(problem, set, &found.fix);
    let used: Vec<Sighting> = above.iter().map(|&k| set[k]).collect();
    let unused: Vec<Dropped> = found.below.iter().copied().chain(below).collect();
    let too_few = PositioningError::TooFewSatellites {
        usable: used.len(),
        needed: NEEDED,
        dropped: unused.clone(),
    };
    if used.len() < NEEDED {
        return Err(too_few);
    }
    let fix = if used.len() == set.len() {
        found.fix
    } else {
        let integers: Vec<i32> = above.iter().map(|&k| found.integers[k]).collect();
        let CoarseFix { place_time, drift_mps, bias_m, .. } = found.fix;
        problem.solve(&used, Some((&integers, bias_m)), place_time, drift_mps).ok_or(too_few)?
    };
    if fix.late_s().abs() > LATEST * problem.options.time_uncertainty_s {
        return Err(problem.unexplained(used.len()));
    }
    let position_m = fix.position_m();
    let radius_m = position_m.norm();
    if !(MIN_RADIUS..MAX_RADIUS).contains(&radius_m) {
        return Err(PositioningError::ImplausibleRadius { radius_m });
    }
    let satellites = used.len();
    let sigma_m = fix.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
    let weak = |name, value, limit| PositioningError::DegenerateGeometry {
        satellites,
        name,
        value,
        limit,
    };
    let sigma_limit = if satellites > NEEDED { MAX_SIGMA_M } else { MAX_SIGMA_OF_FIVE_M };
    if sigma_m > sigma_limit {
        return Err(weak("standard deviation of the position in metres", sigma_m, sigma_limit));
    }
    let mut code = LeastSquares::<4, 5>::default();
    code.set(fix.predictions.iter().map(|predicted| {
        let (g, rate) = (-predicted.direction, predicted.range_rate(&Vector3::zeros(), 0.0));
        LinearRow::new([g.x, g.y, g.z, rate, 0.0], 1.0, Some(0))
    }));
    code.factor(1).ok_or(weak("dilution of precision", f64::INFINITY, 100.0))?;
    let cofactor = code.covariance().fixed_view::<3, 3>(0, 0).into_owned();
    let geometry = Geometry::new(&position_m, &cofactor, satellites)?;
    let covariance = fix.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    // Of false integers a code phase that is redundant agrees by chance within four standard deviations either way.
    let chance = 8.0 * PASSING_SIGMA_M / CODE_PERIOD_M;
    let redundant = satellites.saturating_sub(NEEDED) as i32;
    let proved = redundant > 0 && found.tried as f64 * chance.powi(redundant) < MOST_FALSE_EXPECTED;
    if !proved && !excluded.is_empty() {
        // What is left after an exclusion agrees by chance too easily.
        return Err(problem.unexplained(satellites));
    }
    let motion = motion(&used, &fix.predictions);
    let (velocity, drift) =
        motion.map_or((Vector3::zeros(), fix.drift_mps), |m| (m.velocity_mps, m.drift_mps));
    let residuals = used.iter().zip(&fix.predictions).zip(&fix.code_residuals_m);
    let residuals = residuals.map(|((sighting, predicted), &range_m)| Residual {
        sv: sighting.observation.sv(),
        range_m: Some(range_m),
        doppler_hz: (sighting.observation.doppler_hz).map(|observed| {
            observed + predicted.range_rate(&velocity, drift) / sighting.wavelength_m()
        }),
        azimuth: predicted.azimuth,
        elevation: predicted.elevation,
    });
    Ok(Fix {
        time: problem.time + fix.late_s(),
        sample: epoch.sample,
        position_m,
        velocity_mps: motion.map(|m| m.velocity_mps),
        clock_bias_s: Some(-fix.late_s()),
        // Whole periods are resolved for one clock.
        reference: system_of(reference_clock(&used)),
        offsets: Vec::new(),
        clock_drift_sps: Some(drift / SPEED_OF_LIGHT),
        covariance: geometry.local(&covariance),
        clock_bias_sigma_s: Some(fix.covariance[(TIME, TIME)].sqrt()),
        pdop: geometry.pdop,
        hdop: geometry.hdop,
        vdop: geometry.vdop,
        residuals: residuals.collect(),
        integrity: match excluded.is_empty() {
            _ if !proved => Integrity::Unverified,
            true => Integrity::Verified,
            false => Integrity::Excluded,
        },
        doubt: (!proved).then_some(Doubt::NoRedundancy),
        protection: None,
        unused,
        excluded,
        method: FixMethod::Snapshot,
        start: found.start,
        time_search: None,
        alternatives_m: Vec::new(),
        iterations: found.iterations,
    })
}

#[cfg(test)]
mod tests;
