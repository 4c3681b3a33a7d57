//! What every position solver gives: a solution with its trace, or why there is none.

use super::system::MAX_ROWS;
use nalgebra::{Matrix3, Vector3};
use std::fmt::Write;

/// A place and the clock terms that belong to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Position, m, ECEF.
    pub position_m: Vector3<f64>,
    /// Clock bias `c dt`, m, if pseudoranges were observed.
    pub bias_m: Option<f64>,
    /// Clock drift, m/s, if Dopplers were observed.
    pub drift_mps: Option<f64>,
}

impl State {
    /// The Earth's centre, clock terms not known.
    pub const CENTRE: Self =
        Self { position_m: Vector3::new(0.0, 0.0, 0.0), bias_m: None, drift_mps: None };

    /// The clock term that was observed: bias in m before drift in m/s; 0 if neither was.
    pub fn clock(&self) -> f64 {
        self.bias_m.or(self.drift_mps).unwrap_or(0.0)
    }
}

/// How sure it is that the solution is the receiver's place, and not another one that fits as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ambiguity {
    /// Redundant observations agree with it to their deviations.
    None,
    /// Nothing checks it: as many observations as unknowns, or deviations not known, or a solver
    /// that makes no test.
    Unverified,
    /// Other places explain the observations as well: see the alternatives.
    Several,
}

/// Largest number of alternatives that a solution carries.
const MAX_ALTERNATIVES: usize = 3;

/// Other places that explain the observations, best first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Alternatives([Option<State>; MAX_ALTERNATIVES]);

impl Alternatives {
    /// Adds one, while there is room.
    pub(super) fn push(&mut self, state: State) {
        if let Some(free) = self.0.iter_mut().find(|s| s.is_none()) {
            *free = Some(state);
        }
    }

    /// The places.
    pub fn iter(&self) -> impl Iterator<Item = &State> {
        self.0.iter().flatten()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0[0].is_none()
    }
}

/// A position that a solver found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// The place and its clock terms.
    pub state: State,
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
    /// Other places that fit.
    pub alternatives: Alternatives,
    /// Whether it is the only one.
    pub ambiguity: Ambiguity,
}

impl Solution {
    /// Of a solver that makes no test and looks for no other place.
    pub(super) fn untested(
        state: State,
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
            alternatives: Alternatives::default(),
            ambiguity: Ambiguity::Unverified,
        }
    }
}

