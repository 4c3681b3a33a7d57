//! The position from full pseudoranges, with the receiver's full model.
//!
//! AW-DGN-BT from the Earth's centre on satellite positions at the times of transmission
//! `t_r - P/c - dt_s` (which no error of the receiver's clock touches), then Gauss-Newton, weighted,
//! on [`Sight`]: light time, Earth rotation, satellite clock, relativity, T_GD, Klobuchar and
//! Saastamoinen, at the time of reception corrected by the clock bias of the iteration before. A
//! chi-square test of the residuals (1e-5 of false alarm) guards the result; a satellite without
//! which it passes is excluded if five or more are left.

use super::aw_dgn_bt::{Divergence, Pseudorange, Satellite, aw_dgn_bt};
use super::error::{DropReason, Dropped, PositioningError};
use super::least_squares::LeastSquares;
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
                let clock_s = s.ephemeris.state(sent).clock_bias_s;
                let state = s.ephemeris.state(sent - clock_s);
                let satellite =
                    Satellite { position_m: state.position_m, velocity_mps: state.velocity_mps };
                (satellite, s.range_m + SPEED_OF_LIGHT * state.clock_bias_s)
            })
            .unzip();
        aw_dgn_bt::<Pseudorange>(&satellites, &ranges)
            .map(|c| Start { state: c.position_m.push(c.clock), iterations: c.iterations })
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
                .map(|s| Sight::new(s.ephemeris, &position_m, time, self.nav, self.options))
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
                let cause = Divergence::Singular { state, iterations };
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
        let cause = Divergence::TooSlow { state, iterations: start.iterations + MAX_REFINEMENTS };
        Err(PositioningError::Diverged { satellites: used.len(), cause })
    }
}

/// Where Gauss-Newton starts: position and clock bias, m, and the iterations spent so far.
struct Start {
    state: Vector4<f64>,
    iterations: usize,
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{Truth, navigation_data};
    use super::*;
    use crate::gnss::Ephemeris;
    use crate::gnss::atmosphere::Troposphere;
    use nalgebra::Matrix3;

    const MASK: f64 = 0.1;

    fn shift(epoch: &mut ObservationEpoch, index: usize, error_m: f64) -> Sv {
        let observation = &mut epoch.observations[index];
        if let CodeRange::Pseudorange(range_m) = &mut observation.range {
            *range_m += error_m;
        }
        observation.sv
    }

    fn keep(epoch: &mut ObservationEpoch, count: usize) {
        epoch.observations.truncate(count);
    }

    #[test]
    fn exact_observations_give_position_velocity_and_clock_back() {
        let nav = navigation_data();
        let rest = Truth::at_rest();
        let moving = Truth {
            velocity_mps: Vector3::new(150.0, -80.0, 120.0),
            bias_s: 0.037,
            drift_sps: 6e-6,
            ..rest
        };
        let behind = Truth { bias_s: -2.5, drift_sps: -1e-6, ..rest };
        for troposphere in [Troposphere::None, Troposphere::Saastamoinen] {
            let options = PositioningOptions { troposphere, ..Default::default() };
            for truth in [rest, moving, behind] {
                let epoch = truth.observe(&nav, &options, MASK);
                assert!(epoch.observations.len() >= 6);
                let fix = solve_epoch(&epoch, &nav, &options).unwrap();
                // The last step was below 1e-4 m; GpsTime and f64 ranges resolve 1e-8 m.
                assert!((fix.position_m - truth.position_m).norm() < 1e-4);
                assert!((fix.clock_bias_s - truth.bias_s).abs() * SPEED_OF_LIGHT < 1e-4);
                assert!((fix.time - truth.time).abs() * SPEED_OF_LIGHT < 1e-4);
                // Third derivative of the range times 0.5^2/6: below 1e-5 m/s.
                assert!((fix.velocity_mps.unwrap() - truth.velocity_mps).norm() < 1e-4);
                let drift_error = fix.clock_drift_sps.unwrap() - truth.drift_sps;
                assert!(drift_error.abs() * SPEED_OF_LIGHT < 1e-4);
                assert!(fix.excluded.is_empty() && fix.residuals.len() == epoch.observations.len());
                assert!((7..=16).contains(&fix.iterations), "{}", fix.iterations);
                assert!(fix.pdop > 1.0 && fix.pdop.hypot(0.0) >= fix.hdop.max(fix.vdop));
            }
        }
    }

