//! The solvers by name: what each averages, and how its numbers are read.

use super::admm::{LeastSquares, Weight};
use super::consensus::{Node, NodeOptions};
use super::info::{self, Average};
use super::sim::Participant;
use super::tree::TreeNode;
use super::{Constraints, Datum, Graph, NetworkError, Normals, Solution};
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

/// How a network arrives at its solution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
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
    pub solver: Solver,
    /// Weight of agreement: without unit for [`Solver::Info`], that of a normal matrix for [`Solver::Admm`].
    pub rho: f64,
    /// What fixes the parameters.
    pub datum: Datum,
    /// Number of parameters.
    pub parameters: usize,
}

/// What a node knows of the common parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Estimate {
    /// The parameters alone, from [`Solver::Admm`].
    Parameters(DVector<f64>),
    /// All that a centre would know.
    Full(Solution),
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
    pub fn solution(&self) -> Option<&Solution> {
        match self {
            Self::Parameters(_) => None,
            Self::Full(solution) => Some(solution),
        }
    }
}

impl Agreement {
    /// The state machine of a node with these normal equations.
    ///
    /// # Errors
    /// [`NetworkError`] for settings out of range, or normal equations of another size.
    pub fn participant(
        &self,
        id: usize,
        normals: &Normals,
        options: NodeOptions,
    ) -> Result<Box<dyn Participant + Send>, NetworkError> {
        let (found, expected) = (normals.parameters(), self.parameters);
        if found != expected {
            let what = format!("the model of node {id}");
            return Err(NetworkError::WrongSize { what, found, expected });
        }
        let rho = self.rho;
        if !(rho > 0.0 && rho.is_finite()) {
            return Err(NetworkError::BadSetting { name: "rho", value: rho, range: "above 0" });
        }
        let constraints = &self.constraints;
        Ok(match self.solver {
            Solver::Info => {
                let own = info::pack(normals);
                Box::new(Node::new(id, constraints, Average { own, rho }, options)?)
            }
            Solver::Admm => {
                let count = constraints.hubs_of(id).len();
                let problem = LeastSquares::new(normals.clone(), &Weight::Scalar(rho), count)?;
                Box::new(Node::new(id, constraints, problem, options)?)
            }
            Solver::Tree => {
                let tree = self.graph.spanning_tree()?;
                Box::new(TreeNode::new(id, &tree, info::pack(normals), options.first_sequence))
            }
        })
    }

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
            Solver::Info => sum(self.graph.nodes() as f64),
            Solver::Tree => sum(1.0),
            Solver::Admm => Ok(Estimate::Parameters(DVector::from_row_slice(estimate))),
        }
    }
}
