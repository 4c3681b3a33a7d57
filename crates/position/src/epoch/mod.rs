//! The position of one epoch whose time is known, with the receiver's full model.
//!
//! A bare solver from the Earth's centre on satellite positions ([`cold_start`]), then Gauss-Newton,
//! weighted, on [`predicted`]: light time, Earth rotation, satellite clock, relativity, T_GD, Klobuchar and
//! Saastamoinen ([`adjustment`]). A chi-square test of the residuals (1e-5 of false alarm) guards the result; a
//! satellite without which it passes is excluded if one more than there are unknowns is left.

mod adjustment;
mod cold_start;
pub(crate) mod predicted;
pub(crate) mod sighting;
pub(crate) mod static_point;
pub(crate) mod velocity;

use crate::error::{DropReason, Dropped, PositioningError};
use crate::fix::{Fix, FixMethod, Residual};
use crate::options::{Exclusion, Observable, PositioningOptions};
use crate::point::Point;
use crate::problem::RowKind;
use crate::solver::Solver;
use crate::solver::point_solution::Iteration;
pub(crate) use adjustment::ITERATES_M;
use adjustment::{Adjusted, Adjustment, BIAS, DRIFT, Measured};
use cold_start::{ColdStart, cold_start};
use nalgebra::Vector3;
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::observation::{CodeRange, Observation, ObservationEpoch};
use sdr_rx_gnss::{NavigationData, Sv};
use sighting::{Sighting, select};
use velocity::motion;

/// Position, velocity, clock and what a person needs to trust them, from the full pseudoranges, Dopplers or
/// both of one epoch, as the options say, from the Earth's centre.
///
/// From Dopplers alone the time of reception is taken as the receiver's clock has it (a millisecond of error
/// is 4 m of the satellites), and the receiver is taken to rest: 1 m/s moves the result by 6 km.
///
/// # Errors
/// [`PositioningError`] names the cause: too few usable satellites, stale ephemerides, divergence,
/// degenerate geometry, an implausible place, or contradicting satellites too few to tell which.
pub fn solve_epoch(
    epoch: &ObservationEpoch,
    nav: &NavigationData,
    options: &PositioningOptions,
) -> Result<Fix, PositioningError> {
    solve_traced(epoch, nav, options, &mut |_| ())
}

/// As [`solve_epoch`]; `trace` sees each accepted step of the solver that comes from the Earth's centre, of
/// every set of satellites that is tried.
///
/// # Errors
/// As [`solve_epoch`].
pub fn solve_traced(
    epoch: &ObservationEpoch,
    nav: &NavigationData,
    options: &PositioningOptions,
    trace: &mut dyn FnMut(&Iteration),
) -> Result<Fix, PositioningError> {
    let sightings = sightings(epoch, nav, options.observable)?;
    let adjustment = Adjustment { receive_time: epoch.receive_time, nav, options };
    let mut solver =
        EpochSolver { adjustment, trace, solver: options.solver, alternatives: Vec::new() };
    let (point, excluded) = solver.solve_with_exclusion(sightings)?;
    let alternatives_m = solver.other_places(&point);
    let solver = solver.solver.name();
    Ok(Fix { solver, alternatives_m, ..fix(&point, epoch.sample, excluded, options) })
}

/// The observations of an epoch that the observable needs and that have an orbit.
fn sightings<'a>(
    epoch: &'a ObservationEpoch,
    nav: &'a NavigationData,
    observable: Observable,
) -> Result<Vec<Sighting<'a>>, PositioningError> {
    let time = epoch.receive_time;
    let sighting = |o: &'a Observation| match (observable, o.range) {
        (Observable::Doppler, _) => Sighting::of_doppler(o, time, nav),
        (_, Some(CodeRange::Pseudorange(range_m))) => Sighting::new(o, range_m, time, nav),
        (_, Some(CodeRange::ModuloCodePeriod(_))) => Err(DropReason::WrongKindOfRange),
        (_, None) => Err(DropReason::NotANumber),
    };
    select(epoch, sighting, 4)
}

