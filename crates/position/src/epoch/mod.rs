//! The position of one epoch whose time is known, with the receiver's full model.
//!
//! A bare solver from the Earth's centre on satellite positions ([`cold_start`]), then Gauss-Newton,
//! weighted, on [`predicted`]: light time, Earth rotation, satellite clock, relativity, T_GD, Klobuchar and
//! Saastamoinen ([`adjustment`]). Which satellites are faulty, and whether the place is proved, says a list of fault
//! hypotheses ([`separation`]); epochs of one receiver tell how far its errors are those of the model ([`sequence`]).

mod adjustment;
mod cold_start;
pub(crate) mod predicted;
mod separation;
pub(crate) mod sequence;
pub(crate) mod sighting;
pub(crate) mod static_point;
pub(crate) mod velocity;

use crate::error::{DropReason, Dropped, PositioningError};
use crate::fix::{
    Doubt, FailedStart, FailedStartCause, Fix, FixMethod, FixStart, Integrity, InterSystemOffset,
    ProtectionLevel, Residual,
};
use crate::options::{Exclusion, Observable, PositioningOptions};
use crate::point::Point;
use crate::problem::RowKind;
use crate::solver::Solver;
use crate::solver::point_solution::Iteration;
pub(crate) use adjustment::ITERATES_M;
use adjustment::{Adjusted, Adjustment, DRIFT, Measured};
use cold_start::{ColdStart, cold_start};
use nalgebra::Vector3;
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::observation::{CodeRange, Observation, ObservationEpoch};
use sdr_rx_gnss::{NavigationData, Sv};
use separation::{Answer, Hypotheses, Hypothesis, Set, subsets};
use sighting::{Sighting, clock_of, select};
use velocity::motion;

/// Position, velocity, clock and what a person needs to trust them, from the full pseudoranges, Dopplers or
/// both of one epoch, as the options say, from the Earth's centre.
///
/// From Dopplers alone the time of reception is taken as the receiver's clock has it (a millisecond of error
/// is 4 m of the satellites), and the receiver is taken to rest: 1 m/s moves the result by 6 km.
///
/// # Errors
/// [`PositioningError`] names the cause: too few usable satellites, stale ephemerides, divergence,
/// degenerate geometry, an implausible place, satellites that contradict each other, or sets of them that agree on
/// different places.
pub fn solve_epoch(
    epoch: &ObservationEpoch,
    nav: &NavigationData,
    options: &PositioningOptions,
) -> Result<Fix, PositioningError> {
    solve_traced(epoch, nav, options, &mut |_| ())
}

/// As [`solve_epoch`]; `trace` sees each accepted step of the solver that comes from the Earth's centre.
///
/// # Errors
/// As [`solve_epoch`].
pub fn solve_traced(
    epoch: &ObservationEpoch,
    nav: &NavigationData,
    options: &PositioningOptions,
    trace: &mut dyn FnMut(&Iteration),
) -> Result<Fix, PositioningError> {
    candidates(epoch, nav, options, trace)?.judge(1.0)
}

/// An epoch with the places of all its fault hypotheses: what of an epoch does not depend on those before.
pub struct Candidates<'a> {
    epoch: &'a ObservationEpoch,
    adjustment: Adjustment<'a>,
    sightings: Vec<Sighting<'a>>,
    dropped: Vec<Dropped>,
    cold_start: ColdStart,
    hypotheses: Hypotheses<'a>,
}

