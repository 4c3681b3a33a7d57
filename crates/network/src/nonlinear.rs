//! Nonlinear least squares over a network: equation (23) of Khodabandeh & Teunissen (Meas. Sci. Technol. 30
//! (2019) 044005), with N_i + c_i W where they print N_i + W, and one Gauss-Newton step an iteration.
//!
//! Of l = h(x) + e, a node linearises at its own x_i: with the residual v = l - h(x_i) and the Jacobian J,
//! ```text
//! x_i <- x_i + (J' P J + c_i W)^-1 (J' P v + c_i W (pull - x_i))
//! ```
//! The parameters are absolute, not corrections to a common approximate value. So each node may linearise
//! at a point of its own, and the duals stay valid from one linearisation to the next. (Setting them to
//! zero at each, as printed, costs hundreds of iterations.) [`absolute`] serves the linearised case: it makes a
//! linear model of x itself, for [`NodeLeastSquares`](super::admm::NodeLeastSquares) or
//! [`Average`](super::info::Average), of what is known at one point.

use super::LinearModel;
use super::admm::Weight;
use super::consensus::Proximal;
use nalgebra::{DMatrix, DVector, DVectorView, Vector3};

/// A node's nonlinear least squares. `about` gives the model at x: residuals l - h(x) as its observations, the
/// Jacobian of h as its design.
#[derive(Clone, Debug)]
pub struct GaussNewton<F> {
    about: F,
    weight: DMatrix<f64>,
}

impl<F: FnMut(&[f64]) -> LinearModel> GaussNewton<F> {
    /// The problem of a node in `dimension` parameters, W as at all nodes.
    pub fn new(dimension: usize, weight: &Weight, about: F) -> Self {
        Self { about, weight: weight.matrix(dimension) }
    }
}

impl<F: FnMut(&[f64]) -> LinearModel> Proximal for GaussNewton<F> {
    fn dimension(&self) -> usize {
        self.weight.nrows()
    }

    /// One step from `x`, which is as the last call left it. Where no step can be computed, x stays.
    fn minimise(&mut self, pull: &[f64], constraints: usize, x: &mut [f64]) {
        let normals = (self.about)(x).normals();
        let weight = &self.weight * constraints as f64;
        let apart = DVectorView::from_slice(pull, pull.len()) - DVectorView::from_slice(x, x.len());
        let right = normals.right + &weight * apart;
        let Some(factor) = (normals.matrix + weight).cholesky() else { return };
        let step = factor.solve(&right);
        if step.iter().all(|step| step.is_finite()) {
            x.iter_mut().zip(&step).for_each(|(x, step)| *x += step);
        }
    }
}

/// The model of x itself, of a model about the point `at`: l - h(at) + J at = J x + e.
pub fn absolute(about: LinearModel, at: &[f64]) -> LinearModel {
    let shift = &about.design * DVector::from_row_slice(at);
    LinearModel { observations: about.observations + shift, ..about }
}

/// Pseudoranges (m) about a position, ECEF or any other Cartesian frame, m, the receiver's own clock eliminated:
/// one satellite at `satellites_m` for each pseudorange, with its weight, 1/m^2.
///
/// Common parameters: the position. A receiver of two satellites contributes one hyperboloid.
pub fn pseudoranges_about(
    position_m: &Vector3<f64>,
    satellites_m: &[Vector3<f64>],
    pseudoranges_m: &[f64],
    weights: &[f64],
) -> LinearModel {
    let lines: Vec<Vector3<f64>> = satellites_m.iter().map(|s| position_m - s).collect();
    let design = DMatrix::from_fn(lines.len(), 3, |k, axis| lines[k][axis] / lines[k].norm());
    let residuals = pseudoranges_m.iter().zip(&lines).map(|(range, line)| range - line.norm());
    let residuals = DVector::from_iterator(lines.len(), residuals);
    LinearModel::with_receiver_bias(design, residuals, weights)
}

#[cfg(test)]
mod tests {
    use super::super::admm::NodeLeastSquares;
    use super::super::consensus::{Node, NodeOptions};
    use super::super::{Constraints, Datum, Normals, sim, test_scene};
    use super::*;
    use rand::RngExt;
    use rand::seq::IndexedRandom;

    const WEIGHT: Weight = Weight::Scalar(0.3);

    /// Observations of a receiver: satellites and pseudoranges (m), with noise of 1 m.
    type Observed = (Vec<Vector3<f64>>, Vec<f64>);

