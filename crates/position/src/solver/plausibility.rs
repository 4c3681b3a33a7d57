//! When a place that an iteration converged to is believed.

use crate::problem::Problem;
use nalgebra::Vector3;
use sdr_rx_gnss::constants::EARTH_RADIUS;

/// `theta` of Morichi et al.: height of the altitude wall above the mean radius, m.
pub(super) const WALL_M: f64 = 50e3;
/// Solutions nearer to each other than this, m, are the same.
pub(super) const SAME_M: f64 = 1e3;
/// Depth below the mean radius, m, down to which a place is believed.
const DEPTH_M: f64 = 100e3;
/// Costs per redundant observation that are believed at once, and at all: 2.5 and 5 deviations.
const EARLY: f64 = 6.25;
const BELIEVED: f64 = 25.0;

/// Whether a place is near enough to the Earth's surface to be believed without proof.
pub(super) fn near_the_surface(position_m: &Vector3<f64>) -> bool {
    let height = position_m.norm() - EARTH_RADIUS;
    // A place projected to the wall lies at it but for rounding.
    height > -DEPTH_M && height <= WALL_M * (1.0 + 1e-9)
}

/// Whether a place is not inside the Earth: what is believed of a place that residuals prove.
pub(super) fn above_the_ground(position_m: &Vector3<f64>) -> bool {
    let height = position_m.norm() - EARTH_RADIUS;
    height > -DEPTH_M && height.is_finite()
}

/// Costs below which a place is believed at once, and at all; infinite if no deviations are known.
pub(super) fn believed_costs(problem: &Problem) -> [f64; 2] {
    let degrees = problem.redundancy().max(1) as f64;
    match problem.sigma_known {
        true => [EARLY * degrees, BELIEVED * degrees],
        false => [f64::INFINITY; 2],
    }
}