/// Why there is no position.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Failure {
    /// Too few or too many observations.
    #[error("{rows} observations given, from {needed} to {MAX_ROWS} can be solved")]
    Observations {
        /// Observations given.
        rows: usize,
        /// Observations needed.
        needed: usize,
    },
    /// An observation, its deviation or its satellite is not a finite number.
    #[error("observation {row}: its {what} is not a finite{} number", if *.what == "deviation" { " positive" } else { "" })]
    NotFinite {
        /// Row, from 0.
        row: usize,
        /// `value`, `deviation`, `satellite position` or `satellite velocity`.
        what: &'static str,
    },
    /// Metres and metres per second cannot be weighed together.
    #[error(
        "pseudoranges and Dopplers together need the standard deviations of both: give each kind its own"
    )]
    NoDeviation,
    /// A satellite is where the receiver is, where its direction is not defined.
    #[error(
        "the satellite of observation {row} is within 1 km of the receiver: its position is wrong"
    )]
    Coincident {
        /// Row, from 0.
        row: usize,
    },
    /// All satellites and the receiver lie in one plane.
    #[error(
        "the satellites lie in one plane through the place that the iteration reached: nothing tells its two sides apart"
    )]
    Coplanar,
    /// The linear system has no unique solution.
    #[error(
        "the geometry at iteration {iterations} is singular: the lines of sight are not independent"
    )]
    Singular {
        /// Place at which this was found.
        state: State,
        /// Linearisations so far.
        iterations: usize,
    },
    /// No damping down to the smallest gives an allowed step.
    #[error(
        "no allowed step reduces the residuals after {iterations} iterations{}",
        if *wall { ": the way is blocked by the altitude wall" } else { "" }
    )]
    Jammed {
        /// Last accepted place.
        state: State,
        /// Linearisations so far.
        iterations: usize,
        /// Whether the altitude wall refused the last try.
        wall: bool,
    },
    /// The allowed number of linearisations did not suffice.
    #[error("no convergence in {iterations} iterations")]
    TooSlow {
        /// Last accepted place.
        state: State,
        /// Linearisations done.
        iterations: usize,
    },
    /// The iteration ran away from the Earth.
    #[error(
        "the iteration ran away: {:.3e} m from the Earth's centre after {iterations} iterations",
        state.position_m.norm()
    )]
    Diverged {
        /// Last place.
        state: State,
        /// Linearisations done.
        iterations: usize,
    },
    /// Steps of decreasing length came to an end before the minimum.
    #[error("stalled after {iterations} iterations: the steps shrank faster than the way ahead")]
    Stalled {
        /// Last place.
        state: State,
        /// Linearisations done.
        iterations: usize,
    },
    /// No step length decreases the cost in floating point.
    #[error("no step length decreases the residuals after {iterations} iterations")]
    NoDecrease {
        /// Last place.
        state: State,
        /// Linearisations done.
        iterations: usize,
    },
    /// The best place found is not near the Earth's surface.
    #[error(
        "the best solution lies {:.0} km from the Earth's centre, and too few observations prove it",
        state.position_m.norm() / 1e3
    )]
    Implausible {
        /// The place.
        state: State,
        /// Linearisations done.
        iterations: usize,
    },
    /// The observations contradict each other.
    #[error(
        "the observations contradict each other: sum of squared residuals {cost:.1}, at most {limit:.1} is believed; one of the satellites or deviations is wrong"
    )]
    Inconsistent {
        /// Best place found.
        state: State,
        /// Its cost, in squared deviations.
        cost: f64,
        /// Largest cost that is believed.
        limit: f64,
        /// Linearisations done.
        iterations: usize,
    },
    /// The solver does not take this observable.
    #[error("{solver} solves pseudoranges only: choose another solver for Dopplers")]
    PseudorangesOnly {
        /// The solver's name.
        solver: &'static str,
    },
}

impl Failure {
    /// The last or best place before the failure, and the linearisations done, if it came to that.
    fn reached(&self) -> Option<(&State, usize)> {
        match self {
            Self::Singular { state, iterations }
            | Self::Jammed { state, iterations, .. }
            | Self::TooSlow { state, iterations }
            | Self::Diverged { state, iterations }
            | Self::Stalled { state, iterations }
            | Self::NoDecrease { state, iterations }
            | Self::Implausible { state, iterations }
            | Self::Inconsistent { state, iterations, .. } => Some((state, *iterations)),
            _ => None,
        }
    }

    /// The last or best place before the failure, if there was one.
    pub fn state(&self) -> Option<&State> {
        self.reached().map(|(state, _)| state)
    }

    /// Linearisations done before the failure.
    pub fn iterations(&self) -> usize {
        self.reached().map_or(0, |(_, iterations)| iterations)
    }

    /// Whether no solver could do anything with the observations.
    pub fn is_of_the_input(&self) -> bool {
        matches!(
            self,
            Self::Observations { .. }
                | Self::NotFinite { .. }
                | Self::NoDeviation
                | Self::PseudorangesOnly { .. }
        )
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
    pub(super) fn by(first: f64, wall: u32, cost: u32) -> Self {
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
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
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
    pub state: State,
    /// Why it was damped.
    pub damped: Damped,
}

/// A trace as comma-separated values, one accepted step a line, with a header.
pub fn trace_csv(steps: &[Step]) -> String {
    let mut csv = String::from(
        "start,step,x_m,y_m,z_m,bias_m,drift_mps,objective_before,objective_after,mu,length_m,damped,wall_halvings,cost_halvings\n",
    );
    let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:?}"));
    for (k, s) in steps.iter().enumerate() {
        let [x, y, z] = s.state.position_m.into();
        let (bias, drift) = (number(s.state.bias_m), number(s.state.drift_mps));
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
