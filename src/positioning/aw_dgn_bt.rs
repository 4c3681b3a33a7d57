//! Position from the Earth's centre: damped Gauss-Newton with an altitude wall and backtracking.
//!
//! Morichi, Zocca, Minetto, Nardin, Dovis, "Pseudorange and Doppler-based positioning: enabling
//! convergence of least-squares estimation from MEO to LEO", NAVIGATION 73, 2026, navi.734. In the
//! paper's symbols, for observations `y`, their model `h(x)` and the state `x = (r, clock)`:
//!
//! ```text
//!  1  x <- 0, mu <- mu0, k <- 0
//!  2  repeat
//!  3    e <- y - h(x);  J <- dh/dx;  Phi(x) <- e.e
//!  4    dx <- argmin |J dx - e|
//!  5    k <- k + 1;  if k > kmax: fail
//!  6    if k > 1: mu <- 1 ("1B", BT)  or  min(1, 2 mu) (fixed mu0)
//!  7    xn <- x + mu dx
//!  9    while not [ Phi(xn) <= (1 + tau) Phi(x)  and  |r(xn)| < psi + theta ]:
//!         mu <- mu/2;  if mu < eta: fail;  xn <- x + mu dx
//! 12    x <- xn
//! 13  until |mu dx| < eps
//! ```
//!
//! GN has `mu = 1` and no line 9; ADGN lacks the wall (`|r|` in line 9), AW-DGN has it.
//!
//! Decisions where the paper is silent or misprinted:
//! - The state has 4 numbers, for pseudoranges `(r, b = c dt)` in m and for Dopplers `(r, c drift)`
//!   in m/s: five satellites cannot give more. Clock terms are lengths, not seconds, so that no
//!   solver of the linear system loses digits.
//! - Doppler enters as range rate `-lambda D`, with satellite velocities in the Earth-fixed frame;
//!   the receiver stands still.
//! - The wall (17) is one-sided, `psi` = 6371 km ("6.371 km" is a misprint), `theta` = 50 km. A
//!   two-sided shell hardly ever converges.
//! - `tau` = 1e-8 in (15) is relative to `Phi(x)`, and an absolute floor of 1e-13 m^2 (or (m/s)^2)
//!   lets exact data pass at the level of rounding.
//! - The first damping is `mu0` itself; it is doubled from the second step.
//! - The stop test takes the applied step `mu dx`, all four numbers; `eps` = 1e-5, `eta` = 1e-6,
//!   `kmax` = 100. A count of iterations is one of linearisations, the last included.
//! - Linear systems are solved by orthogonalisation, unweighted.

use super::least_squares::{LeastSquares, MAX_ROWS};
use crate::gnss::constants::EARTH_RADIUS;
use nalgebra::{Vector3, Vector4};

/// A satellite, as the geometry needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Satellite {
    /// Position, m, ECEF.
    pub position_m: Vector3<f64>,
    /// Velocity, m/s, ECEF.
    pub velocity_mps: Vector3<f64>,
}

/// What an observation is expected to be, but for the receiver's clock, which adds the same to all.
pub trait ObservationModel {
    /// Prediction for a receiver at rest at `receiver_m` (ECEF).
    fn predict(satellite: &Satellite, receiver_m: &Vector3<f64>) -> f64;

    /// Prediction and its gradient by the receiver's position.
    fn linearise(satellite: &Satellite, receiver_m: &Vector3<f64>) -> (f64, Vector3<f64>);
}

/// Pseudorange, m: `h = |s - r| + b`.
#[derive(Clone, Copy, Debug)]
pub struct Pseudorange;

/// Doppler as range rate, m/s: `h = u . v + d` with the unit vector u from receiver to satellite.
#[derive(Clone, Copy, Debug)]
pub struct Doppler;

impl ObservationModel for Pseudorange {
    fn predict(satellite: &Satellite, receiver_m: &Vector3<f64>) -> f64 {
        (satellite.position_m - receiver_m).norm()
    }

    fn linearise(satellite: &Satellite, receiver_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let los = satellite.position_m - receiver_m;
        let range = los.norm();
        (range, -los / range)
    }
}

impl ObservationModel for Doppler {
    fn predict(satellite: &Satellite, receiver_m: &Vector3<f64>) -> f64 {
        let los = satellite.position_m - receiver_m;
        los.dot(&satellite.velocity_mps) / los.norm()
    }

    fn linearise(satellite: &Satellite, receiver_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let los = satellite.position_m - receiver_m;
        let inverse_range = 1.0 / los.norm();
        let u = los * inverse_range;
        let rate = u.dot(&satellite.velocity_mps);
        (rate, (u * rate - satellite.velocity_mps) * inverse_range)
    }
}

