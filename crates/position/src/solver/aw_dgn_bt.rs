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

use super::belief::WALL_M;
pub use super::model::{Doppler, ObservationModel, Pseudorange, Satellite};
use super::observations::{Observations, Observed};
use super::outcome::{Damped, Failure, Solution, State, Step};
use super::system::{Clocks, MAX_ROWS, System, unseen};
use nalgebra::Vector3;
use sdr_rx_gnss::constants::EARTH_RADIUS;

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
    const NONE: Self = Self { initial: 1.0, restart: true, descent: false, wall_m: f64::INFINITY };

    /// Gauss-Newton: full steps.
    pub const GN: Self = Self::NONE;
    /// Adaptively damped, each step from 1 downwards.
    pub const ADGN_BT: Self = Self { descent: true, ..Self::NONE };
    /// The same with the altitude wall: the paper's solver.
    pub const AW_DGN_BT: Self = Self { wall_m: EARTH_RADIUS + WALL_M, ..Self::ADGN_BT };

    /// Adaptively damped, from the damping `mu0` in (0, 1], which doubles with each step.
    pub const fn adgn(mu0: f64) -> Self {
        Self { initial: mu0, restart: false, ..Self::ADGN_BT }
    }

    /// The same with the altitude wall.
    pub const fn aw_dgn(mu0: f64) -> Self {
        Self { initial: mu0, restart: false, ..Self::AW_DGN_BT }
    }
}

const EPS: f64 = 1e-5;
const TAU: f64 = 1e-8;
const ETA: f64 = 1e-6;
const K_MAX: usize = 100;
/// Farther from the Earth's centre, m, nothing that is solved here can be.
const FAR: f64 = 1e9;

/// AW-DGN-BT from the Earth's centre: observation `i` of `observed` (m or m/s) is of `satellites[i]`.
/// Allocates nothing.
pub fn aw_dgn_bt<M: ObservationModel>(
    satellites: &[Satellite],
    observed: &[f64],
) -> Result<Solution, Failure> {
    iterate(&Observed::<M>::new(satellites, observed), &Damping::AW_DGN_BT, &State::CENTRE, |_| ())
}

/// The iteration of the module's head from the place `start`, under any of the paper's dampings; clock
/// terms that `start` does not give are 0. `trace` sees each accepted step. Allocates nothing.
pub fn iterate<O: Observations>(
    observations: &O,
    damping: &Damping,
    start: &State,
    trace: impl FnMut(&Step),
) -> Result<Solution, Failure> {
    match observations.rows().iter().sum() {
        0..=16 => run::<O, 16>(observations, damping, start, trace),
        17..=64 => run::<O, 64>(observations, damping, start, trace),
        _ => run::<O, MAX_ROWS>(observations, damping, start, trace),
    }
}

fn run<O: Observations, const N: usize>(
    observations: &O,
    damping: &Damping,
    start: &State,
    mut trace: impl FnMut(&Step),
) -> Result<Solution, Failure> {
    let mut system = System::<O, N>::new(observations)?;
    let (mut seen, mut seen_next) = (unseen::<N>(), unseen::<N>());
    let (mut here, mut there) = (&mut seen, &mut seen_next);
    let (mut right, mut right_next) = ([0.0; N], [0.0; N]);
    let mut position: Vector3<f64> = start.position_m;
    let mut clocks: Clocks = system.clocks(start);
    let mut mu = damping.initial;
    system.see(&position, here);
    let mut phi = system.residuals(here, &clocks, &mut right);
    for iterations in 1..=K_MAX {
        let state = system.state(position, clocks);
        let Some((dx, dc)) = system.step(here, &right) else {
            return Err(system.diagnose(state, iterations));
        };
        if iterations > 1 {
            mu = if damping.restart { 1.0 } else { (2.0 * mu).min(1.0) };
        }
        let first = mu;
        let (mut wall, mut cost) = (0, 0);
        let phi_next = loop {
            let next = position + mu * dx;
            // A step beyond all numbers is not inside either.
            let inside = next.norm() < damping.wall_m;
            let blocked = damping.descent && !inside;
            if !blocked {
                let clocks_next = [clocks[0] + mu * dc[0], clocks[1] + mu * dc[1]];
                system.see(&next, there);
                let phi_next = system.residuals(there, &clocks_next, &mut right_next);
                if !damping.descent || phi_next <= (1.0 + TAU) * phi + system.floor {
                    (position, clocks) = (next, clocks_next);
                    break phi_next;
                }
            }
            *(if blocked { &mut wall } else { &mut cost }) += 1;
            mu /= 2.0;
            if mu < ETA {
                return Err(Failure::Jammed { state, iterations, wall: blocked });
            }
        };
        std::mem::swap(&mut here, &mut there);
        std::mem::swap(&mut right, &mut right_next);
        let length = mu * (dx.norm_squared() + dc[0] * dc[0] + dc[1] * dc[1]).sqrt();
        let state = system.state(position, clocks);
        let damped = Damped::by(first, wall, cost);
        let (objective_before, objective_after) = (phi, phi_next);
        trace(&Step { start: 0, mu, length, objective_before, objective_after, state, damped });
        phi = phi_next;
        if length < EPS {
            if position.norm() > FAR {
                return Err(Failure::Diverged { state, iterations });
            }
            if let Some(row) = system.coincident(&position) {
                return Err(Failure::Coincident { row });
            }
            return Ok(Solution::untested(state, phi, system.covariance(), iterations));
        }
    }
    Err(Failure::TooSlow { state: system.state(position, clocks), iterations: K_MAX })
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
        let state = fix.state;
        assert!((state.position_m - truth).norm() < 1e-5 && (state.clock() - clock).abs() < 1e-5);
        assert_eq!(
            aw_dgn_bt::<M>(&satellites[..3], &observed[..3]),
            Err(Failure::Observations { rows: 3, needed: 4 })
        );
        let same = [satellites[0]; 5];
        assert!(matches!(aw_dgn_bt::<M>(&same, &observed[..5]), Err(Failure::Coplanar)));
        let mut broken = observed.clone();
        broken[1] = f64::NAN;
        assert_eq!(
            aw_dgn_bt::<M>(&satellites, &broken),
            Err(Failure::NotFinite { row: 1, what: "value" })
        );
    }

    #[test]
    fn exact_observations_lead_from_the_centre_to_the_truth() {
        converges_to_the_truth::<Pseudorange>(-2e5);
        converges_to_the_truth::<Doppler>(1.5e3);
    }
}