/// The fix that an adjustment amounts to.
fn fix(point: &Adjusted, sample: f64, mut excluded: Vec<Sv>, options: &PositioningOptions) -> Fix {
    // What Dopplers are compared with: the motion they give where they gave no position.
    let at_rest = options.observable != Observable::Pseudorange;
    let motion = if at_rest { None } else { motion(&point.used, &point.view.predictions) };
    let moving = motion.map(|m| (m.velocity_mps, m.drift_mps));
    let moving = moving.or(at_rest.then_some((Vector3::zeros(), point.state.clocks[DRIFT])));
    let residual = |k: usize| {
        let (sighting, predicted) = (&point.used[k], &point.view.predictions[k]);
        let is_code = |r: &&Measured| r.satellite == k && r.kind == RowKind::Range;
        let code = point.view.rows.iter().find(is_code);
        let wavelength_m = sighting.observation.transmission.wavelength_m();
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
        clock_bias_s: point.bias_sigma_m.map(|_| point.state.clocks[BIAS] / SPEED_OF_LIGHT),
        clock_drift_sps: moving.map(|(_, drift)| drift / SPEED_OF_LIGHT),
        covariance: point.geometry.local(&point.covariance),
        clock_bias_sigma_s: point.bias_sigma_m.map(|sigma_m| sigma_m / SPEED_OF_LIGHT),
        pdop: point.geometry.pdop,
        hdop: point.geometry.hdop,
        vdop: point.geometry.vdop,
        residuals: used.into_iter().map(residual).collect(),
        excluded,
        method: match options.observable {
            Observable::Pseudorange => FixMethod::Tracking,
            Observable::Doppler => FixMethod::Doppler,
            Observable::Both => FixMethod::Combined,
        },
        time_search: None,
        solver: options.solver.name(),
        alternatives_m: Vec::new(),
        iterations: point.iterations,
    }
}

/// Places farther apart than this are two, m.
const DISTINCT_M: f64 = 1e3;

/// A solver of sets of satellites of one epoch.
struct EpochSolver<'a, 't> {
    adjustment: Adjustment<'a>,
    trace: &'t mut dyn FnMut(&Iteration),
    /// The bare solver that led to the last set's solution, and the other places that fitted it.
    solver: Solver,
    alternatives: Vec<Point<3>>,
}

impl<'a> EpochSolver<'a, '_> {
    /// Solves, and leaves out satellites one at a time, best first, until the residuals are
    /// consistent: at most half of the redundant ones, and never so that less than one is redundant.
    fn solve_with_exclusion(
        &mut self,
        mut set: Vec<Sighting<'a>>,
    ) -> Result<(Adjusted<'a>, Vec<Sv>), PositioningError> {
        let exclusion = self.adjustment.options.exclusion;
        let limit = (set.len() - 4) / 2;
        let mut excluded = Vec::new();
        let mut first_error = None;
        loop {
            let error = match self.solve_set(&set) {
                Ok(point) if point.contradiction() <= 1.0 || exclusion == Exclusion::Off => {
                    return Ok((point, excluded));
                }
                Ok(point) => point.inconsistent(),
                Err(error) => error,
            };
            let error = first_error.get_or_insert(error);
            let may = exclusion == Exclusion::ChiSquare && set.len() >= 6 && excluded.len() < limit;
            let best = (0..set.len())
                .filter(|_| may)
                .filter_map(|k| {
                    let mut rest = set.clone();
                    rest.remove(k);
                    Some((k, self.solve_set(&rest).ok()?.contradiction()))
                })
                .min_by(|a, b| a.1.total_cmp(&b.1));
            match best {
                Some((k, _)) => excluded.push(set.remove(k).observation.sv()),
                None => return Err(error.clone()),
            }
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
        self.alternatives.iter().filter_map(refined).filter(distinct).collect()
    }

    /// From the Earth's centre to the full model, above the elevation mask.
    fn solve_set(&mut self, set: &[Sighting<'a>]) -> Result<Adjusted<'a>, PositioningError> {
        let adjustment = self.adjustment;
        let ColdStart { state: start, iterations: spent, solver, alternatives } =
            cold_start(&adjustment, set, self.trace)?;
        (self.solver, self.alternatives) = (solver, alternatives);
        let mask = adjustment.options.elevation_mask;
        let mut set = set.to_vec();
        if adjustment.options.observable != Observable::Pseudorange {
            // At the horizon the atmosphere's delay changes too fast for the rate to be linearised.
            let predictions = adjustment.predict(&set, &start);
            let mut above = predictions.iter().map(|p| p.elevation >= mask);
            if above.clone().filter(|above| *above).count() > 4 {
                set.retain(|_| above.next() == Some(true));
            }
        }
        let point = adjustment.solve(set.clone(), start, spent)?;
        let (above, below): (Vec<_>, Vec<_>) = std::iter::zip(&set, &point.view.predictions)
            .partition(|(_, predicted)| predicted.elevation >= mask);
        if below.is_empty() {
            return Ok(point);
        }
        if above.len() < 4 {
            let dropped = below.iter().map(|(sighting, predicted)| Dropped {
                sv: sighting.observation.sv(),
                reason: DropReason::BelowMask(predicted.elevation),
            });
            return Err(PositioningError::TooFewSatellites {
                usable: above.len(),
                needed: 4,
                dropped: dropped.collect(),
            });
        }
        let above = above.into_iter().map(|(sighting, _)| *sighting).collect();
        adjustment.solve(above, point.state, point.iterations)
    }
}

#[cfg(test)]
mod tests;
