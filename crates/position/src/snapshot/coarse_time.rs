//! Least squares with time as an unknown: code phases, Dopplers and a soft height together.
//!
//! Unknowns: position `r` (ECEF, m), GPS time of reception minus the given time `tau` (s), common part of the
//! code phases `b` (m), c times the drift of the receiver's clock `d` (m/s). Per satellite, with the
//! predictions of [`Predicted`] at `t = t0 + tau`:
//!
//! ```text
//! code phase + 1 ms c N = range(r, t) + b,  rows by r, tau, b, d (-u, range rate, 1, 0)
//! -lambda D = rate(r, t) + d,               rows (grad rate, range acceleration, 0, 1)
//! ```
//!
//! (van Diggelen, A-GPS, 2009, chapter 4, with Dopplers added), and two priors: a height of 500 m
//! +- half of the largest ([`PositioningOptions::max_height_m`]) on WGS 84, and `tau` of 0 +- the given uncertainty.

use crate::PositioningOptions;
use crate::epoch::ITERATES_M;
use crate::epoch::predicted::Predicted;
use crate::epoch::sighting::Sighting;
use crate::gauss_newton::{Damping, Model, Step, Verdict, gauss_newton};
use crate::least_squares::{LeastSquares, LinearRow};
use crate::point::Point;
use crate::point::Terms;
use nalgebra::{Matrix4, Vector3, Vector4};
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::signal::GPS_L1_CA;
use sdr_rx_gnss::{GpsTime, NavigationData};

/// Index of the time among position and time.
pub(super) const TIME: usize = 3;
/// Clock terms.
const BIAS: usize = 0;
const DRIFT: usize = 1;

/// c x 1 ms, m.
pub(super) const CODE_PERIOD_M: f64 = SPEED_OF_LIGHT * GPS_L1_CA.period_s();

/// Prior height, m, and its standard deviation as a fraction of the largest height: aircraft within one, balloons within
/// three.
const HEIGHT: f64 = 500.0;
const HEIGHT_SIGMA: f64 = 0.5;

/// The problem: what does not change from one solution attempt to the next.
#[derive(Clone, Copy)]
pub(super) struct CoarseTime<'a> {
    pub time: GpsTime,
    pub nav: &'a NavigationData,
    pub options: &'a PositioningOptions,
    /// Speed of the receiver, m/s: a standard deviation of the Dopplers.
    pub speed_mps: f64,
}

/// Cost per satellite at which an attempt is given up: a right one costs about 2.
const HOPELESS: f64 = 1e4;

/// Linearisations at most: a few suffice but where the Dopplers hardly bound a region.
const MOST_ITERATIONS: usize = 20;

/// A converged solution.
#[derive(Clone)]
pub(super) struct CoarseFix {
    /// Position and time, m and s.
    pub place_time: Vector4<f64>,
    /// Common part of the code phases, m.
    pub bias_m: f64,
    /// c times the drift of the receiver's clock, m/s.
    pub drift_mps: f64,
    pub predictions: Vec<Predicted>,
    /// Observed minus computed code ranges, m.
    pub code_residuals_m: Vec<f64>,
    /// Weighted sum of squared residuals, priors included.
    pub cost: f64,
    /// Of position and time.
    pub covariance: Matrix4<f64>,
    pub iterations: usize,
}

impl CoarseFix {
    pub fn position_m(&self) -> Vector3<f64> {
        self.place_time.xyz()
    }

    /// Time of reception minus the given time, s.
    pub fn late_s(&self) -> f64 {
        self.place_time[TIME]
    }
}

impl CoarseTime<'_> {
    /// Gauss-Newton from a place and time with a drift (m/s), by Dopplers alone, or with the code phases too
    /// when their whole periods and common part (m) are given; `None` if it leaves the Earth or does not settle.
    pub fn solve(
        &self,
        set: &[Sighting],
        codes: Option<(&[i32], f64)>,
        start: Vector4<f64>,
        drift_mps: f64,
    ) -> Option<CoarseFix> {
        let integers = codes.map(|(integers, _)| integers);
        let clocks = Terms::from([codes.map_or(0.0, |(_, bias_m)| bias_m), drift_mps]);
        let attempt = Attempt { problem: self, set, integers };
        let damping = Damping::plain(MOST_ITERATIONS);
        let found = gauss_newton(&attempt, Point { x: start, clocks }, &damping, |_| ()).ok()?;
        Some(CoarseFix {
            place_time: found.point.x,
            bias_m: found.point.clocks[BIAS],
            drift_mps: found.point.clocks[DRIFT],
            predictions: found.view.predictions,
            code_residuals_m: found.view.code_residuals_m,
            cost: found.cost,
            covariance: found.system.covariance(),
            iterations: found.iterations,
        })
    }
}