    /// Nine receivers at one position, with clocks of their own, each with two to four satellites in view.
    fn receivers(seed: u64) -> (Vector3<f64>, Vec<Observed>) {
        let mut random = test_scene::stream(seed, 0);
        let anywhere = Vector3::zeros();
        let truth_m = test_scene::position_near(&anywhere, f64::INFINITY, &mut random);
        let time_s = random.random_range(0.0..86_164.0);
        let satellites: Vec<_> = (0..24).map(|k| test_scene::satellite_m(k, time_s)).collect();
        let above = |s: &&Vector3<f64>| test_scene::elevation(&truth_m, s) > 0.1;
        let satellites: Vec<_> = satellites.iter().filter(above).copied().collect();
        let receiver = |_| {
            let count = random.random_range(2..=4);
            let seen: Vec<_> = satellites.sample(&mut random, count).copied().collect();
            let clock_m = 1e5 * test_scene::normal(&mut random);
            let range =
                |s: &Vector3<f64>| (s - truth_m).norm() + clock_m + test_scene::normal(&mut random);
            let ranges = seen.iter().map(range).collect();
            (seen, ranges)
        };
        let receivers = (0..9).map(receiver).collect();
        (truth_m, receivers)
    }

    fn about(x: &[f64], (satellites, ranges): &Observed) -> LinearModel {
        let at = Vector3::from_column_slice(x);
        pseudoranges_about(&at, satellites, ranges, &vec![1.0; ranges.len()])
    }

    /// The normal equations of all receivers about a point.
    fn sum(at: &Vector3<f64>, receivers: &[Observed]) -> Normals {
        receivers.iter().fold(Normals::none(3), |mut sum, receiver| {
            sum.add(&about(at.as_slice(), receiver).normals());
            sum
        })
    }

    /// Gauss-Newton with all observations at a centre.
    fn centre(start: &Vector3<f64>, receivers: &[Observed]) -> Vector3<f64> {
        (0..20).fold(*start, |at, _| at + sum(&at, receivers).solve(Datum::Observed).unwrap().x)
    }

    fn network<P: Proximal>(
        constraints: &Constraints,
        start: &Vector3<f64>,
        problem: impl Fn(usize) -> P,
    ) -> Vec<Node<P>> {
        let node = |id| {
            let options = NodeOptions::default();
            let mut node = Node::new(id, constraints, problem(id), options).unwrap();
            node.start_from(start.as_slice());
            node
        };
        (0..9).map(node).collect()
    }

    #[test]
    fn nine_receivers_of_which_none_can_position_alone_find_their_position() {
        let constraints = test_scene::nine();
        // Weak geometries of all nine together are left out: near the end a disagreement shrinks by about
        // alpha lambda / (n c rho) an iteration, lambda the smallest eigenvalue of the sum of the N_i, and a
        // position dilution of 2 allows lambda = 0.25 at worst. The limit was set when three of thirty drawn
        // geometries, all of a dilution above 2.2 and seeds 1 and 2 among them, had needed 420 to 540 iterations.
        let strong = |(truth_m, receivers): &(Vector3<f64>, Vec<Observed>)| {
            sum(truth_m, receivers).solve(Datum::Observed).unwrap().covariance.trace() < 4.0
        };
        for (truth_m, receivers) in (1..).map(receivers).filter(strong).take(3) {
            let solution = centre(&truth_m, &receivers);
            let aside = truth_m.cross(&Vector3::x()).normalize();
            for start in [truth_m + aside * 1e3, truth_m + aside * 3e5, Vector3::zeros()] {
                let problem = |id: usize| {
                    let observed = &receivers[id];
                    GaussNewton::new(3, &WEIGHT, move |x: &[f64]| about(x, observed))
                };
                let mut nodes = network(&constraints, &start, problem);
                (0..250).for_each(|_| sim::iterate(&mut nodes));
                let difference_m = sim::max_difference(&nodes, solution.as_slice());
                assert!(difference_m < 1e-3, "{difference_m} m");
                // To rounding of 6e6 m in the end.
                (0..400).for_each(|_| sim::iterate(&mut nodes));
                assert!(sim::max_difference(&nodes, solution.as_slice()) < 1e-7);
            }
        }
    }

    #[test]
    fn each_node_may_linearise_at_a_point_of_its_own_and_again_while_the_network_runs() {
        let constraints = test_scene::nine();
        let (truth_m, receivers) = receivers(3);
        let solution = centre(&truth_m, &receivers);
        let at = |id: usize, x: &[f64]| {
            let model = absolute(about(x, &receivers[id]), x);
            NodeLeastSquares::new(model.normals(), &WEIGHT, constraints.hubs_of(id).len()).unwrap()
        };
        let mut random = test_scene::stream(3, 1);
        let offsets: Vec<_> = (0..9)
            .map(|_| Vector3::from_fn(|_, _| 300.0 * test_scene::normal(&mut random)))
            .collect();
        let mut nodes =
            network(&constraints, &truth_m, |id| at(id, (truth_m + offsets[id]).as_slice()));
        for iteration in 1..=600 {
            sim::iterate(&mut nodes);
            if iteration % 20 == 0 {
                for node in &mut nodes {
                    node.problem = at(node.id(), node.estimate());
                }
            }
        }
        // To rounding of 6e6 m.
        assert!(sim::max_difference(&nodes, solution.as_slice()) < 1e-7);
    }
}