/// Solves an epoch without judging it; `trace` is that of [`solve_traced`].
///
/// # Errors
/// Too few usable satellites, stale ephemerides, divergence.
pub fn candidates<'a>(
    epoch: &'a ObservationEpoch,
    nav: &'a NavigationData,
    options: &'a PositioningOptions,
    trace: &mut dyn FnMut(&Iteration),
) -> Result<Candidates<'a>, PositioningError> {
    let (sightings, dropped) = sightings(epoch, nav, options)?;
    let adjustment = Adjustment { receive_time: epoch.receive_time, nav, options };
    let mut cold_start = cold_start_of_most(&adjustment, &sightings, options.solver, trace)?;
    let mut hypotheses = hypotheses(adjustment, &sightings, &cold_start.state);
    let is_open = !hypotheses.agree() && options.solver != Solver::Best && options.takes_over;
    if is_open && cold_start.start.failed.is_none() && !hypotheses.explain() {
        // From the same region the hypotheses are the same.
        let is_elsewhere = |cold: &ColdStart| (cold.state.x - cold_start.state.x).norm() > REGION_M;
        let other = cold_start_of_most(&adjustment, &sightings, Solver::Best, trace);
        let tried = other.ok().filter(is_elsewhere);
        let tried = tried.map(|cold| (self::hypotheses(adjustment, &sightings, &cold.state), cold));
        if let Some((others, mut cold)) = tried.filter(|(others, _)| others.explain()) {
            cold.start.iterations += cold_start.start.iterations;
            cold.start.failed = Some(FailedStart {
                solver: options.solver.name(),
                cause: FailedStartCause::Unexplained,
            });
            (hypotheses, cold_start) = (others, cold);
        }
    }
    Ok(Candidates { epoch, adjustment, sightings, dropped, cold_start, hypotheses })
}

/// The fault hypotheses of the satellites above the mask, as seen from `start`.
fn hypotheses<'a>(
    adjustment: Adjustment<'a>,
    sightings: &[Sighting<'a>],
    start: &Point<3>,
) -> Hypotheses<'a> {
    let above = above_mask(&adjustment, sightings, start);
    let all_above = above.len() == sightings.len();
    let hypotheses = Hypotheses::new(adjustment, above, start);
    // A fault may have led to a place from where the wrong satellites seem below the mask.
    if all_above || hypotheses.explain() {
        return hypotheses;
    }
    let all = Hypotheses::new(adjustment, sightings.to_vec(), start);
    if all.explain() { all } else { hypotheses }
}

/// The observations of an epoch that the observable needs and that have an orbit, and the others.
fn sightings<'a>(
    epoch: &'a ObservationEpoch,
    nav: &'a NavigationData,
    options: &PositioningOptions,
) -> Result<(Vec<Sighting<'a>>, Vec<Dropped>), PositioningError> {
    let time = epoch.receive_time;
    let sighting = |o: &'a Observation| {
        if let (Some(cn0), Some(least)) = (o.cn0_dbhz, options.min_cn0_dbhz)
            && cn0 < least
        {
            return Err(DropReason::Weak(cn0));
        }
        match (options.observable, o.range) {
            (Observable::Doppler, _) => Sighting::of_doppler(o, time, nav),
            (_, Some(CodeRange::Pseudorange(range_m))) => Sighting::new(o, range_m, time, nav),
            (_, Some(CodeRange::ModuloCodePeriod(_))) => Err(DropReason::WrongKindOfRange),
            (_, None) => Err(DropReason::NotANumber),
        }
    };
    let (sightings, dropped) = select(epoch, options.systems, sighting, 4)?;
    let needed = needed(&sightings, options);
    match sightings.len() {
        usable if usable < needed => {
            Err(PositioningError::TooFewSatellites { usable, needed, dropped })
        }
        _ => Ok((sightings, dropped)),
    }
}

/// Satellites that a position needs: three, and one for each clock; Dopplers contain one drift.
fn needed(sightings: &[Sighting], options: &PositioningOptions) -> usize {
    let mut clocks: Vec<usize> = sightings.iter().map(|s| clock_of(s.sv())).collect();
    clocks.sort_unstable();
    clocks.dedup();
    let is_of_ranges = options.observable == Observable::Pseudorange;
    3 + if is_of_ranges { clocks.len().max(1) } else { 1 }
}

