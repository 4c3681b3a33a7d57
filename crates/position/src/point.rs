//! The position of one epoch whose time is known, with the receiver's full model.
//!
//! A bare solver from the Earth's centre on satellite positions ([`super::cold_start`]), then Gauss-Newton,
//! weighted, on [`Sight`](super::sight::Sight): light time, Earth rotation, satellite clock, relativity,
//! T_GD, Klobuchar and Saastamoinen ([`super::adjustment`]). A chi-square test of the residuals (1e-5 of
//! false alarm) guards the result; a satellite without which it passes is excluded if one more than there
//! are unknowns is left.

use super::adjustment::{Adjusted, Adjustment, BIAS, DRIFT, Unknowns, position};
use super::cold_start::{ColdStart, cold_start};
use super::error::{DropReason, Dropped, PositioningError};
use super::options::{Exclusion, Observable, SolveOptions};
use super::selection::select_by;
use super::sight::Sighting;
use super::solver::Solver;
use super::solver::outcome::Step;
use super::velocity::motion;
use super::{Fix, FixMethod, PositioningOptions, Residual};
use nalgebra::{Matrix4, Vector3};
use sdr_rx_gnss::constants::{L1_WAVELENGTH, SPEED_OF_LIGHT};
use sdr_rx_gnss::observation::{CodeRange, Observation, ObservationEpoch};
use sdr_rx_gnss::{NavigationData, Sv};

/// Position, velocity, clock and what a person needs to trust them, from the full pseudoranges (and
/// Dopplers, where they are numbers) of one epoch, from the Earth's centre.
///
/// # Errors
/// [`PositioningError`] names the cause: too few usable satellites, stale ephemerides, divergence,
/// degenerate geometry, an implausible place, or contradicting satellites too few to tell which.
pub fn solve_epoch(
    epoch: &ObservationEpoch,
    nav: &NavigationData,
    options: &PositioningOptions,
) -> Result<Fix, PositioningError> {
    let options = SolveOptions { positioning: *options, ..SolveOptions::default() };
    solve_observed(epoch, nav, &options, &mut |_| ())
}

/// The position of one epoch by pseudoranges, Dopplers or both, as the options say. `trace` sees each
/// accepted step of the solver that comes from the Earth's centre, of every set of satellites that is tried.
///
/// From Dopplers alone the time of reception is taken as the receiver's clock has it (a millisecond of error
/// is 4 m of the satellites), and the receiver is taken to rest: 1 m/s moves the result by 6 km.
///
/// # Errors
/// As [`solve_epoch`].
pub fn solve_observed(
    epoch: &ObservationEpoch,
    nav: &NavigationData,
    options: &SolveOptions,
    trace: &mut dyn FnMut(&Step),
) -> Result<Fix, PositioningError> {
    let sightings = sightings(epoch, nav, options.observable)?;
    let adjustment = Adjustment { receive_time: epoch.receive_time, nav, options };
    let mut solver =
        PointSolver { adjustment, trace, solver: options.solver, alternatives: Vec::new() };
    let (point, excluded) = solver.solve_with_exclusion(sightings)?;
    let alternatives = solver.other_places(&point);
    let solver = solver.solver.name();
    Ok(Fix { solver, alternatives_m: alternatives, ..fix(&point, epoch.sample, excluded, options) })
}

/// The observations of an epoch that the observable needs and that have an orbit.
pub(super) fn sightings<'a>(
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
    select_by(epoch, sighting, 4)
}