/// One set of satellites and whole periods.
struct Attempt<'a, 's> {
    problem: &'a CoarseTime<'a>,
    set: &'a [Sighting<'s>],
    integers: Option<&'a [i32]>,
}

#[derive(Default)]
struct View {
    predictions: Vec<Predicted>,
    code_residuals_m: Vec<f64>,
}

impl Model<4, 5> for Attempt<'_, '_> {
    type View = View;

    fn look(&self, at: &Point<4>, view: &mut View, system: &mut LeastSquares<4, 5>) {
        let CoarseTime { time, nav, options, speed_mps } = self.problem;
        let (position_m, late_s) = (at.x.xyz(), at.x[TIME]);
        let predict = |s: &Sighting| {
            Predicted::new(s.orbit, s.carrier_hz, &position_m, *time + late_s, nav, options)
        };
        view.predictions = self.set.iter().map(predict).collect();
        let mut rows = Vec::with_capacity(2 * self.set.len() + 2);
        view.code_residuals_m.clear();
        let at_rest = Vector3::zeros();
        for (k, (sighting, predicted)) in self.set.iter().zip(&view.predictions).enumerate() {
            if let Some((observed, sigma)) = sighting.range_rate() {
                let g = predicted.rate_gradient;
                let residual = observed - predicted.range_rate(&at_rest, at.clocks[DRIFT]);
                let row = [g.x, g.y, g.z, predicted.acceleration_mps2, residual];
                let sigma = sigma.hypot(predicted.rate_sigma_mps).hypot(*speed_mps);
                rows.push(LinearRow::new(row, sigma, Some(DRIFT)));
            }
            let Some((integers, code_m)) = self.integers.zip(sighting.range_m) else { continue };
            let g = -predicted.direction;
            let range_m = code_m + f64::from(integers[k]) * CODE_PERIOD_M;
            let residual = range_m - predicted.range_m - at.clocks[BIAS];
            let row = [g.x, g.y, g.z, predicted.range_rate(&at_rest, 0.0), residual];
            let sigma = sighting.observation.range_sigma_m.hypot(predicted.range_sigma_m);
            rows.push(LinearRow::new(row, sigma, Some(BIAS)));
            view.code_residuals_m.push(residual);
        }
        let place = Geodetic::from_ecef(&position_m);
        let up = place.ecef_to_enu().row(2).transpose();
        let height = [up.x, up.y, up.z, 0.0, HEIGHT - place.height];
        rows.push(LinearRow::new(height, HEIGHT_SIGMA * options.max_height_m, None));
        let known_time = [0.0, 0.0, 0.0, 1.0, -late_s];
        rows.push(LinearRow::new(known_time, options.time_uncertainty_s, None));
        system.set(rows.into_iter());
    }

    fn verdict(&self, step: &Step<4>, system: &LeastSquares<4, 5>) -> Verdict {
        // Two steps bring a start 300 km off to a metre: a cost this large is that of wrong integers.
        let hopeless = self.integers.is_some()
            && step.iterations > 2
            && step.cost_before > HOPELESS * self.set.len() as f64;
        if hopeless || !ITERATES_M.contains(&step.to.x.xyz().norm()) {
            return Verdict::Abandon;
        }
        // Codes settle to 1 cm; a region of Dopplers need not be better than 10 m, nor than a hundredth of
        // what the Dopplers leave open.
        let open_m = || system.covariance().fixed_view::<3, 3>(0, 0).trace().sqrt();
        let near_m = if self.integers.is_some() { 0.01 } else { (0.01 * open_m()).max(10.0) };
        let moved_m = (step.to.x - step.from.x).xyz().norm();
        if moved_m < near_m { Verdict::Converged } else { Verdict::Continue }
    }
}
