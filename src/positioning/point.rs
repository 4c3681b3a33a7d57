//! The position from full pseudoranges, with the receiver's full model.
//!
//! AW-DGN-BT from the Earth's centre on satellite positions at the times of transmission
//! `t_r - P/c - dt_s` (which no error of the receiver's clock touches), then Gauss-Newton, weighted,
//! on [`Sight`]: light time, Earth rotation, satellite clock, relativity, T_GD, Klobuchar and
//! Saastamoinen, at the time of reception corrected by the clock bias of the iteration before. A
//! chi-square test of the residuals (1e-5 of false alarm) guards the result; a satellite without
//! which it passes is excluded if five or more are left.

use super::aw_dgn_bt::aw_dgn_bt;
use super::error::{DropReason, Dropped, PositioningError};
use super::least_squares::LeastSquares;
use super::model::{Pseudorange, Satellite};
use super::outcome::{Failure, State};
use super::selection::select;
use super::sight::{Sight, Sighting};
use super::solution::{Geometry, MAX_RADIUS, MIN_RADIUS};
use super::statistics::chi_square_limit;
use super::velocity::motion;
use super::{Fix, FixMethod, PositioningOptions, Residual};
use crate::gnss::constants::{L1_WAVELENGTH, SPEED_OF_LIGHT};
use crate::gnss::{GpsTime, NavigationData, Sv};
use crate::observables::{CodeRange, ObservationEpoch};
use nalgebra::{Matrix4, Vector3, Vector4};

/// Unknowns: position and clock.
const UNKNOWNS: usize = 4;
/// Gauss-Newton is quadratic near the ground: from AW-DGN-BT's 100 m it takes 3 or 4 steps.
const MAX_REFINEMENTS: usize = 10;
/// Refined until the step is shorter than this, m.
const REFINED_M: f64 = 1e-4;

/// Position, velocity, clock and what a person needs to trust them, from the full pseudoranges (and
/// Dopplers, where they are numbers) of one epoch.
///
/// # Errors
/// [`PositioningError`] names the cause: too few usable satellites, stale ephemerides, divergence,
/// degenerate geometry, an implausible place, or contradicting satellites too few to tell which.
pub fn solve_epoch(
    epoch: &ObservationEpoch,
    nav: &NavigationData,
    options: &PositioningOptions,
) -> Result<Fix, PositioningError> {
    let full = |range| match range {
        CodeRange::Pseudorange(range_m) => Some(range_m),
        CodeRange::ModuloCodePeriod(_) => None,
    };
    let sightings = select(epoch, nav, full, UNKNOWNS)?;
    let solver = PointSolver { receive_time: epoch.receive_time, nav, options };
    let (point, excluded) = solver.solve_with_exclusion(sightings)?;
    let motion = motion(&point.used, &point.sights);
    let residuals = point.used.iter().zip(&point.sights).zip(&point.residuals_m);
    let residuals = residuals
        .map(|((sighting, sight), &range_m)| Residual {
            sv: sighting.observation.sv,
            range_m,
            doppler_hz: motion.as_ref().map_or(f64::NAN, |m| {
                sighting.observation.doppler_hz
                    + sight.range_rate(&m.velocity_mps, m.drift_mps) / L1_WAVELENGTH
            }),
            azimuth: sight.azimuth,
            elevation: sight.elevation,
        })
        .collect();
    Ok(Fix {
        time: point.time,
        sample: epoch.sample,
        position_m: point.position_m,
        velocity_mps: motion.as_ref().map(|m| m.velocity_mps),
        clock_bias_s: point.bias_m / SPEED_OF_LIGHT,
        clock_drift_sps: motion.as_ref().map(|m| m.drift_mps / SPEED_OF_LIGHT),
        covariance: point.geometry.local(&point.covariance),
        pdop: point.geometry.pdop,
        hdop: point.geometry.hdop,
        vdop: point.geometry.vdop,
        residuals,
        excluded,
        method: FixMethod::Tracking,
        solver: "aw-dgn-bt",
        iterations: point.iterations,
    })
}

/// A position and clock bias, both in m.
fn place(state: &Vector4<f64>) -> State {
    State { position_m: state.xyz(), bias_m: Some(state.w), drift_mps: None }
}

struct PointSolver<'a> {
    receive_time: GpsTime,
    nav: &'a NavigationData,
    options: &'a PositioningOptions,
}

/// A converged solution and what it was made of.
struct Point<'a> {
    used: Vec<Sighting<'a>>,
    sights: Vec<Sight>,
    residuals_m: Vec<f64>,
    position_m: Vector3<f64>,
    bias_m: f64,
    time: GpsTime,
    /// Of position and clock bias, ECEF, m^2.
    covariance: Matrix4<f64>,
    geometry: Geometry,
    /// Weighted sum of squared residuals.
    cost: f64,
    iterations: usize,
}

impl Point<'_> {
    /// Weighted sum of squared residuals over its limit; above 1 the satellites contradict each other.
    fn contradiction(&self) -> f64 {
        match self.used.len().saturating_sub(UNKNOWNS) {
            0 => 0.0,
            redundancy => self.cost / chi_square_limit(redundancy),
        }
    }

    fn inconsistent(&self) -> PositioningError {
        let weighted =
            |k: usize| self.residuals_m[k].abs() / range_sigma(&self.used[k], &self.sights[k]);
        let worst = (0..self.used.len()).max_by(|&a, &b| weighted(a).total_cmp(&weighted(b)));
        PositioningError::Inconsistent {
            satellites: self.used.len(),
            cost: self.cost,
            threshold: chi_square_limit(self.used.len() - UNKNOWNS),
            suspect: worst.map(|k| self.used[k].observation.sv),
        }
    }
}