/// The fix that an adjustment amounts to.
fn fix(point: &Adjusted, sample: f64, mut excluded: Vec<Sv>, options: &SolveOptions) -> Fix {
    // What Dopplers are compared with: the motion they give where they gave no position.
    let at_rest = options.observable != Observable::Pseudorange;
    let motion = if at_rest { None } else { motion(&point.used, &point.sights) };
    let moving = motion.map(|m| (m.velocity_mps, m.drift_mps));
    let moving = moving.or(at_rest.then_some((Vector3::zeros(), point.state[DRIFT])));
    let residual = |k: usize| {
        let (sighting, sight) = (&point.used[k], &point.sights[k]);
        let code = point.rows.iter().find(|r| r.satellite == k && r.clock == BIAS);
        Residual {
            sv: sighting.observation.sv,
            range_m: code.map(|row| row.residual),
            doppler_hz: sighting.observation.doppler_hz.zip(moving).map(
                |(observed, (v, drift))| observed + sight.range_rate(&v, drift) / L1_WAVELENGTH,
            ),
            azimuth: sight.azimuth,
            elevation: sight.elevation,
        }
    };
    // A robust law that gives a satellite no weight has excluded it.
    let weightless = |k: &usize| {
        let mut weights = point.rows.iter().zip(&point.weights).filter(|(r, _)| r.satellite == *k);
        weights.all(|(_, &weight)| weight == 0.0)
    };
    let (rejected, used): (Vec<_>, Vec<_>) = (0..point.used.len()).partition(weightless);
    excluded.extend(rejected.iter().map(|&k| point.used[k].observation.sv));
    excluded.sort();
    let covariance: Matrix4<f64> = point.covariance.fixed_view::<4, 4>(0, 0).into_owned();
    let mut covariance = point.geometry.local(&covariance);
    let mut clock_bias_s = Some(point.state[BIAS] / SPEED_OF_LIGHT);
    if options.observable == Observable::Doppler {
        clock_bias_s = None;
        covariance.row_mut(BIAS).fill(f64::NAN);
        covariance.column_mut(BIAS).fill(f64::NAN);
    }
    Fix {
        time: point.time,
        sample,
        position_m: position(&point.state),
        velocity_mps: motion.map(|m| m.velocity_mps),
        clock_bias_s,
        clock_drift_sps: moving.map(|(_, drift)| drift / SPEED_OF_LIGHT),
        covariance,
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
struct PointSolver<'a, 't> {
    adjustment: Adjustment<'a>,
    trace: &'t mut dyn FnMut(&Step),
    /// The bare solver that led to the last set's solution, and the other places that fitted it.
    solver: Solver,
    alternatives: Vec<Unknowns>,
}

impl<'a> PointSolver<'a, '_> {
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
                Some((k, _)) => excluded.push(set.remove(k).observation.sv),
                None => return Err(error.clone()),
            }
        }
    }

    /// Other places near the ground that explain the satellites of a solution as well.
    fn other_places(&self, point: &Adjusted<'a>) -> Vec<Vector3<f64>> {
        let refined = |start: &Unknowns| {
            match self.adjustment.solve(point.used.clone(), *start, 0) {
                Ok(other) => (other.contradiction() <= 1.0).then(|| position(&other.state)),
                // Too weak a geometry for a fix of its own: still a place that fits.
                Err(_) => Some(position(start)),
            }
        };
        let distinct = |place: &Vector3<f64>| (place - position(&point.state)).norm() > DISTINCT_M;
        self.alternatives.iter().filter_map(refined).filter(distinct).collect()
    }

    /// From the Earth's centre to the full model, above the elevation mask.
    fn solve_set(&mut self, set: &[Sighting<'a>]) -> Result<Adjusted<'a>, PositioningError> {
        let adjustment = self.adjustment;
        let ColdStart { state: start, iterations: spent, solver, alternatives } =
            cold_start(&adjustment, set, self.trace)?;
        (self.solver, self.alternatives) = (solver, alternatives);
        let mask = adjustment.options.positioning.elevation_mask;
        let mut set = set.to_vec();
        if adjustment.options.observable != Observable::Pseudorange {
            // At the horizon the atmosphere's delay changes too fast for the rate to be linearised.
            let sights = adjustment.sights(&set, &start);
            let mut above = sights.iter().map(|sight| sight.elevation >= mask);
            if above.clone().filter(|above| *above).count() > 4 {
                set.retain(|_| above.next() == Some(true));
            }
        }
        let point = adjustment.solve(set.clone(), start, spent)?;
        let (above, below): (Vec<_>, Vec<_>) =
            std::iter::zip(&set, &point.sights).partition(|(_, sight)| sight.elevation >= mask);
        if below.is_empty() {
            return Ok(point);
        }
        if above.len() < 4 {
            let dropped = below.iter().map(|(sighting, sight)| Dropped {
                sv: sighting.observation.sv,
                reason: DropReason::BelowMask(sight.elevation),
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
