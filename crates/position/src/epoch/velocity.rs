//! Velocity and clock drift from Dopplers at a known place: a least-squares problem that is linear
//! but for parts in 1e6.

use super::predicted::Predicted;
use super::sighting::Sighting;
use crate::gauss_newton::{Damping, Model, Step, Verdict, gauss_newton};
use crate::integrity::chi_square_limit;
use crate::least_squares::{LeastSquares, LinearRow};
use crate::point::Point;
use crate::point::Terms;
use nalgebra::Vector3;

/// How the receiver moves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    pub velocity_mps: Vector3<f64>,
    /// c times the rate of the receiver's clock, m/s.
    pub drift_mps: f64,
}

/// Motion by the Dopplers of `used` as `predictions` has them. A Doppler without which the others agree is
/// left out; `None` with fewer than four, or if they contradict each other.
pub(crate) fn motion(used: &[Sighting], predictions: &[Predicted]) -> Option<Motion> {
    let rates = used.iter().zip(predictions).filter_map(|(sighting, predicted)| {
        let (rate, sigma) = sighting.range_rate()?;
        Some((*predicted, rate, sigma.hypot(predicted.rate_sigma_mps)))
    });
    let mut rates = Rates(rates.collect());
    let (mut motion, mut excess) = rates.fit()?;
    while excess > 1.0 && rates.0.len() >= 6 {
        let without = |k: usize| {
            let mut rest = rates.0.clone();
            rest.remove(k);
            Rates(rest).fit().map(|(motion, excess)| (k, motion, excess))
        };
        let best = (0..rates.0.len()).filter_map(without).min_by(|a, b| a.2.total_cmp(&b.2))?;
        rates.0.remove(best.0);
        (motion, excess) = (best.1, best.2);
    }
    (excess <= 1.0).then_some(motion)
}

/// Predictions, range rates and their standard deviations, m/s.
struct Rates(Vec<(Predicted, f64, f64)>);

impl Rates {
    /// Least squares, and the weighted sum of squared residuals over its limit.
    fn fit(&self) -> Option<(Motion, f64)> {
        let rest = Point { x: Vector3::zeros(), clocks: Terms::from_elem(0.0, 1) };
        let found = gauss_newton(self, rest, &Damping::plain(3), |_| ()).ok()?;
        let redundancy = self.0.len().checked_sub(4).filter(|&r| r > 0);
        let limit = redundancy.map_or(f64::INFINITY, chi_square_limit);
        let motion = Motion { velocity_mps: found.point.x, drift_mps: found.point.clocks[0] };
        Some((motion, found.cost / limit))
    }
}

impl Model<3, 4> for Rates {
    type View = ();

    fn look(&self, at: &Point<3>, (): &mut (), system: &mut LeastSquares<3, 4>) {
        system.set(self.0.iter().map(|(predicted, rate, sigma)| {
            let g = -predicted.direction;
            let residual = rate - predicted.range_rate(&at.x, at.clocks[0]);
            LinearRow::new([g.x, g.y, g.z, residual], *sigma, Some(0))
        }));
    }

    /// The nonlinear part is 1e-5 of the velocity: three rounds leave nothing.
    fn verdict(&self, step: &Step<3>, _: &LeastSquares<3, 4>) -> Verdict {
        if step.iterations == 3 { Verdict::Converged } else { Verdict::Continue }
    }
}
