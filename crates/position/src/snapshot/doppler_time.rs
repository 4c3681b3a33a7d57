//! Dopplers alone with time as the fifth unknown: every place that explains them within a cell of time.
//!
//! Unknowns: position `r` (ECEF, m), GPS time minus that of the cell's centre `tau` (s), c times the drift of
//! the receiver's clock `d` (m/s). Rows: `-lambda D = rate(r, t) + d` per satellite and a
//! soft height on a sphere. Damped Gauss-Newton from many starts, with `tau` bounded to the cell, on
//! geometry without light time and atmosphere: right to 0.1 Hz, good enough to say where the full model
//! ([`super::coarse_time`]) is to start.
//!
//! Decisions:
//! - Dopplers count with at least [`SOFT_HZ`]: the cost of a precise Doppler is a narrow valley in which
//!   every step is short, and height would no longer hold the iterate near the ground.
//! - A step is halved until the cost falls, never longer than [`LONGEST_M`], and its end is brought back to
//!   within [`SHELL_M`] of the sphere.
//! - A minimum at the edge of the cell is none: the neighbouring cell has it, or the window ends there.

use crate::epoch::sighting::Sighting;
use crate::fix::{FailedStart, FailedStartCause, FixStart};
use crate::gauss_newton::{Damping, Model, Step, Stopped, Test, Verdict, Why, gauss_newton};
use crate::least_squares::{LeastSquares, LinearRow};
use crate::options::PositioningOptions;
use crate::place::Place;
use crate::point::Point;
use crate::point::Terms;
use crate::problem::{Row, RowKind, Satellite};
use crate::solver::failure::Failure;
use nalgebra::{Vector3, Vector4};
use sdr_rx_gnss::GpsTime;
use sdr_rx_gnss::constants::{EARTH_RADIUS, MU_EARTH, OMEGA_EARTH, SPEED_OF_LIGHT};
use sdr_rx_gnss::signal::L1_WAVELENGTH;

/// Time of flight of a signal, s, for the start.
pub(super) const FLIGHT_S: f64 = 0.075;
/// Least standard deviation of a Doppler here, Hz.
const SOFT_HZ: f64 = 5.0;
/// Deviation of the radius, m: 12 km of flattening to either side, mountains and a margin.
const RADIUS_SIGMA_M: f64 = 15e3;
/// Longest step, m, and how far from the sphere it may end.
const LONGEST_M: f64 = 3e6;
const SHELL_M: f64 = 50e3;
const MOST_ITERATIONS: usize = 30;
/// Smallest part of a step that is tried: eight halvings.
const LEAST: f64 = 1.0 / 256.0;
/// Converged when a step is shorter than this, m, or gains less than this part of a squared deviation.
const SHORT_M: f64 = 20.0;
const LITTLE: f64 = 1e-4;
/// Minima nearer than this are one.
const SAME_M: f64 = 5e3;
const SAME_S: f64 = 10.0;

/// A place and time that explain the Dopplers.
#[derive(Clone, Debug)]
pub(super) struct Minimum {
    /// Position (ECEF, m), time against the cell's centre (s).
    pub place_time: Vector4<f64>,
    /// c x drift, m/s.
    pub drift_mps: f64,
    /// Linearisations from the start of the search.
    pub iterations: usize,
    /// Where the search started.
    pub start: FixStart,
}

/// All minima with a cost of at most `limit` within `half_s` of `time`, by the Dopplers of `set`, from where the
/// solver leads and from the seeds.
pub(super) fn minima(
    set: &[Sighting],
    time: GpsTime,
    half_s: f64,
    limit: f64,
    options: &PositioningOptions,
) -> Vec<Minimum> {
    let cell = Cell { set, time, half_s };
    let mut found: Vec<Minimum> = Vec::new();
    for (place, start) in starts(&rows(set, time), options) {
        let Some((minimum, cost)) = cell.descend(place, start) else { continue };
        let known = found.iter().any(|f| {
            let apart = f.place_time - minimum.place_time;
            apart.xyz().norm() < SAME_M && apart.w.abs() < SAME_S
        });
        if cost <= limit && !known {
            found.push(minimum);
        }
    }
    found
}

/// The Dopplers as range rates of the satellites as they are at `time`, but for their clocks.
pub(super) fn rows(set: &[Sighting], time: GpsTime) -> Vec<Row> {
    let row = |s: &Sighting| {
        let state = s.orbit.state(time - FLIGHT_S);
        let satellite =
            Satellite { position_m: state.position_m, velocity_mps: state.velocity_mps };
        let rate = s.range_rate()?.0 + SPEED_OF_LIGHT * state.clock_drift_sps;
        Some(Row::range_rate(satellite, rate))
    };
    set.iter().filter_map(row).collect()
}

/// Places and drifts to start from, and how they came about: where the solver leads from the Earth's centre, then the
/// seeds. Noise can put the optimum outside the altitude wall: the place at the wall is a good start.
pub(super) fn starts(
    rows: &[Row],
    &PositioningOptions { solver, takes_over, .. }: &PositioningOptions,
) -> Vec<(Vector4<f64>, FixStart)> {
    let from_place = |place: &Place| place.position_m.push(place.clock());
    let (place, iterations, cause) = match solver.solve(rows, |_| ()) {
        Ok(s) => (Some(from_place(&s.state)), s.iterations, FailedStartCause::Unexplained),
        Err(Failure::Jammed { state, iterations, .. } | Failure::TooSlow { state, iterations }) => {
            (Some(from_place(&state)), iterations, FailedStartCause::Unexplained)
        }
        Err(cause) => (None, cause.iterations(), FailedStartCause::NoPlace(cause)),
    };
    let asked = FixStart { solver: solver.name(), iterations, failed: None };
    let failed = Some(FailedStart { solver: solver.name(), cause });
    let seeded = FixStart { solver: FixStart::SEEDS, iterations, failed };
    let seeds = seeds(rows).filter(|_| takes_over).map(|seed| (seed, seeded.clone()));
    place.map(|place| (place, asked)).into_iter().chain(seeds).collect()
}

