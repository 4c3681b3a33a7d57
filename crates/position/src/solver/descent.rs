//! The generalised gradient family: `x <- x + alpha_k Q H^T e`.
//!
//! Kreutz-Delgado, "Nonlinear least-squares and generalized gradient descent" (lecture notes on GPS
//! positioning). `e` are the weighted residuals, `H` their Jacobian by `x = (r, clocks)`, `Q` positive
//! definite: the identity (gradient descent), `(H^T H)^-1` (Gauss-Newton) or its diagonal (Jacobi).
//!
//! - Gradient descent with a constant step converges for `alpha < 2/lmax(H^T H)`, fastest for
//!   `2/(lmin + lmax)`, with the error shrinking by `(kappa - 1)/(kappa + 1)` a step; `lmax` is near the
//!   number of satellites, so that a step length must be chosen by it.
//! - A geometric sequence of steps can go no farther than `alpha_0/(1 - beta)` gradients: where that ends
//!   before the minimum, the outcome is *stalled*, never converged.
//! - Backtracking needs a strict decrease of the cost, which ends in floating point: after 60 tries the
//!   outcome is *no decrease*.
//! - Converged means that the Gauss-Newton step, the way that is left, is shorter than the tolerance:
//!   a small gradient says nothing in a bad geometry.
//!
//! The covariance of the place from `m` averaged epochs of standard deviation `sigma` is
//! `sigma^2/m (H^T H)^-1`: give the means and the standard deviation `sigma/sqrt(m)`. (Of satellites that move
//! meanwhile average residuals, not pseudoranges.)

use super::failure::Failure;
use super::point_solution::{Damped, Iteration, PointSolution};
use crate::least_squares::{LeastSquares, LinearRow};
use crate::place::Place;
use crate::point::Point;
use crate::problem::{Problem, Row};
use nalgebra::Vector3;

/// Which way a step goes, `Q H^T e`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DescentDirection {
    /// The negative gradient of half the cost: `Q` is the identity.
    Gradient,
    /// The gradient divided by the diagonal of `H^T H`.
    Diagonal,
    /// `Q = (H^T H)^-1`.
    GaussNewton,
}

/// How long steps are, in units of the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepRule {
    /// Always `alpha`.
    Constant(f64),
    /// `first * ratio^k` at step k.
    Geometric {
        /// Length of the first step.
        first: f64,
        /// From one step to the next, below 1.
        ratio: f64,
    },
    /// `first * ratio^j` with the smallest j for which the cost decreases.
    Backtracking {
        /// Length that is tried first.
        first: f64,
        /// From one try to the next, below 1.
        ratio: f64,
    },
    /// `|s|^2 / s.y` of the last step `s` and the change `y` of the gradient (Barzilai and Borwein 1988);
    /// the first step has the inverse of the trace of `H^T H`.
    BarzilaiBorwein,
}

/// A method of the family.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Descent {
    /// Which way.
    pub direction: DescentDirection,
    /// How far.
    pub rule: StepRule,
    /// Converged when the Gauss-Newton step is shorter than this, m.
    pub tolerance_m: f64,
    /// Steps after which it is too slow.
    pub max_iterations: usize,
}

/// Tries of a backtracking step before there is no decrease.
const MAX_TRIES: u32 = 60;
/// Farther from the Earth's centre, m, than anything that is solved here.
const FAR: f64 = 1e10;

impl Descent {
    /// To a millimetre, in at most 200 000 steps.
    pub const fn new(direction: DescentDirection, rule: StepRule) -> Self {
        Self { direction, rule, tolerance_m: 1e-3, max_iterations: 200_000 }
    }