/// From the Earth's centre by all satellites; where that fails, without the first one or two that let it succeed.
fn cold_start_of_most(
    adjustment: &Adjustment,
    set: &[Sighting],
    solver: Solver,
    trace: &mut dyn FnMut(&Iteration),
) -> Result<ColdStart, PositioningError> {
    let all = cold_start(adjustment, set, solver, trace);
    let spare = match adjustment.options.exclusion {
        Exclusion::Off => 0,
        _ => set.len().saturating_sub(5).min(2) as u32,
    };
    let mut fewer = (1..=spare).flat_map(|faults| subsets(set.len() as u32, faults));
    let mut without = |faulty: Set| {
        let used = set.iter().enumerate().filter(|(k, _)| faulty >> k & 1 == 0);
        let used: Vec<Sighting> = used.map(|(_, sighting)| *sighting).collect();
        cold_start(adjustment, &used, solver, trace).ok()
    };
    all.or_else(|error| fewer.find_map(&mut without).ok_or(error))
}

/// The satellites above the elevation mask as seen from a point.
fn above_mask<'a>(
    adjustment: &Adjustment,
    set: &[Sighting<'a>],
    at: &Point<3>,
) -> Vec<Sighting<'a>> {
    let mask = adjustment.options.elevation_mask;
    let seen = set.iter().zip(adjustment.predict(set, at));
    seen.filter(|(_, p)| p.elevation >= mask).map(|(sighting, _)| *sighting).collect()
}

impl<'a> Candidates<'a> {
    /// Weighted sum of squared residuals of all satellites over its degrees of freedom; none without redundancy.
    pub fn variance_ratio(&self) -> Option<f64> {
        let all = self.hypotheses.faultless().filter(|all| all.redundancy > 0)?;
        Some(all.cost / all.redundancy as f64)
    }

    /// Weighted sum of squared residuals of all satellites; none without redundancy.
    pub fn cost(&self) -> Option<f64> {
        self.hypotheses.faultless().filter(|all| all.redundancy > 0).map(|all| all.cost)
    }

    /// Whether all satellites pass the chi-square test together.
    pub fn agree(&self) -> bool {
        self.hypotheses.agree()
    }

    /// The position, if variances are `factor` times what the error model has; tests and protection levels take
    /// them as at least that of the model.
    ///
    /// # Errors
    /// As [`solve_epoch`].
    pub fn judge(mut self, factor: f64) -> Result<Fix, PositioningError> {
        /// The mask as seen from a better place may let other satellites in, once or twice.
        const MASKED: usize = 3;
        let options = self.adjustment.options;
        if options.exclusion == Exclusion::Off {
            let start = self.cold_start.state.clone();
            let set = self.masked(&start)?;
            let point = self.adjustment.solve(set, start, self.cold_start.start.iterations)?;
            return Ok(self.fix(&point, factor, &[], None));
        }
        for _ in 0..MASKED {
            let (best, level) = match self.hypotheses.judge(factor) {
                Answer::Place(best, level) => (best, level),
                Answer::Competing(best, rival) => return Err(self.competing(&best, &rival)),
                Answer::None => return Err(self.contradiction()),
            };
            let above = self.masked(&best.point)?;
            if !above.iter().map(Sighting::sv).eq(self.hypotheses.set.iter().map(Sighting::sv)) {
                self.hypotheses = Hypotheses::new(self.adjustment, above, &best.point);
                continue;
            }
            let faulty = self.names(&best);
            if options.exclusion == Exclusion::Refuse && !faulty.is_empty() {
                return Err(self.contradiction());
            }
            let used = above.into_iter().filter(|s| !faulty.contains(&s.sv())).collect();
            let alert_limit_m = self.hypotheses.alert_limit(&best, factor);
            let iterations = self.cold_start.start.iterations;
            let point = self.adjustment.solve(used, best.point.clone(), iterations)?;
            // What a robust loss, or weights by observable, make of it.
            let moved = (point.state.x - best.point.x).norm();
            let level = level.map(|level| level.widened(moved));
            let mut fix = self.fix(&point, factor, &faulty, level);
            if level.is_some_and(|level| level.position_m <= alert_limit_m) {
                fix.doubt = None;
                fix.integrity = match fix.excluded.is_empty() {
                    true => Integrity::Verified,
                    false => Integrity::Excluded,
                };
            }
            return Ok(fix);
        }
        Err(self.contradiction())
    }

