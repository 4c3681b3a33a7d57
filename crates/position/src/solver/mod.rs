//! Every solver by its name, as on a command line.

pub mod aw_dgn_bt;
pub mod bancroft;
mod belief;
pub mod descent;
mod gram_schmidt;
pub mod model;
pub mod observations;
pub mod outcome;
mod system;
pub mod variable_projection;

use aw_dgn_bt::{Damping, iterate};
use bancroft::bancroft_gn;
use descent::{Descent, Direction, StepRule};
use observations::Observations;
use outcome::{Failure, Solution, State, Step};
use std::fmt;
use std::str::FromStr;
use variable_projection::variable_projection;

/// A position solver that starts without prior knowledge of the place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Solver {
    /// `best`: `bancroft` for pseudoranges alone, and `vp` for all else and where that fails.
    #[default]
    Best,
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
    /// `vp`: variable projection with restarts.
    Vp,
    /// `vp-once`: the same without restarts.
    VpOnce,
    /// `bancroft`: Bancroft's algebraic solution refined by Gauss-Newton; pseudoranges only.
    Bancroft,
    /// `gd:ALPHA`, `gd-geometric:BETA`, `gd-bt`, `gd-bb`, `diagonal:ALPHA`, `gn:ALPHA`,
    /// `gn-geometric:BETA`, `gn-bt`: a method of the generalised gradient family.
    Descent(Descent),
}

/// The names that [`Solver`] is parsed from.
pub const SOLVER_NAMES: &str = "best, gn, adgn:MU0, adgn-bt, aw-dgn:MU0, aw-dgn-bt, vp, vp-once, bancroft, gd:ALPHA, gd-geometric:BETA, gd-bt, gd-bb, diagonal:ALPHA, gn:ALPHA, gn-geometric:BETA, gn-bt";

/// First step of a geometric sequence of gradient steps: stable with up to six satellites.
const GRADIENT_FIRST: f64 = 0.3;

/// A name that is not that of a solver.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SolverNameError {
    /// No solver is called so.
    #[error("no solver is called '{name}': choose one of {SOLVER_NAMES}")]
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
    /// accepted step. Allocates nothing.
    ///
    /// # Errors
    /// [`Failure`] names the cause.
    pub fn solve<O: Observations>(
        &self,
        observations: &O,
        trace: impl FnMut(&Step),
    ) -> Result<Solution, Failure> {
        self.solve_by(observations, trace).map(|(_, solution)| solution)
    }

    /// The same, with the solver that did it: `best` takes one or the other.
    ///
    /// # Errors
    /// As [`Solver::solve`].
    pub fn solve_by<O: Observations>(
        &self,
        observations: &O,
        mut trace: impl FnMut(&Step),
    ) -> Result<(Self, Solution), Failure> {
        if *self == Self::Best {
            return best(observations, trace);
        }
        self.run(observations, &mut trace).map(|solution| (*self, solution))
    }

    fn run<O: Observations>(
        &self,
        observations: &O,
        trace: &mut impl FnMut(&Step),
    ) -> Result<Solution, Failure> {
        let damping = match *self {
            Self::Gn => Damping::GN,
            Self::Adgn(mu0) => Damping::adgn(mu0),
            Self::AdgnBt => Damping::ADGN_BT,
            Self::AwDgn(mu0) => Damping::aw_dgn(mu0),
            Self::AwDgnBt => Damping::AW_DGN_BT,
            Self::Best | Self::Vp => return variable_projection(observations, true, trace),
            Self::VpOnce => return variable_projection(observations, false, trace),
            Self::Bancroft => return bancroft_gn(observations, trace),
            Self::Descent(descent) => {
                return descent.solve(observations, &State::CENTRE, trace);
            }
        };
        iterate(observations, &damping, &State::CENTRE, trace)
    }
}

impl Solver {
    /// Its name without a parameter, such as `aw-dgn-bt` or `adgn`.
    pub fn name(&self) -> &'static str {
        let text = self.to_string();
        let bare = |name: &'static str| name.split(':').next().unwrap_or(name);
        let mut names = SOLVER_NAMES.split(", ").map(bare);
        names.find(|name| text.split(':').next() == Some(name)).unwrap_or("unnamed")
    }
}

/// Bancroft's solution for pseudoranges alone; variable projection for all else and where that fails.
fn best<O: Observations>(
    observations: &O,
    mut trace: impl FnMut(&Step),
) -> Result<(Solver, Solution), Failure> {
    let mut spent = 0;
    if observations.rows()[1] == 0 {
        match bancroft_gn(observations, &mut trace) {
            Err(cause) if !cause.is_of_the_input() => spent = cause.iterations(),
            other => return other.map(|solution| (Solver::Bancroft, solution)),
        }
    }
    let solution = variable_projection(observations, true, trace)?;
    let iterations = spent + solution.iterations;
    Ok((Solver::Vp, Solution { iterations, ..solution }))
}

