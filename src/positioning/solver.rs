//! Every solver by its name, as on a command line.

use super::aw_dgn_bt::{Damping, iterate};
use super::bancroft::bancroft_gn;
use super::observations::Observations;
use super::outcome::{Failure, Solution, State, Step};
use super::variable_projection::variable_projection;
use std::fmt;
use std::str::FromStr;

/// A position solver that starts without prior knowledge of the place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Solver {
    /// `gn`: Gauss-Newton with full steps.
    Gn,
    /// `adgn:MU0`: adaptively damped, first damping `mu0` in (0, 1], then doubled.
    Adgn(f64),
    /// `adgn-bt`: damped by backtracking from full steps.
    AdgnBt,
    /// `aw-dgn:MU0`: as `adgn:MU0`, with the altitude wall.
    AwDgn(f64),
    /// `aw-dgn-bt`: as `adgn-bt`, with the altitude wall.
    AwDgnBt,
    /// `vp`: variable projection with restarts, the most robust.
    #[default]
    Vp,
    /// `vp-once`: the same without restarts.
    VpOnce,
    /// `bancroft`: Bancroft's algebraic solution refined by Gauss-Newton; pseudoranges only.
    Bancroft,
}

/// The names that [`Solver`] is parsed from.
const NAMES: &str = "gn, adgn:MU0, adgn-bt, aw-dgn:MU0, aw-dgn-bt, vp, vp-once, bancroft";

/// A name that is not that of a solver.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SolverNameError {
    /// No solver is called so.
    #[error("no solver is called '{name}': choose one of {NAMES}")]
    Unknown {
        /// The name.
        name: String,
    },
    /// The number after the colon is missing, superfluous or out of range.
    #[error("solver '{name}': {right}")]
    Parameter {
        /// The name.
        name: String,
        /// What would be right.
        right: &'static str,
    },
}

impl Solver {
    /// Solves from the Earth's centre, or from where the solver's own rule starts. `trace` sees each
    /// accepted step.
    ///
    /// # Errors
    /// [`Failure`] names the cause.
    pub fn solve<O: Observations>(
        &self,
        observations: &O,
        trace: impl FnMut(&Step),
    ) -> Result<Solution, Failure> {
        let damping = match *self {
            Self::Gn => Damping::GN,
            Self::Adgn(mu0) => Damping::adgn(mu0),
            Self::AdgnBt => Damping::ADGN_BT,
            Self::AwDgn(mu0) => Damping::aw_dgn(mu0),
            Self::AwDgnBt => Damping::AW_DGN_BT,
            Self::Vp => return variable_projection(observations, true, trace),
            Self::VpOnce => return variable_projection(observations, false, trace),
            Self::Bancroft => return bancroft_gn(observations, trace),
        };
        iterate(observations, &damping, &State::CENTRE, trace)
    }
}

impl fmt::Display for Solver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gn => write!(f, "gn"),
            Self::Adgn(mu0) => write!(f, "adgn:{mu0}"),
            Self::AdgnBt => write!(f, "adgn-bt"),
            Self::AwDgn(mu0) => write!(f, "aw-dgn:{mu0}"),
            Self::AwDgnBt => write!(f, "aw-dgn-bt"),
            Self::Vp => write!(f, "vp"),
            Self::VpOnce => write!(f, "vp-once"),
            Self::Bancroft => write!(f, "bancroft"),
        }
    }
}

impl FromStr for Solver {
    type Err = SolverNameError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, parameter) = match text.split_once(':') {
            Some((name, parameter)) => (name, Some(parameter)),
            None => (text, None),
        };
        let wrong = |right| SolverNameError::Parameter { name: text.to_owned(), right };
        let mu0 = || match parameter.and_then(|p| p.parse().ok()) {
            Some(mu0) if mu0 > 0.0 && mu0 <= 1.0 => Ok(mu0),
            _ => Err(wrong("give the first damping in (0, 1] after a colon, as in adgn:0.08")),
        };
        let solver = match name {
            "adgn" => return Ok(Self::Adgn(mu0()?)),
            "aw-dgn" => return Ok(Self::AwDgn(mu0()?)),
            "gn" => Self::Gn,
            "adgn-bt" => Self::AdgnBt,
            "aw-dgn-bt" => Self::AwDgnBt,
            "vp" => Self::Vp,
            "vp-once" => Self::VpOnce,
            "bancroft" => Self::Bancroft,
            _ => return Err(SolverNameError::Unknown { name: text.to_owned() }),
        };
        match parameter {
            None => Ok(solver),
            Some(_) => Err(wrong("it takes no number")),
        }
    }
}