    /// The satellites above the mask, at least as many as are needed.
    fn masked(&self, at: &Point<3>) -> Result<Vec<Sighting<'a>>, PositioningError> {
        let above = above_mask(&self.adjustment, &self.sightings, at);
        let needed = needed(&above, self.adjustment.options);
        if above.len() >= needed {
            return Ok(above);
        }
        let dropped = self.below_mask(at).chain(self.dropped.iter().copied()).collect();
        Err(PositioningError::TooFewSatellites { usable: above.len(), needed, dropped })
    }

    fn below_mask(&self, at: &Point<3>) -> impl Iterator<Item = Dropped> {
        let mask = self.adjustment.options.elevation_mask;
        let predictions = self.adjustment.predict(&self.sightings, at);
        let all = self.sightings.iter().zip(predictions);
        all.filter(move |(_, p)| p.elevation < mask).map(|(sighting, p)| Dropped {
            sv: sighting.sv(),
            reason: DropReason::BelowMask(p.elevation),
        })
    }

    /// The satellites that a hypothesis takes for faulty.
    fn names(&self, hypothesis: &Hypothesis) -> Vec<Sv> {
        let set = self.hypotheses.set.iter().enumerate();
        set.filter(|(k, _)| hypothesis.faulty >> k & 1 == 1).map(|(_, s)| s.sv()).collect()
    }

    fn competing(&self, best: &Hypothesis, rival: &Hypothesis) -> PositioningError {
        let place = |h: &Hypothesis| (h.point.x, self.names(h));
        let places = Box::new([place(best), place(rival)]);
        PositioningError::Competing { satellites: self.hypotheses.set.len(), places }
    }

    /// What is wrong with all satellites together.
    fn contradiction(&self) -> PositioningError {
        /// Places that are named.
        const NAMED: usize = 4;
        let (set, start) = (self.hypotheses.set.clone(), self.cold_start.state.clone());
        match self.adjustment.solve(set, start, self.cold_start.start.iterations) {
            Ok(point) if point.contradiction() > 1.0 => {
                let mut error = point.inconsistent();
                if let PositioningError::Inconsistent { places, .. } = &mut error {
                    let named = self.hypotheses.unchecked().take(NAMED);
                    places.extend(named.map(|h| (h.point.x, self.names(h))));
                }
                error
            }
            Ok(point) => PositioningError::ImplausibleRadius { radius_m: point.state.x.norm() },
            Err(error) => error,
        }
    }

    /// Other places near the ground that explain the satellites of a solution as well.
    fn other_places(&self, point: &Adjusted<'a>) -> Vec<Vector3<f64>> {
        let refined = |start: &Point<3>| {
            match self.adjustment.solve(point.used.clone(), start.clone(), 0) {
                Ok(other) => (other.contradiction() <= 1.0).then_some(other.state.x),
                // Too weak a geometry for a fix of its own: still a place that fits.
                Err(_) => Some(start.x),
            }
        };
        let distinct = |place: &Vector3<f64>| (place - point.state.x).norm() > DISTINCT_M;
        self.cold_start.alternatives.iter().filter_map(refined).filter(distinct).collect()
    }

    /// The fix that an adjustment amounts to, not proved.
    fn fix(
        &self,
        point: &Adjusted<'a>,
        factor: f64,
        faulty: &[Sv],
        protection: Option<ProtectionLevel>,
    ) -> Fix {
        let start = self.cold_start.start.clone();
        let fix = fix(point, self.epoch.sample, faulty.to_vec(), start, self.adjustment.options);
        let below = self.below_mask(&point.state);
        Fix {
            alternatives_m: self.other_places(point),
            covariance: fix.covariance * factor,
            clock_bias_sigma_s: fix.clock_bias_sigma_s.map(|sigma_s| sigma_s * factor.sqrt()),
            offsets: (fix.offsets.into_iter())
                .map(|o| InterSystemOffset { sigma_s: o.sigma_s * factor.sqrt(), ..o })
                .collect(),
            unused: self.dropped.iter().copied().chain(below).collect(),
            doubt: Some(match protection {
                Some(_) => Doubt::ProtectionLevel,
                None if self.adjustment.options.exclusion == Exclusion::Off => {
                    Doubt::ProtectionLevel
                }
                None => Doubt::NoRedundancy,
            }),
            protection,
            ..fix
        }
    }
}

