//! Gauss-Newton, plain and damped: the one iteration of all least-squares problems here.
//!
//! ```text
//! repeat: dx <- argmin |J dx - e|
//!         mu <- first damping;  xn <- x + mu dx
//!         while xn is not admitted, or costs more than x: mu <- mu/2; if mu < least: jammed
//!         x <- xn
//! until the model says that the step settles it
//! ```
//!
//! A [`Model`] gives rows (observations weighted by their loss, priors without a clock), says where an
//! iterate may go, and when it is done.

use crate::least_squares::LeastSquares;
use crate::point::Point;

/// What is solved: `P` shared unknowns, rows of `W = P + 1` numbers.
pub(crate) trait Model<const P: usize, const W: usize> {
    /// What is kept of a point that was looked at.
    type View: Default;

    /// The rows at a point, linearised and weighted, priors included.
    fn look(&self, at: &Point<P>, view: &mut Self::View, system: &mut LeastSquares<P, W>);

    /// Shortens a step before it is tried.
    fn shorten(&self, _step: &mut Point<P>) {}

    /// Whether the iteration may go to a point, which may be moved to where it may.
    fn admit(&self, _next: &mut Point<P>) -> bool {
        true
    }

    /// What a step means for the iteration.
    fn verdict(&self, step: &Step<P>, system: &LeastSquares<P, W>) -> Verdict;
}

/// Whether to go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    Continue,
    Converged,
    /// There is no solution this way.
    Abandon,
}

/// Which steps are taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Damping {
    /// Damping of the first step.
    pub initial: f64,
    /// Whether each further step starts at 1 rather than at twice the damping before.
    pub restart: bool,
    /// What a step must pass.
    pub test: Test,
    /// Smallest damping.
    pub least: f64,
    /// Most linearisations.
    pub most: usize,
}

/// What a step must pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Test {
    /// Nothing, and its end is not looked at before it is linearised there.
    Unseen,
    /// Nothing.
    None,
    /// It is admitted, and the cost is at most `(1 + tau)` times that before and `floor`.
    Descent { tau: f64, floor: f64 },
}

impl Damping {
    /// Full steps, at most `most`.
    pub const fn plain(most: usize) -> Self {
        Self { initial: 1.0, restart: true, test: Test::Unseen, least: 0.0, most }
    }
}

/// A step that was taken.
pub(crate) struct Step<'a, const P: usize> {
    /// Linearisations so far.
    pub iterations: usize,
    /// Damping first tried, and that applied.
    pub first: f64,
    pub mu: f64,
    /// Halvings because a point was not admitted, and because the cost grew.
    pub refused: u32,
    pub grown: u32,
    /// `|mu dx|`, clock terms included.
    pub length: f64,
    pub from: &'a Point<P>,
    pub to: &'a Point<P>,
    pub cost_before: f64,
    /// Absent where the end was not looked at.
    pub cost_after: Option<f64>,
}

/// Where the iteration converged.
pub(crate) struct Minimum<const P: usize, const W: usize, V> {
    pub point: Point<P>,
    /// What was looked at last: the point, or where the last, short step to it began.
    pub view: V,
    /// Cost of that.
    pub cost: f64,
    pub iterations: usize,
    /// The last linear system, solved.
    pub system: LeastSquares<P, W>,
}

/// Where and why the iteration ended without convergence.
pub(crate) struct Stopped<const P: usize> {
    pub point: Point<P>,
    pub cost: f64,
    pub iterations: usize,
    pub why: Why,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Why {
    Singular,
    /// No damping gives an allowed step; whether the last try was refused rather than too costly.
    Jammed {
        refused: bool,
    },
    TooSlow,
    Abandoned,
}

/// Iterates from `point`. `trace` sees each step.
pub(crate) fn gauss_newton<const P: usize, const W: usize, M: Model<P, W>>(
    model: &M,
    mut point: Point<P>,
    damping: &Damping,
    mut trace: impl FnMut(&Step<P>),
) -> Result<Minimum<P, W, M::View>, Stopped<P>> {
    let look = |at: &Point<P>, (view, system): &mut (M::View, LeastSquares<P, W>)| {
        model.look(at, view, system);
        system.cost()
    };
    let (mut one, mut two) = Default::default();
    let (mut here, mut there) = (&mut one, &mut two);
    let mut cost = look(&point, here);
    let mut mu = damping.initial;
    let (mut step, mut next) = (point.clone(), point.clone());
    for iterations in 1..=damping.most {
        if here.1.solve(&mut step).is_none() {
            return Err(Stopped { point, cost, iterations, why: Why::Singular });
        }
        model.shorten(&mut step);
        if iterations > 1 {
            mu = if damping.restart { 1.0 } else { (2.0 * mu).min(1.0) };
        }
        let (first, mut refused, mut grown) = (mu, 0, 0);
        let cost_after = loop {
            next.set_plus(&point, mu, &step);
            let admitted = model.admit(&mut next);
            match damping.test {
                Test::Unseen => break None,
                Test::None => {
                    let cost_after = look(&next, there);
                    break Some(cost_after);
                }
                Test::Descent { .. } if !admitted => refused += 1,
                Test::Descent { tau, floor } => {
                    let cost_after = look(&next, there);
                    if cost_after <= (1.0 + tau) * cost + floor {
                        break Some(cost_after);
                    }
                    grown += 1;
                }
            }
            mu /= 2.0;
            if mu < damping.least {
                let why = Why::Jammed { refused: !admitted };
                return Err(Stopped { point, cost, iterations, why });
            }
        };
        let length = mu * step.norm();
        let (from, to, cost_before) = (&point, &next, cost);
        let taken = Step {
            iterations,
            first,
            mu,
            refused,
            grown,
            length,
            from,
            to,
            cost_before,
            cost_after,
        };
        trace(&taken);
        let verdict = model.verdict(&taken, &here.1);
        std::mem::swap(&mut point, &mut next);
        if verdict == Verdict::Converged {
            let system = std::mem::take(&mut here.1);
            let (view, cost) = match cost_after {
                Some(cost_after) => (std::mem::take(&mut there.0), cost_after),
                None => (std::mem::take(&mut here.0), cost),
            };
            return Ok(Minimum { point, view, cost, iterations, system });
        }
        if verdict == Verdict::Abandon {
            return Err(Stopped { point, cost, iterations, why: Why::Abandoned });
        }
        match cost_after {
            Some(cost_after) => {
                std::mem::swap(&mut here, &mut there);
                cost = cost_after;
            }
            None => cost = look(&point, here),
        }
    }
    Err(Stopped { point, cost, iterations: damping.most, why: Why::TooSlow })
}