    /// Minimises from `start`; clock terms that it does not give are 0. The count of iterations is one
    /// of steps.
    ///
    /// # Errors
    /// [`Failure::Stalled`], [`Failure::NoDecrease`], [`Failure::Diverged`], [`Failure::TooSlow`], or
    /// what is wrong with the observations.
    pub fn solve(
        &self,
        rows: &[Row],
        start: &Place,
        mut trace: impl FnMut(&Iteration),
    ) -> Result<PointSolution, Failure> {
        let problem = Problem::new(rows)?;
        let mut system = LeastSquares::<3, 4>::default();
        let mut spare = LeastSquares::default();
        let cost_at = |at: &Point<3>, system: &mut LeastSquares<3, 4>| {
            problem.look(at, system, |_| ());
            system.cost()
        };
        let mut at = problem.point(start);
        let mut cost = cost_at(&at, &mut system);
        let mut last: Option<(Point<3>, Point<3>)> = None;
        for iterations in 0..=self.max_iterations {
            let state = || problem.state(&at);
            if !(at.norm() < FAR && cost.is_finite()) && iterations > 0 {
                return Err(Failure::Diverged { state: state(), iterations });
            }
            let (gradient, diagonal) = gradient(&system, problem.zero());
            let mut gauss_newton = problem.zero();
            if system.solve(&mut gauss_newton).is_none() {
                return Err(problem.diagnose(&at, iterations));
            }
            if gauss_newton.norm() < self.tolerance_m {
                let covariance = system.covariance();
                return Ok(PointSolution::untested(state(), cost, covariance, iterations));
            }
            let direction = match self.direction {
                DescentDirection::Gradient => gradient,
                DescentDirection::Diagonal => divided(gradient, &diagonal),
                DescentDirection::GaussNewton => gauss_newton,
            };
            let (alpha, tries) = match self.rule {
                StepRule::Constant(alpha) => (alpha, 0),
                StepRule::Geometric { first, ratio } => {
                    let alpha = first * ratio.powi(iterations as i32);
                    if alpha * direction.norm() / (1.0 - ratio) < self.tolerance_m * first {
                        return Err(Failure::Stalled { state: state(), iterations });
                    }
                    (alpha, 0)
                }
                StepRule::Backtracking { first, ratio } => {
                    let length = |tries: u32| first * ratio.powi(tries as i32);
                    let decreases = |tries: &u32| {
                        cost_at(&at.plus(length(*tries), &direction), &mut spare) < cost
                    };
                    let Some(tries) = (0..MAX_TRIES).find(decreases) else {
                        return Err(Failure::NoDecrease { state: state(), iterations });
                    };
                    (length(tries), tries)
                }
                StepRule::BarzilaiBorwein => match &last {
                    Some((s, before)) => (s.dot(s) / s.dot(&before.plus(-1.0, &direction)), 0),
                    None => {
                        (1.0 / diagonal.clocks.iter().fold(diagonal.x.sum(), |sum, d| sum + d), 0)
                    }
                },
            };
            let step = problem.zero().plus(alpha, &direction);
            let next = at.plus(1.0, &step);
            let cost_after = cost_at(&next, &mut spare);
            trace(&Iteration {
                start: 0,
                mu: alpha,
                length: step.norm(),
                objective_before: cost,
                objective_after: cost_after,
                state: problem.state(&next),
                damped: if tries > 0 { Damped::Cost(tries) } else { Damped::by(alpha, 0, 0) },
            });
            last = Some((step, direction));
            std::mem::swap(&mut system, &mut spare);
            (at, cost) = (next, cost_after);
        }
        Err(Failure::TooSlow { state: problem.state(&at), iterations: self.max_iterations })
    }
}

/// `H^T e` and the diagonal of `H^T H` of the weighted rows, added to `zero`.
fn gradient(system: &LeastSquares<3, 4>, zero: Point<3>) -> (Point<3>, Point<3>) {
    let (mut gradient, mut diagonal) = (zero.clone(), zero);
    for LinearRow { row: [x, y, z, e], weight, term } in system.rows() {
        let by = Vector3::new(*x, *y, *z);
        gradient.x += by * *e;
        diagonal.x += by.component_mul(&by);
        if let Some(term) = *term {
            gradient.clocks[term] += weight * e;
            diagonal.clocks[term] += weight * weight;
        }
    }
    (gradient, diagonal)
}

/// A gradient divided by the diagonal; a clock term that is not observed has no gradient either.
fn divided(mut gradient: Point<3>, diagonal: &Point<3>) -> Point<3> {
    let divide = |g: &mut f64, d: &f64| *g /= d.max(f64::MIN_POSITIVE);
    gradient.x.iter_mut().zip(&diagonal.x).for_each(|(g, d)| divide(g, d));
    gradient.clocks.iter_mut().zip(&diagonal.clocks).for_each(|(g, d)| divide(g, d));
    gradient
}
