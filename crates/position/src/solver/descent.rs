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
//! The covariance of the place from `m` averaged epochs of deviation `sigma` is
//! `sigma^2/m (H^T H)^-1`: give the [mean](mean_of_epochs) and the deviation `sigma/sqrt(m)`.

use super::observations::Observations;
use super::outcome::{Damped, Failure, Solution, State, Step};
use super::system::{MAX_ROWS, System, unseen};
use nalgebra::{Vector3, Vector5};

/// Which way a step goes, `Q H^T e`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
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
    pub direction: Direction,
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
    pub const fn new(direction: Direction, rule: StepRule) -> Self {
        Self { direction, rule, tolerance_m: 1e-3, max_iterations: 200_000 }
    }

    /// Minimises from `start`; clock terms that it does not give are 0. The count of iterations is one
    /// of steps. Allocates nothing.
    ///
    /// # Errors
    /// [`Failure::Stalled`], [`Failure::NoDecrease`], [`Failure::Diverged`], [`Failure::TooSlow`], or
    /// what is wrong with the observations.
    pub fn solve<O: Observations>(
        &self,
        observations: &O,
        start: &State,
        trace: impl FnMut(&Step),
    ) -> Result<Solution, Failure> {
        match observations.rows().iter().sum() {
            0..=16 => self.run::<O, 16>(observations, start, trace),
            17..=64 => self.run::<O, 64>(observations, start, trace),
            _ => self.run::<O, MAX_ROWS>(observations, start, trace),
        }
    }

    fn run<O: Observations, const N: usize>(
        &self,
        observations: &O,
        start: &State,
        mut trace: impl FnMut(&Step),
    ) -> Result<Solution, Failure> {
        let mut system = System::<O, N>::new(observations)?;
        let (mut seen, mut right) = (unseen::<N>(), [0.0; N]);
        let mut x = join(&start.position_m, system.clocks(start));
        let mut last: Option<(Vector5<f64>, Vector5<f64>)> = None;
        for iterations in 0..=self.max_iterations {
            let (position, clocks) = split(&x);
            let state = system.state(position, clocks);
            system.see(&position, &mut seen);
            let cost = system.residuals(&seen, &clocks, &mut right);
            if !(x.norm() < FAR && cost.is_finite()) && iterations > 0 {
                return Err(Failure::Diverged { state, iterations });
            }
            let Some((dr, dc)) = system.step(&seen, &right) else {
                return Err(system.diagnose(state, iterations));
            };
            let gauss_newton = join(&dr, dc);
            if gauss_newton.norm() < self.tolerance_m {
                return Ok(Solution::untested(state, cost, system.covariance(), iterations));
            }
            let (gradient, diagonal) = system.gradient(&seen, &right);
            let direction = match self.direction {
                Direction::Gradient => gradient,
                // A clock term that is not observed has no gradient either.
                Direction::Diagonal => {
                    gradient.zip_map(&diagonal, |g, d| g / d.max(f64::MIN_POSITIVE))
                }
                Direction::GaussNewton => gauss_newton,
            };
            let mut cost_at = |x: &Vector5<f64>| {
                let (position, clocks) = split(x);
                system.see(&position, &mut seen);
                system.residuals(&seen, &clocks, &mut right)
            };
            let (alpha, tries) = match self.rule {
                StepRule::Constant(alpha) => (alpha, 0),
                StepRule::Geometric { first, ratio } => {
                    let alpha = first * ratio.powi(iterations as i32);
                    if alpha * direction.norm() / (1.0 - ratio) < self.tolerance_m * first {
                        return Err(Failure::Stalled { state, iterations });
                    }
                    (alpha, 0)
                }
                StepRule::Backtracking { first, ratio } => {
                    let length = |tries: u32| first * ratio.powi(tries as i32);
                    let decreases = |tries: &u32| cost_at(&(x + length(*tries) * direction)) < cost;
                    let tries = (0..MAX_TRIES).find(decreases);
                    let tries = tries.ok_or(Failure::NoDecrease { state, iterations })?;
                    (length(tries), tries)
                }
                StepRule::BarzilaiBorwein => match &last {
                    Some((s, before)) => (s.norm_squared() / s.dot(&(before - direction)), 0),
                    None => (1.0 / diagonal.sum(), 0),
                },
            };
            let step = alpha * direction;
            last = Some((step, direction));
            x += step;
            let (position, clocks) = split(&x);
            trace(&Step {
                start: 0,
                mu: alpha,
                length: step.norm(),
                objective_before: cost,
                objective_after: cost_at(&x),
                state: system.state(position, clocks),
                damped: if tries > 0 { Damped::Cost(tries) } else { Damped::by(alpha, 0, 0) },
            });
        }
        let (position, clocks) = split(&x);
        let state = system.state(position, clocks);
        Err(Failure::TooSlow { state, iterations: self.max_iterations })
    }
}

/// Position and clocks in one vector.
fn join(position: &Vector3<f64>, [bias, drift]: [f64; 2]) -> Vector5<f64> {
    Vector5::new(position.x, position.y, position.z, bias, drift)
}

fn split(x: &Vector5<f64>) -> (Vector3<f64>, [f64; 2]) {
    (x.fixed_rows::<3>(0).into_owned(), [x[3], x[4]])
}

/// Mean of the observations of several epochs, row by row, and the number of epochs: for satellites that
/// do not move meanwhile. (Of moving ones average residuals, not pseudoranges.)
pub fn mean_of_epochs<'a>(epochs: impl Iterator<Item = &'a [f64]>, mean: &mut [f64]) -> usize {
    mean.fill(0.0);
    let mut count = 0;
    for epoch in epochs {
        mean.iter_mut().zip(epoch).for_each(|(mean, y)| *mean += y);
        count += 1;
    }
    mean.iter_mut().for_each(|mean| *mean /= count as f64);
    count
}