/// Standard deviation of observed minus computed range, m.
fn range_sigma(sighting: &Sighting, sight: &Sight) -> f64 {
    sighting.observation.range_sigma_m.hypot(sight.range_sigma_m)
}

impl<'a> PointSolver<'a> {
    /// Solves, and leaves out satellites one at a time, best first, until the residuals are
    /// consistent: at most half of the redundant ones, and never below five.
    fn solve_with_exclusion(
        &self,
        mut set: Vec<Sighting<'a>>,
    ) -> Result<(Point<'a>, Vec<Sv>), PositioningError> {
        let limit = (set.len() - UNKNOWNS) / 2;
        let mut excluded = Vec::new();
        let mut first_error = None;
        loop {
            let error = match self.solve_set(&set) {
                Ok(point) if point.contradiction() <= 1.0 => {
                    excluded.sort();
                    return Ok((point, excluded));
                }
                Ok(point) => point.inconsistent(),
                Err(error) => error,
            };
            let error = first_error.get_or_insert(error);
            let best = (0..set.len())
                .filter(|_| set.len() >= 6 && excluded.len() < limit)
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

    /// From the Earth's centre to the full model, above the elevation mask.
    fn solve_set(&self, set: &[Sighting<'a>]) -> Result<Point<'a>, PositioningError> {
        let start = self.cold_start(set)?;
        let point = self.refine(set.to_vec(), start)?;
        let (above, below): (Vec<_>, Vec<_>) = std::iter::zip(set, &point.sights)
            .partition(|(_, sight)| sight.elevation >= self.options.elevation_mask);
        if below.is_empty() {
            return Ok(point);
        }
        if above.len() < UNKNOWNS {
            let dropped = below.iter().map(|(sighting, sight)| Dropped {
                sv: sighting.observation.sv,
                reason: DropReason::BelowMask(sight.elevation),
            });
            return Err(PositioningError::TooFewSatellites {
                usable: above.len(),
                needed: UNKNOWNS,
                dropped: dropped.collect(),
            });
        }
        let above = above.into_iter().map(|(sighting, _)| *sighting).collect();
        let state = point.position_m.push(point.bias_m);
        self.refine(above, Start { state, iterations: point.iterations })
    }

    fn cold_start(&self, set: &[Sighting]) -> Result<Start, PositioningError> {
        let (satellites, ranges): (Vec<Satellite>, Vec<f64>) = set
            .iter()
            .map(|s| {
                let sent = self.receive_time - s.range_m / SPEED_OF_LIGHT;
                let clock_s = s.orbit.state(sent).clock_bias_s;
                let state = s.orbit.state(sent - clock_s);
                let satellite =
                    Satellite { position_m: state.position_m, velocity_mps: state.velocity_mps };
                (satellite, s.range_m + SPEED_OF_LIGHT * state.clock_bias_s)
            })
            .unzip();
        aw_dgn_bt::<Pseudorange>(&satellites, &ranges)
            .map(|c| Start {
                state: c.state.position_m.push(c.state.clock()),
                iterations: c.iterations,
            })
            .map_err(|cause| PositioningError::Diverged { satellites: set.len(), cause })
    }

    fn refine(&self, used: Vec<Sighting<'a>>, start: Start) -> Result<Point<'a>, PositioningError> {
        let mut state = start.state;
        let (mut plain, mut weighted) =
            (LeastSquares::<4>::default(), LeastSquares::<4>::default());
        for refinement in 1..=MAX_REFINEMENTS {
            let iterations = start.iterations + refinement;
            let position_m = state.xyz();
            let time = self.receive_time - state.w / SPEED_OF_LIGHT;
            let sights: Vec<Sight> = used
                .iter()
                .map(|s| Sight::new(s.orbit, &position_m, time, self.nav, self.options))
                .collect();
            let mut cost = 0.0;
            let mut residuals_m = Vec::with_capacity(used.len());
            for (sighting, sight) in used.iter().zip(&sights) {
                let row = (-sight.direction).push(1.0);
                let residual = sighting.range_m - sight.range_m - state.w;
                let sigma = range_sigma(sighting, sight);
                plain.push(&row, residual);
                weighted.push(&(row / sigma), residual / sigma);
                cost += (residual / sigma).powi(2);
                residuals_m.push(residual);
            }
            let (Some(plain), Some(solution)) = (plain.solve(), weighted.solve()) else {
                let cause = Failure::Singular { state: place(&state), iterations };
                return Err(PositioningError::Diverged { satellites: used.len(), cause });
            };
            state += solution.x;
            let radius_m = state.xyz().norm();
            if !(MIN_RADIUS..MAX_RADIUS).contains(&radius_m) {
                return Err(PositioningError::ImplausibleRadius { radius_m });
            }
            if solution.x.norm() < REFINED_M {
                let geometry = Geometry::new(&state.xyz(), &plain.cofactor(), used.len())?;
                return Ok(Point {
                    used,
                    sights,
                    residuals_m,
                    position_m: state.xyz(),
                    bias_m: state.w,
                    time: self.receive_time - state.w / SPEED_OF_LIGHT,
                    covariance: solution.cofactor(),
                    geometry,
                    cost,
                    iterations,
                });
            }
        }
        let iterations = start.iterations + MAX_REFINEMENTS;
        let cause = Failure::TooSlow { state: place(&state), iterations };
        Err(PositioningError::Diverged { satellites: used.len(), cause })
    }
}

/// Where Gauss-Newton starts: position and clock bias, m, and the iterations spent so far.
struct Start {
    state: Vector4<f64>,
    iterations: usize,
}

#[cfg(test)]
mod tests;
