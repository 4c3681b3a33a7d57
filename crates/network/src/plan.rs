//! The best rho and alpha of the average, from the graph alone.
//!
//! With f_i(a) = 1/2 |a - a_i|^2 each number is averaged for itself, by t <- (I + alpha K(rho)) t + constant
//! over the edge states. A disagreement decreases as powers of the spectral radius of I + alpha K, without
//! the eigenvalues 1: those belong to values of t around cycles of the graph, which have no effect.
//!
//! Nodes with the same hubs are exchangeable. Their mean is as one node of their weight, and their differences
//! have the eigenvalue -c rho / (1 + c rho) of K: a station with a single link costs nothing, and the matrix is
//! small.

use super::{Constraints, NetworkError};
use nalgebra::{Complex, DMatrix};
use std::collections::BTreeMap;

/// Settings of the average for a graph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Weight of agreement, rho.
    pub rho: f64,
    /// Over-relaxation alpha for synchronous nodes.
    pub relaxation: f64,
    /// Fraction of a disagreement that remains after an iteration.
    pub radius: f64,
}

impl Plan {
    /// Iterations that leave this fraction of a disagreement, below 1.
    pub fn iterations(&self, factor: f64) -> usize {
        (factor.ln() / self.radius.ln()).ceil().max(0.0) as usize
    }
}

/// Finds the settings of the smallest spectral radius: rho to a few percent, alpha to a hundredth.
///
/// Cost: some thirty eigenvalue problems, as large as there are different (set of hubs, hub) pairs.
///
/// # Errors
/// [`NetworkError::Singular`] when an eigenvalue problem does not converge.
pub fn plan(constraints: &Constraints) -> Result<Plan, NetworkError> {
    let classes = Classes::of(constraints);
    let at = |log_rho: f64| classes.best_relaxation(log_rho.exp());
    let grid: Vec<f64> = (-4..=8).map(|k| 0.5 * f64::from(k)).collect();
    let mut best: Option<(f64, Plan)> = None;
    for &log_rho in &grid {
        let plan = at(log_rho)?;
        if best.is_none_or(|(_, best)| plan.radius < best.radius) {
            best = Some((log_rho, plan));
        }
    }
    let Some((mut centre, mut best)) = best else { return Err(NetworkError::Singular(0)) };
    let mut step = 0.25;
    while step > 0.02 {
        for log_rho in [centre - step, centre + step] {
            let plan = at(log_rho)?;
            if plan.radius < best.radius {
                (centre, best) = (log_rho, plan);
            }
        }
        step /= 2.0;
    }
    Ok(best)
}

/// Nodes grouped by their set of hubs.
struct Classes {
    /// For each group its hubs and number of nodes.
    groups: Vec<(Vec<usize>, usize)>,
    /// For each hub the size of its star.
    star: BTreeMap<usize, f64>,
}

impl Classes {
    fn of(constraints: &Constraints) -> Self {
        let mut count: BTreeMap<&[usize], usize> = BTreeMap::new();
        for node in 0..constraints.nodes() {
            *count.entry(constraints.hubs_of(node)).or_default() += 1;
        }
        let groups = count.into_iter().map(|(hubs, count)| (hubs.to_vec(), count)).collect();
        let star = |&hub: &usize| (hub, constraints.members(hub).len() as f64);
        Self { groups, star: constraints.hubs().iter().map(star).collect() }
    }

    /// K(rho), on one state for each pair of a group and a hub of it.
    fn matrix(&self, rho: f64) -> DMatrix<f64> {
        let pairs: Vec<(usize, usize)> = (0..self.groups.len())
            .flat_map(|g| self.groups[g].0.iter().map(move |&hub| (g, hub)))
            .collect();
        // z of a pair's hub by the state of another pair.
        let mean = |hub: usize, (group, other): (usize, usize)| {
            if hub == other { self.groups[group].1 as f64 / self.star[&hub] } else { 0.0 }
        };
        DMatrix::from_fn(pairs.len(), pairs.len(), |row, column| {
            let (group, hub) = pairs[row];
            let hubs = &self.groups[group].0;
            let c = hubs.len() as f64;
            let seen: f64 = hubs.iter().map(|&s| mean(s, pairs[column])).sum();
            let own = f64::from(u8::from(group == pairs[column].0));
            pull_gain(c, rho) * (2.0 * seen - own) / c - mean(hub, pairs[column])
        })
    }