    #[test]
    fn covariance_is_that_of_a_monte_carlo() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let (nav, truth, options) =
            (navigation_data(), Truth::at_rest(), PositioningOptions::default());
        let exact = truth.observe(&nav, &options, MASK);
        let sigmas: Vec<f64> = exact
            .observations
            .iter()
            .map(|o| {
                let ephemeris = nav.nearest(o.sv, truth.time).unwrap();
                let sight = Sight::new(ephemeris, &truth.position_m, truth.time, &nav, &options);
                o.range_sigma_m.hypot(sight.range_sigma_m)
            })
            .collect();
        let enu = crate::gnss::coordinates::Geodetic::from_ecef(&truth.position_m).ecef_to_enu();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let (mut sum, mut predicted) = (Matrix3::zeros(), Matrix3::zeros());
        const RUNS: usize = 2000;
        for _ in 0..RUNS {
            let mut epoch = exact.clone();
            for (index, sigma) in sigmas.iter().enumerate() {
                let noise: f64 = StandardNormal.sample(&mut rng);
                shift(&mut epoch, index, noise * sigma);
            }
            let fix = solve_epoch(&epoch, &nav, &options).unwrap();
            let error = enu * (fix.position_m - truth.position_m);
            sum += error * error.transpose() / RUNS as f64;
            predicted = fix.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        }
        // A sample variance of 2000 runs has a relative deviation of sqrt(2/2000) = 3 %.
        for axis in 0..3 {
            let ratio = sum[(axis, axis)] / predicted[(axis, axis)];
            assert!((ratio - 1.0).abs() < 0.13, "axis {axis}: {ratio}");
        }
    }

    #[test]
    fn a_faulty_satellite_is_excluded_with_six_and_refused_with_five() {
        let (nav, truth, options) =
            (navigation_data(), Truth::at_rest(), PositioningOptions::default());
        let exact = truth.observe(&nav, &options, MASK);
        for error_m in [300.0, -2e3, 3e4, 3e5] {
            for index in 0..6 {
                let mut epoch = exact.clone();
                let faulty = shift(&mut epoch, index, error_m);
                let fix = solve_epoch(&epoch, &nav, &options).unwrap();
                assert_eq!(fix.excluded, [faulty], "{error_m}");
                assert!((fix.position_m - truth.position_m).norm() < 1e-4);
            }
            let mut five = exact.clone();
            keep(&mut five, 5);
            shift(&mut five, 2, error_m);
            assert!(solve_epoch(&five, &nav, &options).is_err(), "{error_m}");
        }
    }

    #[test]
    fn a_faulty_doppler_does_not_touch_the_velocity() {
        let (nav, truth, options) =
            (navigation_data(), Truth::at_rest(), PositioningOptions::default());
        let mut epoch = truth.observe(&nav, &options, MASK);
        epoch.observations[3].doppler_hz += 25.0;
        let fix = solve_epoch(&epoch, &nav, &options).unwrap();
        assert!(fix.velocity_mps.unwrap().norm() < 1e-4);
        assert!((fix.residuals[3].doppler_hz - 25.0).abs() < 1e-3);
    }

    #[test]
    fn errors_name_the_cause() {
        let (nav, truth, options) =
            (navigation_data(), Truth::at_rest(), PositioningOptions::default());
        let epoch = truth.observe(&nav, &options, MASK);
        let fails = |epoch: &ObservationEpoch, nav: &NavigationData, words: &str| {
            let message = solve_epoch(epoch, nav, &options).unwrap_err().to_string();
            assert!(message.contains(words), "'{message}' does not say '{words}'");
        };
        let mut few = epoch.clone();
        keep(&mut few, 3);
        fails(&few, &nav, "3 usable satellites, a position needs 4");
        fails(&epoch, &NavigationData::default(), "no ephemeris");
        let late =
            ObservationEpoch { receive_time: epoch.receive_time + 86_400.0, ..epoch.clone() };
        fails(&late, &nav, "24.2 hours from the given time");
        let mut broken = epoch.clone();
        keep(&mut broken, 4);
        broken.observations[1].range = CodeRange::Pseudorange(f64::NAN);
        fails(&broken, &nav, "its measurement is not a number");
        let mut ill = NavigationData::default();
        nav.iter().for_each(|e| ill.insert(Ephemeris { health: 63, ..e.clone() }));
        fails(&epoch, &ill, "unhealthy");
        let mut snapshot = epoch.clone();
        snapshot.observations.iter_mut().for_each(|o| o.range = CodeRange::ModuloCodePeriod(1.0));
        fails(&snapshot, &nav, "wrong kind");
        let high = PositioningOptions { elevation_mask: 1.2, ..options };
        let error = solve_epoch(&epoch, &nav, &high).unwrap_err().to_string();
        assert!(error.contains("below the mask"), "{error}");
        // Seen under one line of sight: copies of one satellite under other names.
        let mut clones = NavigationData::default();
        let first = nav.nearest(epoch.observations[0].sv, truth.time).unwrap();
        for observation in &epoch.observations {
            clones.insert(Ephemeris { sv: observation.sv, ..first.clone() });
        }
        fails(&truth.observe(&clones, &options, MASK), &clones, "singular");
    }
}
