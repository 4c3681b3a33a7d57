//! Over several networks: figure 11, the number of constraint nodes, bridges, and the conditions of the paper.

use super::way::Epoch;
use rayon::prelude::*;
use sdr_rx::network::admm::Weight;
use sdr_rx::network::info;
use sdr_rx::network::plan::plan;
use sdr_rx::network::scene::{NetworkLayout, SATELLITES, StationScene};
use sdr_rx::network::sim::{self, Participant};
use sdr_rx::network::tree::TreeNode;
use sdr_rx::network::{Constraints, Datum, Graph, NINE_NODES, NetworkError};

/// Results of a network of 110 nodes.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Receivers of each satellite, with the iterations until all nodes have its bias within 1 mm (admm, rho 0.5,
    /// alpha 1.6), where they arrived.
    pub coverage: Vec<(usize, usize)>,
    /// Iterations until all nodes have all biases within 1 mm.
    pub admm: Option<usize>,
    /// The same of averages, planned from the graph.
    pub info: Option<usize>,
    /// Whether the condition (18.2) holds as printed.
    pub condition: bool,
    /// Spectral radius of the planned average.
    pub radius: f64,
}

impl Shown {
    /// Spearman's rank correlation between receivers and iterations.
    pub fn rank_correlation(&self) -> f64 {
        let receivers = ranks(self.coverage.iter().map(|c| c.0).collect());
        let iterations = ranks(self.coverage.iter().map(|c| c.1).collect());
        let mean = (self.coverage.len() as f64 + 1.0) / 2.0;
        let product = |a: &[f64], b: &[f64]| -> f64 {
            a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)).sum()
        };
        product(&receivers, &iterations)
            / (product(&receivers, &receivers) * product(&iterations, &iterations)).sqrt()
    }
}

/// Ranks from 1; equal numbers have the mean of theirs.
fn ranks(values: Vec<usize>) -> Vec<f64> {
    let below = |value: usize| values.iter().filter(|other| **other < value).count();
    let alike = |value: usize| values.iter().filter(|other| **other == value).count();
    values.iter().map(|&v| below(v) as f64 + (alike(v) as f64 + 1.0) / 2.0).collect()
}

/// Networks of 110 by these seeds.
///
/// # Errors
/// [`NetworkError::Singular`] when a satellite is in view of no station.
pub fn networks(
    layout: NetworkLayout,
    count: u64,
    limit: usize,
) -> Result<Vec<Shown>, NetworkError> {
    (1..=count).into_par_iter().map(|seed| network(layout, seed, limit)).collect()
}

fn network(layout: NetworkLayout, seed: u64, limit: usize) -> Result<Shown, NetworkError> {
    let scene = StationScene::new(layout, seed)?;
    let epoch = Epoch::new(&scene, 0, Datum::Observed, seed)?;
    let admm = epoch.way(&mut epoch.admm(&Weight::Scalar(0.5), 1.6)?, limit);
    let plan = plan(&epoch.constraints)?;
    let mut nodes = epoch.info(plan.rho, plan.relaxation)?;
    let info = epoch.way_of_averages(&mut nodes, Datum::Observed, limit);
    let arrivals = (0..SATELLITES).map(|j| admm.millimetre_of(j));
    let coverage = scene.receivers(0).into_iter().zip(arrivals);
    Ok(Shown {
        coverage: coverage.filter_map(|(count, arrival)| Some((count, arrival?))).collect(),
        admm: admm.millimetre(),
        info: info.millimetre(),
        condition: epoch.constraints.printed_condition_holds(),
        radius: plan.radius,
    })
}

/// Sets of constraint nodes of the nine nodes of figure 5, numbered from 1 as there.
pub const SETS: [&[usize]; 3] = [&[1, 3, 4, 9], &[1, 3, 4, 6, 9], &[1, 2, 3, 4, 5, 6, 7, 8, 9]];

/// Iterations to 1 mm of the nine nodes with each of [`SETS`], each at its best rho of a grid, alpha 1, for these
/// seeds.
///
/// # Errors
/// [`NetworkError::Singular`] when a satellite is in view of no station.
pub fn constraint_nodes(count: u64, limit: usize) -> Result<Vec<[Option<usize>; 3]>, NetworkError> {
    let one = |seed: u64| {
        let scene = StationScene::new(NetworkLayout::Nine, seed)?;
        let mut epoch = Epoch::new(&scene, 0, Datum::Observed, seed)?;
        let mut best = [None; 3];
        for (set, best) in SETS.iter().zip(&mut best) {
            let hubs: Vec<usize> = set.iter().map(|hub| hub - 1).collect();
            epoch.constraints = Constraints::new(&Graph::new(9, &NINE_NODES)?, &hubs)?;
            for k in -8..=4 {
                let weight = Weight::Scalar(2f64.powf(0.5 * f64::from(k)));
                // Long enough to decide that another rho was better: convergence to the end takes no more than
                // twice as long as that to 1 mm.
                let far = best.map_or(limit, |best: usize| 2 * best);
                let arrival = epoch.way(&mut epoch.admm(&weight, 1.0)?, far).millimetre();
                *best = [*best, arrival].into_iter().flatten().min();
            }
        }
        Ok(best)
    };
    (1..=count).into_par_iter().map(one).collect()
}

/// The median of numbers, of two middle ones the larger; 0 of none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// The convergence of a tree: exchanges until every node has the centre's solution, and how exactly, m.
///
/// # Errors
/// [`NetworkError::Disconnected`].
pub fn tree(scene: &StationScene, epoch: &Epoch) -> Result<(usize, f64), NetworkError> {
    let tree = scene.graph.spanning_tree()?;
    let node = |(id, normals)| TreeNode::new(id, &tree, info::pack(normals), 0);
    let mut nodes: Vec<_> = epoch.normals.iter().enumerate().map(node).collect();
    let mut exchanges = 0;
    loop {
        sim::exchange(&mut nodes);
        exchanges += 1;
        let off = |node: &TreeNode| {
            let sum = info::unpack(node.estimate(), SATELLITES).ok()?;
            Some((sum.solve(Datum::Observed).ok()?.x - &epoch.solution.x).amax())
        };
        let farthest = nodes.iter().map(|n| off(n).unwrap_or(f64::INFINITY)).fold(0.0, f64::max);
        if farthest < 1e-9 || exchanges > scene.graph.nodes() {
            return Ok((exchanges, farthest));
        }
    }
}
