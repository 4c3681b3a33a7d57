//! What every position solver gives, and the trace of how it came there.

use crate::gauss_newton;
use crate::place::Place;
use crate::problem::Problem;
use nalgebra::Matrix3;
use std::fmt::Write;

/// How sure it is that the solution is the receiver's place, and not another one that fits as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ambiguity {
    /// Redundant observations agree with it to their standard deviations.
    None,
    /// Nothing checks it: as many observations as unknowns, or deviations not known, or a solver
    /// that makes no test.
    Unverified,
    /// Other places explain the observations as well: see the alternatives.
    Several,
}

/// A position that a solver found.
#[derive(Clone, Debug, PartialEq)]
pub struct PointSolution {
    /// The place and its clock terms.
    pub state: Place,
    /// Sum of squared residuals, each over its deviation (in m^2 or (m/s)^2 if that is not known).
    pub cost: f64,
    /// Covariance of the position, m^2, ECEF: from the deviations of the observations, or for
    /// deviations of 1 if they are not known.
    pub covariance: Matrix3<f64>,
    /// Linearisations that led to it, failed attempts included.
    pub iterations: usize,
    /// Further linearisations, spent looking for other solutions.
    pub search_iterations: usize,
    /// Starts after the first that were tried on the way.
    pub restarts: usize,
    /// Other places that fit, best first.
    pub alternatives: Vec<Place>,
    /// Whether it is the only one.
    pub ambiguity: Ambiguity,
}

impl PointSolution {
    /// Of a solver that makes no test and looks for no other place.
    pub(crate) fn untested(
        state: Place,
        cost: f64,
        covariance: Matrix3<f64>,
        iterations: usize,
    ) -> Self {
        Self {
            state,
            cost,
            covariance,
            iterations,
            search_iterations: 0,
            restarts: 0,
            alternatives: Vec::new(),
            ambiguity: Ambiguity::Unverified,
        }
    }
}

/// Why a step was not the full one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damped {
    /// The full step.
    No,
    /// The solver's schedule of step lengths.
    Schedule,
    /// Halved this many times because the cost grew.
    Cost(u32),
    /// Halved this many times because the place lay above the altitude wall.
    Wall(u32),
    /// Halved for both reasons.
    Both {
        /// Halvings because the place lay above the altitude wall.
        wall: u32,
        /// Halvings because the cost grew.
        cost: u32,
    },
    /// Brought back to the altitude wall, and halved this many times because the cost grew.
    Projected(u32),
}

impl Damped {
    /// By the halvings for each reason, from a first damping of `first`.
    pub(crate) fn by(first: f64, wall: u32, cost: u32) -> Self {
        match (wall, cost) {
            (0, 0) if first == 1.0 => Self::No,
            (0, 0) => Self::Schedule,
            (0, cost) => Self::Cost(cost),
            (wall, 0) => Self::Wall(wall),
            (wall, cost) => Self::Both { wall, cost },
        }
    }

    /// The reason in one word, with the halvings at the wall and by the cost.
    fn words(self) -> (&'static str, u32, u32) {
        match self {
            Self::No => ("full", 0, 0),
            Self::Schedule => ("schedule", 0, 0),
            Self::Cost(cost) => ("cost", 0, cost),
            Self::Wall(wall) => ("wall", wall, 0),
            Self::Both { wall, cost } => ("both", wall, cost),
            Self::Projected(cost) => ("projected", 0, cost),
        }
    }
}

/// One accepted step of an iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct Iteration {
    /// Number of the start it belongs to, from 0: above 0 are restarts.
    pub start: usize,
    /// Damping (or step length) `mu`.
    pub mu: f64,
    /// Length of the applied step `|mu dx|`, m (clock terms included where the solver carries them).
    pub length: f64,
    /// Sum of squared weighted residuals before the step.
    pub objective_before: f64,
    /// The same after it.
    pub objective_after: f64,
    /// Place after the step.
    pub state: Place,
    /// Why it was damped.
    pub damped: Damped,
}

impl Iteration {
    /// A step of Gauss-Newton on a problem, whose end was looked at.
    pub(crate) fn of(problem: &Problem, step: &gauss_newton::Step<3>) -> Self {
        Self {
            start: 0,
            mu: step.mu,
            length: step.length,
            objective_before: step.cost_before,
            objective_after: step.cost_after.unwrap_or(step.cost_before),
            state: problem.state(step.to),
            damped: Damped::by(step.first, step.refused, step.grown),
        }
    }
}

/// A trace as comma-separated values, one accepted step a line, with a header; of several
/// clocks the terms of the first.
pub fn trace_csv(steps: &[Iteration]) -> String {
    let mut csv = String::from(
        "start,step,x_m,y_m,z_m,bias_m,drift_mps,objective_before,objective_after,mu,length_m,damped,wall_halvings,cost_halvings\n",
    );
    let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:?}"));
    for (k, s) in steps.iter().enumerate() {
        let [x, y, z] = s.state.position_m.into();
        let (bias, drift) = (number(s.state.bias_m(0)), number(s.state.drift_mps(0)));
        let (before, after) = (s.objective_before, s.objective_after);
        let (reason, wall, cost) = s.damped.words();
        // Writing to a string does not fail.
        let _ = writeln!(
            csv,
            "{},{},{x:?},{y:?},{z:?},{bias},{drift},{before:?},{after:?},{:?},{:?},{reason},{wall},{cost}",
            s.start,
            k + 1,
            s.mu,
            s.length
        );
    }
    csv
}
