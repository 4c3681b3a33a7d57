//! Why a position solver gives no solution.

use crate::place::Place;

/// Why there is no position.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Failure {
    /// Too few observations.
    #[error("{rows} observations given, at least {needed} are needed")]
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
    /// A clock's index is beyond what so few observations can determine.
    #[error("observation {row}: clocks are numbered from 0, and each needs an observation")]
    Clock {
        /// Row, from 0.
        row: usize,
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
        state: Place,
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
        state: Place,
        /// Linearisations so far.
        iterations: usize,
        /// Whether the altitude wall refused the last try.
        wall: bool,
    },
    /// The allowed number of linearisations did not suffice.
    #[error("no convergence in {iterations} iterations")]
    TooSlow {
        /// Last accepted place.
        state: Place,
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
        state: Place,
        /// Linearisations done.
        iterations: usize,
    },
    /// Steps of decreasing length came to an end before the minimum.
    #[error("stalled after {iterations} iterations: the steps shrank faster than the way ahead")]
    Stalled {
        /// Last place.
        state: Place,
        /// Linearisations done.
        iterations: usize,
    },
    /// No step length decreases the cost in floating point.
    #[error("no step length decreases the residuals after {iterations} iterations")]
    NoDecrease {
        /// Last place.
        state: Place,
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
        state: Place,
        /// Linearisations done.
        iterations: usize,
    },
    /// The observations contradict each other.
    #[error(
        "the observations contradict each other: sum of squared residuals {cost:.1}, at most {limit:.1} is believed; one of the satellites or deviations is wrong"
    )]
    Inconsistent {
        /// Best place found.
        state: Place,
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
    /// The solver does not take several clocks.
    #[error("{solver} solves pseudoranges by one clock: choose another solver for several systems")]
    OneClockOnly {
        /// The solver's name.
        solver: &'static str,
    },
}

impl Failure {
    /// The last or best place before the failure, and the linearisations done, if it came to that.
    fn reached(&self) -> Option<(&Place, usize)> {
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
    pub fn state(&self) -> Option<&Place> {
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
                | Self::Clock { .. }
                | Self::NoDeviation
                | Self::PseudorangesOnly { .. }
                | Self::OneClockOnly { .. }
        )
    }
}