    fn best_relaxation(&self, rho: f64) -> Result<Plan, NetworkError> {
        let matrix = self.matrix(rho);
        let size = matrix.nrows();
        let schur = matrix.try_schur(1e-13, 10_000).ok_or(NetworkError::Singular(size))?;
        let shared = self.groups.iter().filter(|(_, count)| *count > 1);
        let apart = shared.map(|(hubs, _)| Complex::from(-pull_gain(hubs.len() as f64, rho)));
        let moving: Vec<Complex<f64>> = schur
            .complex_eigenvalues()
            .iter()
            .copied()
            .chain(apart)
            .filter(|lambda| lambda.norm() > 1e-9)
            .collect();
        let radius =
            |alpha: f64| moving.iter().map(|l| (1.0 + l * alpha).norm()).fold(0.0, f64::max);
        // The smallest alpha within 2 % of the smallest radius: it gives the smoothest start.
        let steps: Vec<f64> = (50..200).map(|k| 0.01 * f64::from(k)).collect();
        let smallest = steps.iter().map(|&alpha| radius(alpha)).fold(f64::INFINITY, f64::min);
        let good = steps.into_iter().find(|&alpha| radius(alpha) <= 1.02 * smallest);
        let relaxation = good.unwrap_or(1.0);
        Ok(Plan { rho, relaxation, radius: radius(relaxation) })
    }
}

/// The weight of the others in x_i: c rho / (1 + c rho).
fn pull_gain(c: f64, rho: f64) -> f64 {
    c * rho / (1.0 + c * rho)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consensus::{Node, NodeOptions};
    use crate::info::Average;
    use crate::{Graph, constraints, sim};

    /// A ring of 16 with leaves: two at node 0, one at node 3.
    fn network() -> Constraints {
        let mut links: Vec<_> = (0..16).map(|k| (k, (k + 1) % 16)).collect();
        links.extend([(0, 16), (0, 17), (3, 18)]);
        constraints::choose(&Graph::new(19, &links).unwrap()).unwrap()
    }

    #[test]
    fn nodes_agree_at_the_rate_that_is_planned() {
        let constraints = network();
        let plan = plan(&constraints).unwrap();
        let options = NodeOptions { relaxation: plan.relaxation, ..NodeOptions::default() };
        let node = |id| {
            let own = vec![((id * id) as f64).sin()];
            Node::new(id, &constraints, Average { own, rho: plan.rho }, options).unwrap()
        };
        let mut nodes: Vec<_> = (0..19).map(node).collect();
        let mean = nodes.iter().map(|node| node.problem.own[0]).sum::<f64>() / 19.0;
        let mut differences = Vec::new();
        for _ in 0..60 {
            sim::iterate(&mut nodes);
            differences.push(sim::max_difference(&nodes, &[mean]));
        }
        // Over 40 iterations the slowest mode prevails; a complex pair of it makes the difference oscillate by a
        // factor that 40 roots bring near 1.
        let rate = (differences[55] / differences[15]).powf(1.0 / 40.0);
        assert!((rate - plan.radius).abs() < 0.05, "{rate} {}", plan.radius);
    }

    #[test]
    fn a_radius_of_a_half_leaves_a_thousandth_after_ten_iterations() {
        let plan = Plan { rho: 1.0, relaxation: 1.0, radius: 0.5 };
        assert_eq!(plan.iterations(1e-3), 10);
    }

    #[test]
    fn no_other_setting_has_a_smaller_radius() {
        let classes = Classes::of(&network());
        let best = plan(&network()).unwrap();
        for factor in [0.3, 0.6, 0.9, 1.1, 1.7, 3.0] {
            let other = classes.best_relaxation(best.rho * factor).unwrap();
            assert!(other.radius >= best.radius - 1e-3, "{factor}: {other:?} {best:?}");
        }
    }
}
