//! The solvers by name: what each averages, and how its numbers are read.

use super::{Constraints, Datum, Graph, NetworkError, NetworkSolution, info};
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

/// How a network arrives at its solution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NetworkSolver {
    /// Averages the normal equations: few rounds, and the covariance.
    #[default]
    Info,
    /// The paper's: agrees on the parameters alone; small messages, many rounds.
    Admm,
    /// Sums the normal equations over a spanning tree: exact, but no detour leads around a dead node.
    Tree,
}

/// What all nodes of a network must know alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement {
    /// Who talks to whom.
    pub graph: Graph,
    /// Whose stars bind them.
    pub constraints: Constraints,
    /// How they arrive at the solution.
    pub solver: NetworkSolver,
    /// Weight of agreement: without unit for [`NetworkSolver::Info`], that of a normal matrix for [`NetworkSolver::Admm`].
    pub rho: f64,
    /// What fixes the parameters.
    pub datum: Datum,
    /// Number of parameters.
    pub parameters: usize,
}

/// What a node knows of the common parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Estimate {
    /// The parameters alone, from [`NetworkSolver::Admm`].
    Parameters(DVector<f64>),
    /// All that a centre would know.
    Full(NetworkSolution),
}

impl Estimate {
    /// The parameters.
    pub fn x(&self) -> &DVector<f64> {
        match self {
            Self::Parameters(x) => x,
            Self::Full(solution) => &solution.x,
        }
    }

    /// The solution with its covariance, where the solver gives one.
    pub fn solution(&self) -> Option<&NetworkSolution> {
        match self {
            Self::Parameters(_) => None,
            Self::Full(solution) => Some(solution),
        }
    }
}

impl Agreement {
    /// Reads what a node of this network holds.
    ///
    /// # Errors
    /// [`NetworkError::Singular`] while too little has been heard.
    pub fn read(&self, estimate: &[f64]) -> Result<Estimate, NetworkError> {
        let sum = |factor| -> Result<Estimate, NetworkError> {
            let normals = info::unpack(estimate, self.parameters)?.scaled(factor);
            Ok(Estimate::Full(normals.solve(self.datum)?))
        };
        match self.solver {
            NetworkSolver::Info => sum(self.graph.nodes() as f64),
            NetworkSolver::Tree => sum(1.0),
            NetworkSolver::Admm => Ok(Estimate::Parameters(DVector::from_row_slice(estimate))),
        }
    }
}
