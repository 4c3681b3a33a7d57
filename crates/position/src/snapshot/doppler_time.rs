//! Dopplers alone with time as the fifth unknown: every place that explains them within a cell of time.
//!
//! Unknowns `x = (r, d, tau)`: position (ECEF, m), c times the drift of the receiver's clock (m/s) and
//! GPS time minus that of the cell's centre (s). Rows: `-lambda D = rate(r, t) + d` per satellite and a
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

use crate::least_squares::LeastSquares;
use crate::sight::Sighting;
use crate::solver::aw_dgn_bt::aw_dgn_bt;
use crate::solver::model::{Doppler, Satellite};
use crate::solver::outcome::{Failure, State};
use nalgebra::{SVector, Vector3, Vector4};
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
const MOST_HALVINGS: usize = 8;
/// Converged when a step is shorter than this, m, or gains less than this part of a squared deviation.
const SHORT_M: f64 = 20.0;
const LITTLE: f64 = 1e-4;
/// Minima nearer than this are one.
const SAME_M: f64 = 5e3;
const SAME_S: f64 = 10.0;

/// Position (ECEF, m), c x drift (m/s), time against the cell's centre (s).
pub(super) type DopplerState = SVector<f64, 5>;

/// A place and time that explain the Dopplers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Minimum {
    pub state: DopplerState,
    /// Linearisations from the start of the search.
    pub iterations: usize,
}

/// All minima with a cost of at most `limit` within `half_s` of `time`, by the Dopplers of `set`.
pub(super) fn minima(set: &[Sighting], time: GpsTime, half_s: f64, limit: f64) -> Vec<Minimum> {
    let (satellites, rates) = satellites(set, time);
    let mut found: Vec<Minimum> = Vec::new();
    let (starts, spent) = starts(&satellites, &rates);
    for start in starts {
        let Some((state, cost, iterations)) = descend(set, time, half_s, start) else { continue };
        let known = found.iter().any(|f| {
            let apart = f.state - state;
            apart.fixed_rows::<3>(0).norm() < SAME_M && apart[4].abs() < SAME_S
        });
        if cost <= limit && !known {
            found.push(Minimum { state, iterations: spent + iterations });
        }
    }
    found
}

/// The satellites that were seen with a Doppler, as they are at `time`, and the range rates but for their
/// clocks, m/s.
pub(super) fn satellites(set: &[Sighting], time: GpsTime) -> (Vec<Satellite>, Vec<f64>) {
    set.iter()
        .filter_map(|s| {
            let state = s.orbit.state(time - FLIGHT_S);
            let satellite =
                Satellite { position_m: state.position_m, velocity_mps: state.velocity_mps };
            Some((satellite, s.range_rate()?.0 + SPEED_OF_LIGHT * state.clock_drift_sps))
        })
        .unzip()
}

/// Where AW-DGN-BT comes from the Earth's centre, and its iterations. Noise can put the optimum outside
/// the wall: the place at the wall is a good start.
pub(super) fn from_the_centre(
    satellites: &[Satellite],
    rates: &[f64],
) -> Result<(Vector4<f64>, usize), Failure> {
    let start = |state: State| state.position_m.push(state.clock());
    match aw_dgn_bt::<Doppler>(satellites, rates) {
        Ok(c) => Ok((start(c.state), c.iterations)),
        Err(Failure::Jammed { state, iterations, .. } | Failure::TooSlow { state, iterations }) => {
            Ok((start(state), iterations))
        }
        Err(cause) => Err(cause),
    }
}

/// Starts at a fixed time: where the Earth's centre leads, then [`seeds`]; and the iterations spent.
fn starts(satellites: &[Satellite], rates: &[f64]) -> (Vec<Vector4<f64>>, usize) {
    let cold = from_the_centre(satellites, rates).ok();
    let spent = cold.map_or(0, |c| c.1);
    (cold.map(|c| c.0).into_iter().chain(seeds(satellites)).collect(), spent)
}

