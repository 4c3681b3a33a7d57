//! Least squares with time as an unknown: code phases, Dopplers and a soft height together.
//!
//! Unknowns `x = (r, b, d, tau)`: position (ECEF, m), common part of the code phases (m), c times the
//! drift of the receiver's clock (m/s), and GPS time of reception minus the given time (s). Per
//! satellite, with the predictions of [`Sight`] at `t = t0 + tau`:
//!
//! ```text
//! code phase + 1 ms c N = range(r, t) + b,  rows (-u, 1, 0, range rate)
//! -lambda D = rate(r, t) + d,               rows (grad rate, 0, 1, range acceleration)
//! ```
//!
//! (van Diggelen, A-GPS, 2009, chapter 4, with Dopplers added), and two priors: a height of 500 m
//! +- 2 km on WGS 84, and `tau` of 0 +- the given uncertainty.

use crate::SnapshotOptions;
use crate::least_squares::LeastSquares;
use crate::sight::{Sight, Sighting};
use nalgebra::{SMatrix, SVector, Vector3};
use sdr_rx_gnss::constants::{CA_CODE_PERIOD, SPEED_OF_LIGHT};
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::{GpsTime, NavigationData};

/// Position, code bias, drift, time: m, m, m/s, s.
pub(super) type State = SVector<f64, 6>;
/// Indices of the last three.
pub(super) const BIAS: usize = 3;
pub(super) const DRIFT: usize = 4;
pub(super) const TIME: usize = 5;

/// c x 1 ms, m.
pub(super) const CODE_PERIOD_M: f64 = SPEED_OF_LIGHT * CA_CODE_PERIOD;

/// Prior height and its deviation, m: most places on land within one deviation, all within four.
const HEIGHT: f64 = 500.0;
const HEIGHT_SIGMA: f64 = 2e3;

/// The problem: what does not change from one solution attempt to the next.
pub(super) struct CoarseTime<'a> {
    pub time: GpsTime,
    pub nav: &'a NavigationData,
    pub options: &'a SnapshotOptions,
}

/// Cost per satellite at which an attempt is given up: a right one costs about 2.
const HOPELESS: f64 = 1e4;

/// Linearisations at most: a few suffice but where the Dopplers hardly bound a region.
const MOST_ITERATIONS: usize = 20;

/// A converged solution.
#[derive(Clone)]
pub(super) struct CoarseFix {
    pub state: State,
    pub sights: Vec<Sight>,
    /// Observed minus computed code ranges, m.
    pub code_residuals_m: Vec<f64>,
    /// Weighted sum of squared residuals, priors included.
    pub cost: f64,
    /// Of the state.
    pub covariance: SMatrix<f64, 6, 6>,
    pub iterations: usize,
}

impl CoarseFix {
    pub fn position_m(&self) -> Vector3<f64> {
        self.state.fixed_rows::<3>(0).into_owned()
    }
}

impl CoarseTime<'_> {
    /// Gauss-Newton from `start`, by Dopplers alone or with the code phases too when their whole
    /// periods `integers` are given; `None` if it leaves the Earth or does not settle.
    pub fn solve(
        &self,
        set: &[Sighting],
        integers: Option<&[i32]>,
        start: State,
    ) -> Option<CoarseFix> {
        let mut state = start;
        let mut system = LeastSquares::<6>::default();
        for iterations in 1..=MOST_ITERATIONS {
            let position_m = Vector3::new(state[0], state[1], state[2]);
            let sights: Vec<Sight> = set
                .iter()
                .map(|s| {
                    let t = self.time + state[TIME];
                    Sight::new(s.orbit, &position_m, t, self.nav, &self.options.positioning)
                })
                .collect();
            let mut cost = 0.0;
            let mut push = |row: State, residual: f64, sigma: f64| {
                system.push(&(row / sigma), residual / sigma);
                cost += (residual / sigma).powi(2);
            };
            let mut code_residuals_m = Vec::with_capacity(set.len());
            for (k, (sighting, sight)) in set.iter().zip(&sights).enumerate() {
                let rate = sight.range_rate(&Vector3::zeros(), 0.0);
                if let Some((observed, sigma)) = sighting.range_rate() {
                    let g = sight.rate_gradient;
                    let row = State::new(g.x, g.y, g.z, 0.0, 1.0, sight.acceleration_mps2);
                    let residual = observed - sight.range_rate(&Vector3::zeros(), state[DRIFT]);
                    let sigma =
                        sigma.hypot(sight.rate_sigma_mps).hypot(self.options.user_speed_mps);
                    push(row, residual, sigma);
                }
                let Some((integers, code_m)) = integers.zip(sighting.range_m) else { continue };
                let g = -sight.direction;
                let range_m = code_m + f64::from(integers[k]) * CODE_PERIOD_M;
                let residual = range_m - sight.range_m - state[BIAS];
                let sigma = sighting.observation.range_sigma_m.hypot(sight.range_sigma_m);
                push(State::new(g.x, g.y, g.z, 1.0, 0.0, rate), residual, sigma);
                code_residuals_m.push(residual);
            }
            let place = Geodetic::from_ecef(&position_m);
            let up = place.ecef_to_enu().row(2).transpose();
            push(State::new(up.x, up.y, up.z, 0.0, 0.0, 0.0), HEIGHT - place.height, HEIGHT_SIGMA);
            push(unit(TIME), -state[TIME], self.options.time_uncertainty_s);
            if integers.is_none() {
                // Dopplers say nothing of the code bias: it stays.
                push(unit(BIAS), 0.0, 1.0);
            }
            let solution = system.solve()?;
            // Two steps bring a start 300 km off to a metre: a cost this large is that of wrong integers.
            if integers.is_some() && iterations > 2 && cost > HOPELESS * set.len() as f64 {
                return None;
            }
            state += solution.x;
            let moved = solution.x.fixed_rows::<3>(0).norm();
            if !(5e6..8e6).contains(&state.fixed_rows::<3>(0).norm()) {
                return None;
            }
            let covariance = solution.cofactor();
            // Codes settle to 1 cm; a region of Dopplers need not be better than 10 m, nor than a
            // hundredth of what the Dopplers leave open.
            let open_m = || covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
            let near_m = if integers.is_some() { 0.01 } else { (0.01 * open_m()).max(10.0) };
            if moved < near_m {
                return Some(CoarseFix {
                    state,
                    sights,
                    code_residuals_m,
                    cost,
                    covariance,
                    iterations,
                });
            }
        }
        None
    }
}

fn unit(index: usize) -> State {
    State::from_fn(|k, _| f64::from(u8::from(k == index)))
}
