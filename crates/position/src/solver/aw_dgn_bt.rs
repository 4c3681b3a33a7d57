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
//! The loop is `gauss_newton`'s, of which this file holds the paper's tests and numbers.
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

use super::failure::Failure;
use super::plausibility::WALL_M;
use super::point_solution::{Iteration, PointSolution};
use crate::gauss_newton::{self, Model, Stopped, Test, Verdict, Why, gauss_newton};
use crate::least_squares::LeastSquares;
use crate::place::Place;
use crate::point::Point;
use crate::problem::{Problem, Row};
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

/// AW-DGN-BT from the Earth's centre.
///
/// # Errors
/// As [`iterate`].
pub fn aw_dgn_bt(rows: &[Row]) -> Result<PointSolution, Failure> {
    iterate(rows, &Damping::AW_DGN_BT, &Place::centre(), |_| ())
}

/// The iteration of the module's head from the place `start`, under any of the paper's dampings; clock
/// terms that `start` does not give are 0. `trace` sees each accepted step.
///
/// # Errors
/// [`Failure`] names what is wrong with the observations, or how the iteration ended.
pub fn iterate(
    rows: &[Row],
    damping: &Damping,
    start: &Place,
    trace: impl FnMut(&Iteration),
) -> Result<PointSolution, Failure> {
    from(&Problem::new(rows)?, damping, start, trace)
}

/// The same for a problem that was checked.
pub(super) fn from(
    problem: &Problem,
    damping: &Damping,
    start: &Place,
    mut trace: impl FnMut(&Iteration),
) -> Result<PointSolution, Failure> {
    let floor = problem.floor;
    let settings = gauss_newton::Damping {
        initial: damping.initial,
        restart: damping.restart,
        test: if damping.descent { Test::Descent { tau: TAU, floor } } else { Test::None },
        least: ETA,
        most: K_MAX,
    };
    let walled = Walled { problem, wall_m: damping.wall_m };
    let found = gauss_newton(&walled, problem.point(start), &settings, |step| {
        trace(&Iteration::of(problem, step));
    });
    match found {
        Ok(found) if found.point.x.norm() > FAR => {
            let (state, iterations) = (problem.state(&found.point), found.iterations);
            Err(Failure::Diverged { state, iterations })
        }
        Ok(found) => match problem.coincident(&found.point.x) {
            Some(row) => Err(Failure::Coincident { row }),
            None => {
                let (state, covariance) = (problem.state(&found.point), found.system.covariance());
                Ok(PointSolution::untested(state, found.cost, covariance, found.iterations))
            }
        },
        Err(Stopped { point, iterations, why, .. }) => Err(match why {
            Why::Singular => problem.diagnose(&point, iterations),
            Why::Jammed { refused: wall } => {
                Failure::Jammed { state: problem.state(&point), iterations, wall }
            }
            Why::TooSlow | Why::Abandoned => {
                Failure::TooSlow { state: problem.state(&point), iterations }
            }
        }),
    }
}

/// A problem, and how far from the Earth's centre its place may be, m.
struct Walled<'a> {
    problem: &'a Problem<'a>,
    wall_m: f64,
}

impl Model<3, 4> for Walled<'_> {
    type View = ();

    #[inline]
    fn look(&self, at: &Point<3>, (): &mut (), system: &mut LeastSquares<3, 4>) {
        self.problem.look(at, system, |_| ());
    }

    /// The wall (17); a step beyond all numbers is not inside either.
    #[inline]
    fn admit(&self, next: &mut Point<3>) -> bool {
        next.x.norm() < self.wall_m
    }

    /// Line 13.
    #[inline]
    fn verdict(&self, step: &gauss_newton::Step<3>, _: &LeastSquares<3, 4>) -> Verdict {
        if step.length < EPS { Verdict::Converged } else { Verdict::Continue }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::{RowKind, Satellite};
    use nalgebra::Vector3;

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

    const TRUTH: Vector3<f64> = Vector3::new(6.3e6, 4e5, -8e5);

    fn row(kind: RowKind, satellite: Satellite, clock: f64) -> Row {
        Row::new(kind, satellite, kind.see(&satellite, &TRUTH).value + clock)
    }

    #[test]
    fn exact_observations_lead_from_the_centre_to_the_truth() {
        for (kind, clock) in [(RowKind::Range, -2e5), (RowKind::RangeRate, 1.5e3)] {
            let rows: Vec<Row> = constellation().into_iter().map(|s| row(kind, s, clock)).collect();
            let state = aw_dgn_bt(&rows).unwrap().state;
            // The last step was below 1e-5, and convergence is quadratic.
            assert!((state.position_m - TRUTH).norm() < 1e-5);
            assert!((state.clock() - clock).abs() < 1e-5);
            assert_eq!(aw_dgn_bt(&rows[..3]), Err(Failure::Observations { rows: 3, needed: 4 }));
            let same: Vec<Row> =
                rows[..5].iter().map(|r| Row { satellite: rows[0].satellite, ..*r }).collect();
            assert!(matches!(aw_dgn_bt(&same), Err(Failure::Coplanar)));
            let mut broken = rows.clone();
            broken[1].value = f64::NAN;
            assert_eq!(aw_dgn_bt(&broken), Err(Failure::NotFinite { row: 1, what: "value" }));
            broken[1] = Row { clock: 7, ..rows[1] };
            assert_eq!(aw_dgn_bt(&broken), Err(Failure::Clock { row: 1 }));
        }
    }

    /// Ranges and range rates by five clocks, 300 rows of each satellite fifty times.
    #[test]
    fn three_hundred_rows_by_five_clocks_give_the_place_and_every_clock() {
        let bias = |clock: usize| 1e4 * clock as f64 - 3e3;
        let all = constellation();
        let rows: Vec<Row> = (0..300)
            .map(|k| {
                let (clock, satellite) = (k % 5, all[(k / 5) % 6]);
                match k % 7 {
                    6 => row(RowKind::RangeRate, satellite, 20.0).with_sigma(0.1),
                    _ => row(RowKind::Range, satellite, bias(clock)).with_sigma(1.0),
                }
            })
            .zip((0..5).cycle())
            .map(|(row, clock)| Row { clock, ..row })
            .collect();
        let solution = aw_dgn_bt(&rows).unwrap();
        // Rounding of ranges of 2e7 m, as above.
        assert!((solution.state.position_m - TRUTH).norm() < 1e-5);
        for clock in 0..5 {
            assert!((solution.state.bias_m(clock).unwrap() - bias(clock)).abs() < 1e-5);
            assert!((solution.state.drift_mps(clock).unwrap() - 20.0).abs() < 1e-5);
        }
    }
}