/// Starts for the Dopplers when the Earth's centre leads nowhere: below the satellites' centroid, and
/// around it at 0.2 and 0.6 rad.
pub(super) fn seeds(satellites: &[Satellite]) -> impl Iterator<Item = Vector4<f64>> + use<> {
    let centre: Vector3<f64> = satellites.iter().map(|s| s.position_m.normalize()).sum();
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

/// From a start (any point in the direction of the place, and drift) to a minimum inside the cell: state,
/// cost, linearisations.
fn descend(
    set: &[Sighting],
    time: GpsTime,
    half_s: f64,
    start: Vector4<f64>,
) -> Option<(DopplerState, f64, usize)> {
    let place = start.xyz().try_normalize(1e-9)? * EARTH_RADIUS;
    let mut state = DopplerState::zeros();
    state.fixed_rows_mut::<3>(0).copy_from(&place);
    state[3] = start.w;
    let mut system = LeastSquares::<5>::default();
    let mut cost = linearise(set, time, &state, &mut system);
    for iterations in 1..=MOST_ITERATIONS {
        let mut step = system.solve()?.x;
        step *= (LONGEST_M / step.fixed_rows::<3>(0).norm()).min(1.0);
        let before = cost;
        let mut halvings = 0;
        let next = loop {
            let next = bounded(state + step, half_s);
            system.clear();
            cost = linearise(set, time, &next, &mut system);
            if cost <= before {
                break next;
            }
            halvings += 1;
            if halvings > MOST_HALVINGS {
                cost = before;
                break state;
            }
            step /= 2.0;
        };
        let moved = (next - state).fixed_rows::<3>(0).norm();
        state = next;
        if moved < SHORT_M || before - cost < LITTLE {
            return (state[4].abs() < half_s).then_some((state, cost, iterations));
        }
    }
    None
}

/// The state within the cell, and near the sphere.
fn bounded(mut state: DopplerState, half_s: f64) -> DopplerState {
    state[4] = state[4].clamp(-half_s, half_s);
    let radius = state.fixed_rows::<3>(0).norm();
    let allowed = radius.clamp(EARTH_RADIUS - SHELL_M, EARTH_RADIUS + SHELL_M);
    let scaled = state.fixed_rows::<3>(0) * (allowed / radius);
    state.fixed_rows_mut::<3>(0).copy_from(&scaled);
    state
}

/// Pushes the weighted rows at `state`, and gives the weighted sum of squared residuals.
fn linearise(
    set: &[Sighting],
    time: GpsTime,
    state: &DopplerState,
    system: &mut LeastSquares<5>,
) -> f64 {
    let place = Vector3::new(state[0], state[1], state[2]);
    let omega = Vector3::new(0.0, 0.0, OMEGA_EARTH);
    let mut cost = 0.0;
    let mut push = |row: DopplerState, residual: f64, sigma: f64| {
        system.push(&(row / sigma), residual / sigma);
        cost += (residual / sigma).powi(2);
    };
    for sighting in set {
        let Some((observed, sigma)) = sighting.range_rate() else { continue };
        let satellite = sighting.orbit.state(time + (state[4] - FLIGHT_S));
        let (s, v) = (satellite.position_m, satellite.velocity_mps);
        let los = s - place;
        let range = los.norm();
        let u = los / range;
        let rate = u.dot(&v);
        let gradient = (u * rate - v) / range;
        // Two-body gravity with the Coriolis and centrifugal terms of the rotating frame.
        let gravity = -MU_EARTH / s.norm().powi(3) * s;
        let acceleration = gravity - omega.cross(&(2.0 * v + omega.cross(&s)));
        let curvature = u.dot(&acceleration) + (v.norm_squared() - rate * rate) / range;
        let residual = observed + SPEED_OF_LIGHT * satellite.clock_drift_sps - rate - state[3];
        let row = DopplerState::new(gradient.x, gradient.y, gradient.z, 1.0, curvature);
        push(row, residual, sigma.max(SOFT_HZ * L1_WAVELENGTH));
    }
    let (radius, up) = (place.norm(), place.normalize());
    push(DopplerState::new(up.x, up.y, up.z, 0.0, 0.0), EARTH_RADIUS - radius, RADIUS_SIGMA_M);
    cost
}