/// Starts for the Dopplers when the Earth's centre leads nowhere: below the satellites' centroid, and
/// around it at 0.2 and 0.6 rad.
fn seeds(rows: &[Row]) -> impl Iterator<Item = Vector4<f64>> + use<> {
    let centre: Vector3<f64> = rows.iter().map(|row| row.satellite.position_m.normalize()).sum();
    let centre = centre.try_normalize(1e-9).unwrap_or(Vector3::x());
    let side = centre.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or(Vector3::x());
    let other = centre.cross(&side);
    let around = [0.2f64, 0.6].into_iter().flat_map(move |angle| {
        (0..6).map(move |k| {
            let (s, c) = (f64::from(k) * std::f64::consts::FRAC_PI_3).sin_cos();
            centre * angle.cos() + (side * c + other * s) * angle.sin()
        })
    });
    std::iter::once(centre).chain(around).map(|direction| direction.push(0.0))
}

/// A cell of time and what was seen in it.
struct Cell<'a, 's> {
    set: &'a [Sighting<'s>],
    time: GpsTime,
    half_s: f64,
}

impl Cell<'_, '_> {
    /// From a start (any point in the direction of the place, and drift) to a minimum inside the cell, and its
    /// cost.
    fn descend(&self, from: Vector4<f64>, start: FixStart) -> Option<(Minimum, f64)> {
        let place = from.xyz().try_normalize(1e-9)? * EARTH_RADIUS;
        let from = Point { x: place.push(0.0), clocks: Terms::from_elem(from.w, 1) };
        let damping = Damping {
            test: Test::Descent { tau: 0.0, floor: 0.0 },
            least: LEAST,
            ..Damping::plain(MOST_ITERATIONS)
        };
        let (point, cost, iterations) = match gauss_newton(self, from, &damping, |_| ()) {
            Ok(found) => (found.point, found.cost, found.iterations),
            // Nothing more is to be gained.
            Err(Stopped { point, cost, iterations, why: Why::Jammed { .. } }) => {
                (point, cost, iterations)
            }
            Err(_) => return None,
        };
        let iterations = start.iterations + iterations;
        let drift_mps = point.clocks[0];
        let minimum = Minimum { place_time: point.x, drift_mps, iterations, start };
        (point.x.w.abs() < self.half_s).then_some((minimum, cost))
    }
}

impl Model<4, 5> for Cell<'_, '_> {
    type View = ();

    fn look(&self, at: &Point<4>, (): &mut (), system: &mut LeastSquares<4, 5>) {
        let place = at.x.xyz();
        let omega = Vector3::new(0.0, 0.0, OMEGA_EARTH);
        let rows = self.set.iter().filter_map(|sighting| {
            let (observed, sigma) = sighting.range_rate()?;
            let state = sighting.orbit.state(self.time + (at.x.w - FLIGHT_S));
            let (s, v) = (state.position_m, state.velocity_mps);
            let satellite = Satellite { position_m: s, velocity_mps: v };
            let seen = RowKind::RangeRate.see(&satellite, &place);
            let gradient = RowKind::RangeRate.gradient(&satellite, &seen);
            // Two-body gravity with the Coriolis and centrifugal terms of the rotating frame.
            let gravity = -MU_EARTH / s.norm().powi(3) * s;
            let acceleration = gravity - omega.cross(&(2.0 * v + omega.cross(&s)));
            let curvature = seen.acceleration(&acceleration, &v);
            let residual =
                observed + SPEED_OF_LIGHT * state.clock_drift_sps - seen.value - at.clocks[0];
            let row = [gradient.x, gradient.y, gradient.z, curvature, residual];
            Some(LinearRow::new(row, sigma.max(SOFT_HZ * L1_WAVELENGTH), Some(0)))
        });
        let (radius, up) = (place.norm(), place.normalize());
        let height = [up.x, up.y, up.z, 0.0, EARTH_RADIUS - radius];
        system.set(rows.chain([LinearRow::new(height, RADIUS_SIGMA_M, None)]));
    }

    fn shorten(&self, step: &mut Point<4>) {
        let factor = (LONGEST_M / step.x.xyz().norm()).min(1.0);
        step.x *= factor;
        step.clocks.iter_mut().for_each(|c| *c *= factor);
    }

    /// Within the cell, and near the sphere.
    fn admit(&self, next: &mut Point<4>) -> bool {
        let place = next.x.xyz();
        let radius = place.norm();
        let allowed = radius.clamp(EARTH_RADIUS - SHELL_M, EARTH_RADIUS + SHELL_M);
        next.x = (place * (allowed / radius)).push(next.x.w.clamp(-self.half_s, self.half_s));
        true
    }

    fn verdict(&self, step: &Step<4>, _: &LeastSquares<4, 5>) -> Verdict {
        let gain = step.cost_before - step.cost_after.unwrap_or(step.cost_before);
        let short = (step.to.x - step.from.x).xyz().norm() < SHORT_M;
        if short || gain < LITTLE { Verdict::Converged } else { Verdict::Continue }
    }
}
