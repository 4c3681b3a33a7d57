//! Rate of convergence against rho, over-relaxation, residual balancing, the weight matrix, the datum, and
//! averaging normal equations instead of solutions.

use super::way::{Epoch, Way, total};
use nalgebra::DVectorView;
use sdr_rx::network::admm::{NodeLeastSquares, PrintedForm, Weight};
use sdr_rx::network::consensus::Node;
use sdr_rx::network::plan::plan;
use sdr_rx::network::scene::SATELLITES;
use sdr_rx::network::{Datum, NetworkError};
use std::fmt;

/// How the nodes agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setting {
    /// The paper's iterations: rho and alpha.
    Admm(f64, f64),
    /// The same with all receivers' biases eliminated and x kept of zero mean.
    Free(f64, f64),
    /// rho adapted while running, from this start, alpha 1.6.
    Balanced(f64),
    /// rho by rule from the mean normal matrix, alpha 1.6.
    Rule,
    /// W = 4 times the mean normal matrix, alpha 1.6.
    MeanWeight,
    /// Normal equations averaged: rho and alpha.
    Info(f64, f64),
    /// The same, rho and alpha planned from the graph.
    Planned,
}

impl Setting {
    /// All that are compared.
    pub const ALL: [Self; 15] = [
        Self::Admm(5.0, 1.0),
        Self::Admm(0.5, 1.0),
        Self::Admm(0.05, 1.0),
        Self::Admm(0.005, 1.0),
        Self::Admm(5.0, 1.6),
        Self::Admm(0.5, 1.6),
        Self::Admm(0.5, 1.8),
        Self::Admm(0.05, 1.6),
        Self::Balanced(5.0),
        Self::Balanced(0.005),
        Self::Rule,
        Self::MeanWeight,
        Self::Free(4.0, 1.6),
        Self::Info(3.0, 1.6),
        Self::Planned,
    ];

    /// The way to the solution; `free` is the same epoch with the free datum.
    ///
    /// # Errors
    /// [`NetworkError`] of a setting out of range.
    pub fn way(self, epoch: &Epoch, free: &Epoch, limit: usize) -> Result<Way, NetworkError> {
        let mean = || total(&epoch.normals).matrix / epoch.normals.len() as f64;
        Ok(match self {
            Self::Admm(rho, alpha) => {
                epoch.way(&mut epoch.admm(&Weight::Scalar(rho), alpha)?, limit)
            }
            Self::Free(rho, alpha) => free.way(&mut free.admm(&Weight::Scalar(rho), alpha)?, limit),
            Self::Balanced(rho) => balanced(epoch, rho, limit)?,
            Self::Rule => {
                let rho = 0.5 * mean().trace() / SATELLITES as f64;
                epoch.way(&mut epoch.admm(&Weight::Scalar(rho), 1.6)?, limit)
            }
            Self::MeanWeight => {
                epoch.way(&mut epoch.admm(&Weight::Matrix(mean() * 4.0), 1.6)?, limit)
            }
            Self::Info(rho, alpha) => {
                epoch.way_of_averages(&mut epoch.info(rho, alpha)?, Datum::Observed, limit)
            }
            Self::Planned => {
                let plan = plan(&epoch.constraints)?;
                return Self::Info(plan.rho, plan.relaxation).way(epoch, free, limit);
            }
        })
    }
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Admm(rho, alpha) => write!(f, "admm rho {rho} alpha {alpha}"),
            Self::Free(rho, alpha) => write!(f, "admm free datum rho {rho} alpha {alpha}"),
            Self::Balanced(rho) => write!(f, "admm rho balanced from {rho} alpha 1.6"),
            Self::Rule => write!(f, "admm rho = tr(sum N) / (2 n p) alpha 1.6"),
            Self::MeanWeight => write!(f, "admm W = 4 mean N alpha 1.6"),
            Self::Info(rho, alpha) => write!(f, "info rho {rho} alpha {alpha}"),
            Self::Planned => write!(f, "info planned"),
        }
    }
}

/// Iterations between changes of rho.
const EVERY: usize = 10;
/// Ratio of the residuals above which rho is changed, and factor of the change.
const UNEQUAL: f64 = 2.0;
const CHANGE: f64 = 2.0;
/// After this many iterations rho stays, so that the iterations converge.
const LAST: usize = 300;

/// Balancing of the relative residuals (Wohlberg, arXiv 1704.06209): rho grows where |x_i - z_s| / |x_i| exceeds
/// |change of z_s| / |u_is|, and shrinks where that exceeds. u_is is taken at its limit, the gradient
/// (r_i - N_i x_i) / (c_i rho). Nodes would find the largest of each in the network by max-consensus; here it
/// is given.
fn balanced(epoch: &Epoch, start: f64, limit: usize) -> Result<Way, NetworkError> {
    let mut rho = start;
    let mut nodes = epoch.admm(&Weight::Scalar(rho), 1.6)?;
    let mut way = epoch.way(&mut nodes, EVERY);
    let constraints = |id: usize| epoch.constraints.hubs_of(id).len();
    while way.deviations.len() < LAST.min(limit) {
        let largest =
            |of: &dyn Fn(&Node<NodeLeastSquares>) -> f64| nodes.iter().map(of).fold(0.0, f64::max);
        let gradient = |node: &Node<NodeLeastSquares>| {
            let normals = &epoch.normals[node.id()];
            let x = DVectorView::from_slice(node.estimate(), SATELLITES);
            (&normals.right - &normals.matrix * x).amax() / constraints(node.id()) as f64
        };
        let size = |node: &Node<NodeLeastSquares>| {
            node.estimate().iter().fold(0.0, |m: f64, x| m.max(x.abs()))
        };
        let primal = largest(&|node| node.residuals().primal) / largest(&size);
        let dual = rho * largest(&|node| node.residuals().dual) / largest(&gradient);
        let factor = match primal / dual {
            ratio if ratio > UNEQUAL => CHANGE,
            ratio if ratio < 1.0 / UNEQUAL => 1.0 / CHANGE,
            _ => 1.0,
        };
        if factor != 1.0 {
            rho *= factor;
            for (id, node) in nodes.iter_mut().enumerate() {
                let (normals, weight) = (epoch.normals[id].clone(), Weight::Scalar(rho));
                node.problem = NodeLeastSquares::new(normals, &weight, constraints(id))?;
                node.rescale_duals(1.0 / factor);
            }
        }
        way.extend(epoch.way(&mut nodes, EVERY));
    }
    way.extend(epoch.way(&mut nodes, limit.saturating_sub(LAST)));
    Ok(way)
}

/// Distance of the nodes' common value by figure 6 as printed from the solution, m, and of the nodes from each other.
///
/// # Errors
/// None that [`Setting::way`] has not.
pub fn printed(epoch: &Epoch, limit: usize) -> Result<[f64; 2], NetworkError> {
    let weight = Weight::Scalar(0.5);
    let problem = |id: usize| PrintedForm::new(epoch.normals[id].clone(), &weight);
    let mut nodes = epoch.nodes(1.6, problem)?;
    let off = epoch.way(&mut nodes, limit).rest();
    let first = nodes[0].estimate().to_vec();
    Ok([off, sdr_rx::network::sim::max_difference(&nodes, &first)])
}