impl fmt::Display for Solver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Best => write!(f, "best"),
            Self::Gn => write!(f, "gn"),
            Self::Adgn(mu0) => write!(f, "adgn:{mu0}"),
            Self::AdgnBt => write!(f, "adgn-bt"),
            Self::AwDgn(mu0) => write!(f, "aw-dgn:{mu0}"),
            Self::AwDgnBt => write!(f, "aw-dgn-bt"),
            Self::Vp => write!(f, "vp"),
            Self::VpOnce => write!(f, "vp-once"),
            Self::Bancroft => write!(f, "bancroft"),
            Self::Descent(Descent { direction, rule, .. }) => {
                let way = match direction {
                    Direction::Gradient => "gd",
                    Direction::Diagonal => "diagonal",
                    Direction::GaussNewton => "gn",
                };
                match rule {
                    StepRule::Constant(alpha) => write!(f, "{way}:{alpha}"),
                    StepRule::Geometric { ratio, .. } => write!(f, "{way}-geometric:{ratio}"),
                    StepRule::Backtracking { .. } => write!(f, "{way}-bt"),
                    StepRule::BarzilaiBorwein => write!(f, "{way}-bb"),
                }
            }
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
        let number = |largest: f64, right| match parameter.and_then(|p| p.parse().ok()) {
            Some(number) if number > 0.0 && number <= largest => Ok(number),
            _ => Err(wrong(right)),
        };
        let mu0 = || number(1.0, "give the first damping in (0, 1] after a colon, as in adgn:0.08");
        let alpha = || number(2.5, "give the step length in (0, 2.5] after a colon, as in gd:0.1");
        let beta =
            || number(0.999_999, "give the ratio of steps, below 1, as in gd-geometric:0.99");
        let family = |direction, rule| Self::Descent(Descent::new(direction, rule));
        let solver = match (name, parameter) {
            ("adgn", _) => return Ok(Self::Adgn(mu0()?)),
            ("aw-dgn", _) => return Ok(Self::AwDgn(mu0()?)),
            ("gd", _) => return Ok(family(Direction::Gradient, StepRule::Constant(alpha()?))),
            ("diagonal", _) => {
                return Ok(family(Direction::Diagonal, StepRule::Constant(alpha()?)));
            }
            ("gn", Some(_)) => {
                return Ok(family(Direction::GaussNewton, StepRule::Constant(alpha()?)));
            }
            ("gd-geometric", _) => {
                let rule = StepRule::Geometric { first: GRADIENT_FIRST, ratio: beta()? };
                return Ok(family(Direction::Gradient, rule));
            }
            ("gn-geometric", _) => {
                let rule = StepRule::Geometric { first: 1.0, ratio: beta()? };
                return Ok(family(Direction::GaussNewton, rule));
            }
            ("gd-bt", _) => family(Direction::Gradient, HALVING),
            ("gn-bt", _) => family(Direction::GaussNewton, HALVING),
            ("gd-bb", _) => family(Direction::Gradient, StepRule::BarzilaiBorwein),
            ("best", _) => Self::Best,
            ("gn", None) => Self::Gn,
            ("adgn-bt", _) => Self::AdgnBt,
            ("aw-dgn-bt", _) => Self::AwDgnBt,
            ("vp", _) => Self::Vp,
            ("vp-once", _) => Self::VpOnce,
            ("bancroft", _) => Self::Bancroft,
            _ => return Err(SolverNameError::Unknown { name: text.to_owned() }),
        };
        match parameter {
            None => Ok(solver),
            Some(_) => Err(wrong("it takes no number")),
        }
    }
}

/// The backtracking of the lecture notes.
const HALVING: StepRule = StepRule::Backtracking { first: 1.0, ratio: 0.5 };

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_parsed_and_written_alike_and_wrong_ones_say_what_is_right() {
        for name in SOLVER_NAMES.split(", ") {
            let name = name.replace("MU0", "0.08").replace("ALPHA", "0.25").replace("BETA", "0.99");
            assert_eq!(name.parse::<Solver>().unwrap().to_string(), name);
        }
        let refused = |name: &str| name.parse::<Solver>().unwrap_err().to_string();
        assert!(refused("newton").ends_with(SOLVER_NAMES));
        for name in ["adgn", "adgn:0", "adgn:1.5", "aw-dgn:x", "gd", "gd-geometric:1", "adgn:nan"] {
            assert!(refused(name).contains("after a colon") || refused(name).contains("ratio"));
        }
        assert_eq!(refused("vp:2"), "solver 'vp:2': it takes no number");
    }
}
