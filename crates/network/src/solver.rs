//! The solvers by name, and the meaning of the numbers of each.

use super::{Constraints, Datum, Graph, NetworkError, NetworkSolution, info};
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

/// Solver of a network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NetworkSolver {
    /// Averages the normal equations: few rounds, and the covariance.
    #[default]
    Info,
    /// The paper's: agrees on the parameters alone; small messages, many rounds.
    Admm,
    /// Sums the normal equations over a spanning tree: exact, but fails with any node.
    Tree,
}

/// Settings common to all nodes of a network.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement {
    /// Links.
    pub graph: Graph,
    /// Constraint nodes.
    pub constraints: Constraints,
    /// Solver.
    pub solver: NetworkSolver,
    /// Weight of agreement: without unit for [`NetworkSolver::Info`], that of a normal matrix for
    /// [`NetworkSolver::Admm`].
    pub rho: f64,
    /// Datum of the parameters.
    pub datum: Datum,
    /// Number of parameters.
    pub parameters: usize,
}

/// A node's solution for the common parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Estimate {
    /// The parameters alone, from [`NetworkSolver::Admm`].
    Parameters(DVector<f64>),
    /// The solution with its covariance.
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
    /// The solution from a node's estimate.
    ///
    /// # Errors
    /// [`NetworkError::Singular`] while too few messages have arrived.
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
