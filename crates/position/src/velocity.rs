//! Velocity and clock drift from Dopplers at a known place: a least-squares problem that is linear
//! but for parts in 1e6.

use super::least_squares::{LeastSquares, MAX_ROWS};
use super::sight::{Sight, Sighting};
use super::statistics::chi_square_limit;
use nalgebra::{Vector3, Vector4};

/// How the receiver moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    pub velocity_mps: Vector3<f64>,
    /// c times the rate of the receiver's clock, m/s.
    pub drift_mps: f64,
}

/// Motion by the Dopplers of `used` seen under `sights`. A Doppler without which the others agree is
/// left out; `None` with fewer than four, or if they contradict each other.
pub(super) fn motion(used: &[Sighting], sights: &[Sight]) -> Option<Motion> {
    let mut rates: Vec<(Sight, f64, f64)> = used
        .iter()
        .zip(sights)
        .filter_map(|(sighting, sight)| {
            let (rate, sigma) = sighting.range_rate()?;
            Some((*sight, rate, sigma.hypot(sight.rate_sigma_mps)))
        })
        .take(MAX_ROWS)
        .collect();
    let (mut motion, mut excess) = fit(&rates)?;
    while excess > 1.0 && rates.len() >= 6 {
        let without = |k: usize| {
            let mut rest = rates.clone();
            rest.remove(k);
            fit(&rest).map(|(motion, excess)| (k, motion, excess))
        };
        let best = (0..rates.len()).filter_map(without).min_by(|a, b| a.2.total_cmp(&b.2))?;
        rates.remove(best.0);
        (motion, excess) = (best.1, best.2);
    }
    (excess <= 1.0).then_some(motion)
}

/// Least squares, and the weighted sum of squared residuals over its limit.
fn fit(rates: &[(Sight, f64, f64)]) -> Option<(Motion, f64)> {
    let mut system = LeastSquares::<4>::default();
    let mut state = Vector4::zeros();
    let mut cost = 0.0;
    // The nonlinear part is 1e-5 of the velocity: three rounds leave nothing.
    for _ in 0..3 {
        cost = 0.0;
        for (sight, rate, sigma) in rates {
            let residual = rate - sight.range_rate(&state.xyz(), state.w);
            system.push(&((-sight.direction).push(1.0) / *sigma), residual / sigma);
            cost += (residual / sigma).powi(2);
        }
        state += system.solve()?.x;
    }
    let limit =
        rates.len().checked_sub(4).filter(|&r| r > 0).map_or(f64::INFINITY, chi_square_limit);
    Some((Motion { velocity_mps: state.xyz(), drift_mps: state.w }, cost / limit))
}