/// The fix that an adjustment amounts to.
fn fix(
    point: &Adjusted,
    sample: f64,
    mut excluded: Vec<Sv>,
    start: FixStart,
    options: &PositioningOptions,
) -> Fix {
    // What Dopplers are compared with: the motion they give where they gave no position.
    let at_rest = options.observable != Observable::Pseudorange;
    let motion = if at_rest { None } else { motion(&point.used, &point.view.predictions) };
    let moving = motion.map(|m| (m.velocity_mps, m.drift_mps));
    let moving = moving.or(at_rest.then_some((Vector3::zeros(), point.state.clocks[DRIFT])));
    let residual = |k: usize| {
        let (sighting, predicted) = (&point.used[k], &point.view.predictions[k]);
        let is_code = |r: &&Measured| r.satellite == k && r.kind == RowKind::Range;
        let code = point.view.rows.iter().find(is_code);
        let wavelength_m = sighting.wavelength_m();
        Residual {
            sv: sighting.observation.sv(),
            range_m: code.map(|row| row.residual),
            doppler_hz: sighting.observation.doppler_hz.zip(moving).map(
                |(observed, (v, drift))| observed + predicted.range_rate(&v, drift) / wavelength_m,
            ),
            azimuth: predicted.azimuth,
            elevation: predicted.elevation,
        }
    };
    // A robust loss that gives a satellite no weight has excluded it.
    let weightless = |k: &usize| {
        let rows = point.view.rows.iter().zip(&point.view.weights);
        let mut weights = rows.filter(|(r, _)| r.satellite == *k);
        weights.all(|(_, &weight)| weight == 0.0)
    };
    let (rejected, used): (Vec<_>, Vec<_>) = (0..point.used.len()).partition(weightless);
    excluded.extend(rejected.iter().map(|&k| point.used[k].observation.sv()));
    excluded.sort();
    Fix {
        time: point.time,
        sample,
        position_m: point.state.x,
        velocity_mps: motion.map(|m| m.velocity_mps),
        clock_bias_s: point.bias_m.map(|(bias_m, _)| bias_m / SPEED_OF_LIGHT),
        reference: point.reference,
        offsets: point.offsets.clone(),
        clock_drift_sps: moving.map(|(_, drift)| drift / SPEED_OF_LIGHT),
        covariance: point.geometry.local(&point.covariance),
        clock_bias_sigma_s: point.bias_m.map(|(_, sigma_m)| sigma_m / SPEED_OF_LIGHT),
        pdop: point.geometry.pdop,
        hdop: point.geometry.hdop,
        vdop: point.geometry.vdop,
        residuals: used.into_iter().map(residual).collect(),
        excluded,
        unused: Vec::new(),
        integrity: Integrity::Unverified,
        doubt: None,
        protection: None,
        method: match options.observable {
            Observable::Pseudorange => FixMethod::Tracking,
            Observable::Doppler => FixMethod::Doppler,
            Observable::Both => FixMethod::Combined,
        },
        time_search: None,
        start,
        alternatives_m: Vec::new(),
        iterations: point.iterations,
    }
}

/// From places nearer to each other than this, m, the full model comes to the same ones.
const REGION_M: f64 = 50e3;
/// Places farther apart than this are two, m.
const DISTINCT_M: f64 = 1e3;

#[cfg(test)]
mod system_tests;
#[cfg(test)]
mod tests;