/// How steps are damped: which algorithm of the paper this is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// Damping of the first step, `mu0`.
    initial: f64,
    /// Whether each further step starts at 1 ("1B") rather than at twice the damping before.
    restart: bool,
    /// Whether a step is halved until the cost does not grow (15).
    descent: bool,
    /// Largest distance from the Earth's centre, m, `psi + theta` of (17); infinite without a wall.
    wall_m: f64,
}

impl Damping {
    /// `theta` of the paper, m.
    const THETA: f64 = 50e3;
    const NONE: Self = Self { initial: 1.0, restart: true, descent: false, wall_m: f64::INFINITY };

    /// Gauss-Newton: full steps.
    pub const GN: Self = Self::NONE;
    /// Adaptively damped, each step from 1 downwards.
    pub const ADGN_BT: Self = Self { descent: true, ..Self::NONE };
    /// The same with the altitude wall: the paper's solver.
    pub const AW_DGN_BT: Self = Self { wall_m: EARTH_RADIUS + Self::THETA, ..Self::ADGN_BT };

    /// Adaptively damped, from the damping `mu0` in (0, 1], which doubles with each step.
    pub const fn adgn(mu0: f64) -> Self {
        Self { initial: mu0, restart: false, ..Self::ADGN_BT }
    }

    /// The same with the altitude wall.
    pub const fn aw_dgn(mu0: f64) -> Self {
        Self { initial: mu0, restart: false, ..Self::AW_DGN_BT }
    }
}

/// One accepted step of the iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Damping of the step, `mu`.
    pub mu: f64,
    /// Length of the applied step `|mu dx|`, m (clock term included).
    pub length: f64,
    /// Sum of squared residuals before the step, m^2 or (m/s)^2.
    pub objective_before: f64,
    /// State after the step: position, m ECEF, and clock term, m or m/s.
    pub state: Vector4<f64>,
}

/// A converged iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converged {
    /// Position, m, ECEF.
    pub position_m: Vector3<f64>,
    /// Receiver clock term: bias, m, for pseudoranges; drift, m/s, for Dopplers.
    pub clock: f64,
    /// Sum of squared residuals of the last linearisation, m^2 or (m/s)^2.
    pub objective: f64,
    /// Number of linearisations.
    pub iterations: usize,
}

/// Why an iteration did not converge.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Divergence {
    /// Too few or too many observations for the solver.
    #[error("{0} observations given, from 4 to {MAX_ROWS} can be solved")]
    Observations(usize),
    /// The linear system has no unique solution.
    #[error(
        "the geometry at iteration {iterations} is singular: the lines of sight are not independent"
    )]
    Singular {
        /// State, m ECEF and clock term, at which this was found.
        state: Vector4<f64>,
        /// Linearisations so far.
        iterations: usize,
    },
    /// No damping down to `eta` gives an allowed step.
    #[error("no allowed step reduces the residuals after {iterations} iterations")]
    Jammed {
        /// Last accepted state, m ECEF and clock term.
        state: Vector4<f64>,
        /// Linearisations so far.
        iterations: usize,
    },
    /// `kmax` linearisations did not suffice.
    #[error("no convergence in {iterations} iterations")]
    TooSlow {
        /// Last accepted state, m ECEF and clock term.
        state: Vector4<f64>,
        /// Linearisations done.
        iterations: usize,
    },
}

const EPS: f64 = 1e-5;
const TAU: f64 = 1e-8;
const ETA: f64 = 1e-6;
const FLOOR: f64 = 1e-13;
const K_MAX: usize = 100;

/// AW-DGN-BT from the Earth's centre: observation `i` of `observed` (m or m/s) is of `satellites[i]`.
/// Allocates nothing.
pub fn aw_dgn_bt<M: ObservationModel>(
    satellites: &[Satellite],
    observed: &[f64],
) -> Result<Converged, Divergence> {
    iterate::<M>(satellites, observed, &Damping::AW_DGN_BT, Vector4::zeros(), |_| ())
}

