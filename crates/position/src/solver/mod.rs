//! Every solver by its name, as on a command line.

pub mod aw_dgn_bt;
pub mod bancroft;
pub mod descent;
pub mod failure;
mod plausibility;
pub mod point_solution;
pub mod variable_projection;

use crate::place::Place;
use crate::problem::{Row, RowKind};

use aw_dgn_bt::{Damping, iterate};
use bancroft::bancroft_gn;
use descent::{Descent, DescentDirection, StepRule};
use failure::Failure;
use point_solution::{Iteration, PointSolution};
use std::fmt;
use std::str::FromStr;
use variable_projection::variable_projection;

/// A position solver that starts without prior knowledge of the place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Solver {
    /// `best`: `bancroft` for pseudoranges alone by one clock, and `vp` for all else and where that fails.
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
    #[default]
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
    /// accepted step.
    ///
    /// # Errors
    /// [`Failure`] names the cause.
    pub fn solve(
        &self,
        rows: &[Row],
        trace: impl FnMut(&Iteration),
    ) -> Result<PointSolution, Failure> {
        self.solve_by(rows, trace).map(|(_, solution)| solution)
    }

    /// The same, with the solver that did it: `best` takes one or the other.
    ///
    /// # Errors
    /// As [`Solver::solve`].
    pub fn solve_by(
        &self,
        rows: &[Row],
        mut trace: impl FnMut(&Iteration),
    ) -> Result<(Self, PointSolution), Failure> {
        if *self == Self::Best {
            return best(rows, trace);
        }
        self.run(rows, &mut trace).map(|solution| (*self, solution))
    }

    fn run(
        &self,
        rows: &[Row],
        trace: &mut impl FnMut(&Iteration),
    ) -> Result<PointSolution, Failure> {
        let centre = Place::centre();
        match *self {
            Self::Gn => iterate(rows, &Damping::GN, &centre, trace),
            Self::Adgn(mu0) => iterate(rows, &Damping::adgn(mu0), &centre, trace),
            Self::AdgnBt => iterate(rows, &Damping::ADGN_BT, &centre, trace),
            Self::AwDgn(mu0) => iterate(rows, &Damping::aw_dgn(mu0), &centre, trace),
            Self::AwDgnBt => iterate(rows, &Damping::AW_DGN_BT, &centre, trace),
            Self::Best | Self::Vp => variable_projection(rows, true, trace),
            Self::VpOnce => variable_projection(rows, false, trace),
            Self::Bancroft => bancroft_gn(rows, trace),
            Self::Descent(descent) => descent.solve(rows, &centre, trace),
        }
    }

    /// Its name without a parameter, such as `aw-dgn-bt` or `adgn`.
    pub fn name(&self) -> &'static str {
        let text = self.to_string();
        let bare = |name: &'static str| name.split(':').next().unwrap_or(name);
        let mut names = SOLVER_NAMES.split(", ").map(bare);
        names.find(|name| text.split(':').next() == Some(name)).unwrap_or("unnamed")
    }
}

/// Bancroft's solution for pseudoranges alone; variable projection for all else and where that fails.
fn best(
    rows: &[Row],
    mut trace: impl FnMut(&Iteration),
) -> Result<(Solver, PointSolution), Failure> {
    let mut spent = 0;
    let by_one_clock = |row: &Row| row.kind == RowKind::Range && row.clock == rows[0].clock;
    if rows.iter().all(by_one_clock) {
        match bancroft_gn(rows, &mut trace) {
            Err(cause) if !cause.is_of_the_input() => spent = cause.iterations(),
            other => return other.map(|solution| (Solver::Bancroft, solution)),
        }
    }
    let solution = variable_projection(rows, true, trace)?;
    let iterations = spent + solution.iterations;
    Ok((Solver::Vp, PointSolution { iterations, ..solution }))
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
                    DescentDirection::Gradient => "gd",
                    DescentDirection::Diagonal => "diagonal",
                    DescentDirection::GaussNewton => "gn",
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
        let family = |way, rule| Self::Descent(Descent::new(way, rule));
        let constant = |way| Ok(family(way, StepRule::Constant(alpha()?)));
        let geometric = |way, first| Ok(family(way, StepRule::Geometric { first, ratio: beta()? }));
        let solver = match (name, parameter) {
            ("adgn", _) => return Ok(Self::Adgn(mu0()?)),
            ("aw-dgn", _) => return Ok(Self::AwDgn(mu0()?)),
            ("gd", _) => return constant(DescentDirection::Gradient),
            ("diagonal", _) => return constant(DescentDirection::Diagonal),
            ("gn", Some(_)) => return constant(DescentDirection::GaussNewton),
            ("gd-geometric", _) => return geometric(DescentDirection::Gradient, GRADIENT_FIRST),
            ("gn-geometric", _) => return geometric(DescentDirection::GaussNewton, 1.0),
            ("gd-bt", _) => family(DescentDirection::Gradient, HALVING),
            ("gn-bt", _) => family(DescentDirection::GaussNewton, HALVING),
            ("gd-bb", _) => family(DescentDirection::Gradient, StepRule::BarzilaiBorwein),
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
