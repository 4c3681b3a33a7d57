//! An epoch of a network, and the convergence of its nodes to the solution.

use nalgebra::DVector;
use sdr_rx::gnss::random::SplitMix64;
use sdr_rx::network::admm::{NodeLeastSquares, Weight};
use sdr_rx::network::consensus::{Node, NodeOptions, Proximal};
use sdr_rx::network::info::{self, Average};
use sdr_rx::network::scene::{SATELLITES, StationScene};
use sdr_rx::network::sim::{self, Participant};
use sdr_rx::network::{Constraints, Datum, NetworkError, NetworkSolution, Normals};
use sdr_rx::report::Curve;

/// Distance of convergence, m.
pub const ARRIVED_M: f64 = 1e-3;
/// Iterations stop when all nodes are this near, m.
const END_M: f64 = 1e-5;

/// An epoch's normal equations, and a centre's solution.
#[derive(Clone, Debug)]
pub(super) struct Epoch {
    /// Constraint nodes.
    pub constraints: Constraints,
    /// Each station's.
    pub normals: Vec<Normals>,
    /// The centre's.
    pub solution: NetworkSolution,
}

impl Epoch {
    /// The epoch of a scene that has this number, its noise by the seed.
    ///
    /// # Errors
    /// [`NetworkError::Singular`] when a satellite is in view of no station.
    pub fn new(
        scene: &StationScene,
        number: usize,
        datum: Datum,
        seed: u64,
    ) -> Result<Self, NetworkError> {
        let models = scene.models(number, datum, &mut SplitMix64::new(seed));
        let normals: Vec<Normals> = models.iter().map(|model| model.normals()).collect();
        Ok(Self {
            constraints: Constraints::new(&scene.graph, &scene.hubs)?,
            solution: total(&normals).solve(datum)?,
            normals,
        })
    }

    /// The paper's nodes with this weight matrix.
    ///
    /// # Errors
    /// [`NetworkError`] of a weight that is not positive.
    pub fn admm(
        &self,
        weight: &Weight,
        relaxation: f64,
    ) -> Result<Vec<Node<NodeLeastSquares>>, NetworkError> {
        self.nodes(relaxation, |id| {
            let count = self.constraints.hubs_of(id).len();
            NodeLeastSquares::new(self.normals[id].clone(), weight, count)
        })
    }

    /// Nodes that average normal equations.
    ///
    /// # Errors
    /// [`NetworkError`] of a relaxation out of range.
    pub fn info(&self, rho: f64, relaxation: f64) -> Result<Vec<Node<Average>>, NetworkError> {
        self.nodes(relaxation, |id| Ok(Average { own: info::pack(&self.normals[id]), rho }))
    }

    /// Synchronous nodes, each with its problem.
    ///
    /// # Errors
    /// [`NetworkError`] of the problems, or of a relaxation out of range.
    pub fn nodes<P: Proximal>(
        &self,
        relaxation: f64,
        problem: impl Fn(usize) -> Result<P, NetworkError>,
    ) -> Result<Vec<Node<P>>, NetworkError> {
        let options = NodeOptions { relaxation, ..NodeOptions::default() };
        let node = |id| Node::new(id, &self.constraints, problem(id)?, options);
        (0..self.normals.len()).map(node).collect()
    }

    /// The way of nodes that agree on the parameters themselves.
    pub fn way<P: Participant>(&self, nodes: &mut [P], limit: usize) -> Way {
        self.follow(nodes, limit, |node| Some(DVector::from_row_slice(node.estimate())))
    }

    /// The way of nodes that average normal equations.
    pub fn way_of_averages(&self, nodes: &mut [Node<Average>], datum: Datum, limit: usize) -> Way {
        self.follow(nodes, limit, |node| {
            let mean = info::unpack(node.estimate(), SATELLITES).ok()?;
            Some(mean.solve(datum).ok()?.x)
        })
    }

    fn follow<P: Participant>(
        &self,
        nodes: &mut [P],
        limit: usize,
        read: impl Fn(&P) -> Option<DVector<f64>>,
    ) -> Way {
        let mut way = Way { sigma: self.solution.sigma(), deviations: Vec::new() };
        while way.deviations.len() < limit && !way.at_end() {
            sim::iterate(nodes);
            way.deviations.push(self.deviation(nodes, &read));
        }
        way
    }

    /// The largest deviation of any node from the centre, for each parameter; infinite where a node has no solution.
    fn deviation<P>(&self, nodes: &[P], read: impl Fn(&P) -> Option<DVector<f64>>) -> DVector<f64> {
        let unknown = || DVector::repeat(SATELLITES, f64::INFINITY);
        let apart = |node| read(node).map_or_else(unknown, |x| (x - &self.solution.x).abs());
        nodes.iter().map(apart).fold(DVector::zeros(SATELLITES), |most, one| most.sup(&one))
    }
}

/// The sum of all nodes' normal equations.
pub fn total(normals: &[Normals]) -> Normals {
    let mut sum = Normals::none(SATELLITES);
    normals.iter().for_each(|one| sum.add(one));
    sum
}

/// Distance of the nodes from the centre's solution after each iteration.
#[derive(Clone, Debug)]
pub struct Way {
    /// Of the centre's solution.
    pub sigma: DVector<f64>,
    /// For each iteration and parameter, the farthest node's, m.
    pub deviations: Vec<DVector<f64>>,
}

impl Way {
    fn at_end(&self) -> bool {
        self.deviations.last().is_some_and(|last| last.amax() < END_M)
    }

    /// The largest deviation after the last iteration, m.
    pub fn rest(&self) -> f64 {
        self.deviations.last().map_or(f64::INFINITY, DVector::amax)
    }

    /// Appends another run.
    pub fn extend(&mut self, other: Self) {
        self.deviations.extend(other.deviations);
    }

    /// Iterations until all nodes stay within 1 mm.
    pub fn millimetre(&self) -> Option<usize> {
        self.arrival(|deviation| deviation.amax() <= ARRIVED_M)
    }

    /// Iterations until one parameter stays within 1 mm at all nodes.
    pub fn millimetre_of(&self, parameter: usize) -> Option<usize> {
        self.arrival(|deviation| deviation[parameter] <= ARRIVED_M)
    }

    /// Iterations until all nodes stay within 3 sigma.
    pub fn three_sigma(&self) -> Option<usize> {
        self.arrival(|deviation| deviation.component_div(&self.sigma).amax() <= 3.0)
    }

    fn arrival(&self, near: impl Fn(&DVector<f64>) -> bool) -> Option<usize> {
        let away = self.deviations.iter().rposition(|deviation| !near(deviation));
        let first = away.map_or(0, |k| k + 1) + 1;
        (first <= self.deviations.len()).then_some(first)
    }

    /// The largest deviation against iterations: all of the first hundred, then each that is 1 % further on.
    pub fn curve(&self, name: impl Into<String>) -> Curve {
        let mut points: Vec<(f64, f64)> = Vec::new();
        for (k, deviation) in self.deviations.iter().enumerate() {
            let x = (k + 1) as f64;
            if k < 100 || points.last().is_none_or(|last| x >= 1.01 * last.0) {
                points.push((x, deviation.amax()));
            }
        }
        Curve { name: name.into(), points }
    }
}

/// A number of iterations, or that there were more.
pub fn count(iterations: Option<usize>, limit: usize) -> String {
    iterations.map_or_else(|| format!("> {limit}"), |k| k.to_string())
}