/// The iteration of the module's head from the state `start` (m ECEF and clock term), under any of
/// the paper's dampings; `trace` sees each accepted step. Surplus satellites or observations, when
/// one list is longer, are not used.
pub fn iterate<M: ObservationModel>(
    satellites: &[Satellite],
    observed: &[f64],
    damping: &Damping,
    start: Vector4<f64>,
    mut trace: impl FnMut(&Step),
) -> Result<Converged, Divergence> {
    let n = satellites.len().min(observed.len());
    if !(4..=MAX_ROWS).contains(&n) {
        return Err(Divergence::Observations(n));
    }
    let pairs = || satellites.iter().zip(observed);
    let objective = |x: &Vector4<f64>| -> f64 {
        let r = x.xyz();
        pairs().map(|(s, y)| (y - M::predict(s, &r) - x.w).powi(2)).sum()
    };
    let mut system = LeastSquares::<4>::default();
    let mut state = start;
    let mut mu = damping.initial;
    for iterations in 1..=K_MAX {
        let position = state.xyz();
        let mut phi = 0.0;
        for (satellite, y) in pairs() {
            let (h, gradient) = M::linearise(satellite, &position);
            let e = y - h - state.w;
            phi += e * e;
            system.push(&gradient.push(1.0), e);
        }
        let Some(solution) = system.solve() else {
            return Err(Divergence::Singular { state, iterations });
        };
        if iterations > 1 {
            mu = if damping.restart { 1.0 } else { (2.0 * mu).min(1.0) };
        }
        let allowed = |x: &Vector4<f64>| {
            !damping.descent
                || (x.xyz().norm() < damping.wall_m && objective(x) <= (1.0 + TAU) * phi + FLOOR)
        };
        let mut next = state + mu * solution.x;
        while !allowed(&next) {
            mu /= 2.0;
            if mu < ETA {
                return Err(Divergence::Jammed { state, iterations });
            }
            next = state + mu * solution.x;
        }
        state = next;
        let length = mu * solution.x.norm();
        trace(&Step { mu, length, objective_before: phi, state });
        if length < EPS {
            return Ok(Converged {
                position_m: state.xyz(),
                clock: state.w,
                objective: phi,
                iterations,
            });
        }
    }
    Err(Divergence::TooSlow { state, iterations: K_MAX })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constellation() -> Vec<Satellite> {
        [(10.0, 0.0), (60.0, 80.0), (45.0, 200.0), (25.0, 130.0), (30.0, 290.0), (80.0, 10.0)]
            .map(|(elevation, azimuth): (f64, f64)| {
                let (se, ce) = elevation.to_radians().sin_cos();
                let (sa, ca) = azimuth.to_radians().sin_cos();
                let position_m =
                    Vector3::new(6.371e6 + 2.2e7 * se, 2.2e7 * ce * sa, 2.2e7 * ce * ca);
                let velocity_mps = position_m.cross(&Vector3::new(sa, ca, 0.5)).normalize() * 3.2e3;
                Satellite { position_m, velocity_mps }
            })
            .to_vec()
    }

    fn converges_to_the_truth<M: ObservationModel>(clock: f64) {
        let satellites = constellation();
        let truth = Vector3::new(6.3e6, 4e5, -8e5);
        let observed: Vec<f64> = satellites.iter().map(|s| M::predict(s, &truth) + clock).collect();
        let fix = aw_dgn_bt::<M>(&satellites, &observed).unwrap();
        // The last step was below 1e-5, and convergence is quadratic.
        assert!((fix.position_m - truth).norm() < 1e-5 && (fix.clock - clock).abs() < 1e-5);
        assert_eq!(
            aw_dgn_bt::<M>(&satellites[..3], &observed[..3]),
            Err(Divergence::Observations(3))
        );
        let same = [satellites[0]; 5];
        assert!(matches!(aw_dgn_bt::<M>(&same, &observed[..5]), Err(Divergence::Singular { .. })));
        let mut broken = observed.clone();
        broken[1] = f64::NAN;
        assert!(aw_dgn_bt::<M>(&satellites, &broken).is_err());
    }

    #[test]
    fn exact_observations_lead_from_the_centre_to_the_truth() {
        converges_to_the_truth::<Pseudorange>(-2e5);
        converges_to_the_truth::<Doppler>(1.5e3);
    }

    #[test]
    fn gradients_are_the_derivatives_of_the_predictions() {
        fn check<M: ObservationModel>(step: f64, tolerance: f64) {
            let receiver = Vector3::new(6.3e6, 4e5, -8e5);
            for satellite in constellation() {
                let (value, gradient) = M::linearise(&satellite, &receiver);
                assert!((value - M::predict(&satellite, &receiver)).abs() < 1e-8 * value.abs());
                for axis in 0..3 {
                    let mut offset = Vector3::zeros();
                    offset[axis] = step;
                    let difference = (M::predict(&satellite, &(receiver + offset))
                        - M::predict(&satellite, &(receiver - offset)))
                        / (2.0 * step);
                    assert!((difference - gradient[axis]).abs() < tolerance);
                }
            }
        }
        // Truncation (step/range)^2 and rounding 4e-9 m / step (pseudorange), 1e-12 m/s / step.
        check::<Pseudorange>(100.0, 1e-9);
        check::<Doppler>(1000.0, 1e-11);
    }
}
