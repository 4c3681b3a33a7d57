//! The networks of an independent implementation, with its solutions and counts of iterations.

use crate::common::{Failed, Tested, data};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use sdr_rx::gnss::random::SplitMix64;
use sdr_rx::network::admm::{NodeLeastSquares, PrintedForm, Weight};
use sdr_rx::network::consensus::{Node, NodeOptions, Proximal};
use sdr_rx::network::info::{self, Average};
use sdr_rx::network::scene::{NetworkLayout, StationScene};
use sdr_rx::network::sim::{self, Conditions, Participant, Simulation};
use sdr_rx::network::tree::TreeNode;
use sdr_rx::network::{Constraints, Datum, Graph, NetworkSolution, Normals, consensus::Rule, plan};
use serde::Deserialize;
use std::path::Path;

#[derive(Deserialize)]
#[allow(non_snake_case)]
struct Network {
    n: usize,
    edges: Vec<(usize, usize)>,
    constraint_nodes: Vec<usize>,
    N: Vec<Vec<Vec<f64>>>,
    r: Vec<Vec<f64>>,
    xhat: Vec<f64>,
    sigma: Vec<f64>,
    Q: Vec<Vec<f64>>,
}

impl Network {
    /// The one of 110 nodes, and that of nine.
    fn read(folder: &Path) -> Result<[Self; 2], Failed> {
        let text = std::fs::read_to_string(folder.join("vectors/network.json"))?;
        let networks: Vec<Self> = serde_json::from_str(&text)?;
        networks.try_into().map_err(|_| "two networks are expected".into())
    }

    fn graph(&self) -> Result<Graph, Failed> {
        Ok(Graph::new(self.n, &self.edges)?)
    }

    fn constraints(&self) -> Result<Constraints, Failed> {
        Ok(Constraints::new(&self.graph()?, &self.constraint_nodes)?)
    }

    fn normals(&self) -> Vec<Normals> {
        let one = |(n, r): (&Vec<Vec<f64>>, &Vec<f64>)| Normals {
            matrix: DMatrix::from_fn(r.len(), r.len(), |i, j| n[i][j]),
            right: DVector::from_row_slice(r),
            squares: 0.0,
            freedom: 0.0,
        };
        self.N.iter().zip(&self.r).map(one).collect()
    }

    fn centre(&self) -> Result<NetworkSolution, Failed> {
        let mut sum = Normals::none(self.xhat.len());
        self.normals().iter().for_each(|one| sum.add(one));
        Ok(sum.solve(Datum::Observed)?)
    }

    fn nodes<P: Proximal>(
        &self,
        constraints: &Constraints,
        options: NodeOptions,
        problem: impl Fn(Normals, usize) -> Result<P, Failed>,
    ) -> Result<Vec<Node<P>>, Failed> {
        let node = |(id, normals)| {
            let problem = problem(normals, constraints.hubs_of(id).len())?;
            Ok(Node::new(id, constraints, problem, options)?)
        };
        self.normals().into_iter().enumerate().map(node).collect()
    }

    fn admm(
        &self,
        constraints: &Constraints,
        rho: f64,
        options: NodeOptions,
    ) -> Result<Vec<Node<NodeLeastSquares>>, Failed> {
        self.nodes(constraints, options, |normals, c| {
            Ok(NodeLeastSquares::new(normals, &Weight::Scalar(rho), c)?)
        })
    }

    fn info(
        &self,
        constraints: &Constraints,
        rho: f64,
        options: NodeOptions,
    ) -> Result<Vec<Node<Average>>, Failed> {
        self.nodes(constraints, options, |normals, _| {
            Ok(Average { own: info::pack(&normals), rho })
        })
    }
}

fn synchronous(relaxation: f64) -> NodeOptions {
    NodeOptions { relaxation, ..NodeOptions::default() }
}

/// The iteration from which on, up to the last of `limit`, the measure stays below the bound.
fn settled<P: Participant>(
    nodes: &mut [P],
    limit: usize,
    bound: f64,
    measure: impl Fn(&[P]) -> f64,
) -> usize {
    let mut settled = 0;
    for iteration in 1..=limit {
        sim::iterate(nodes);
        if measure(nodes) >= bound {
            settled = iteration;
        }
    }
    settled + 1
}

fn expect(holds: bool, result: String) -> Tested {
    println!("{result}");
    if holds { Ok(()) } else { Err(result.into()) }
}

#[test]
fn a_centre_computes_the_solution_of_the_reference() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    for network in Network::read(folder)? {
        let solution = network.centre()?;
        let x = (&solution.x - DVector::from_row_slice(&network.xhat)).amax();
        let sigma = (solution.sigma() - DVector::from_row_slice(&network.sigma)).amax();
        let q = DMatrix::from_fn(12, 12, |i, j| network.Q[i][j]);
        let q = (&solution.covariance - q).amax();
        expect(x < 1e-9 && sigma < 1e-9 && q < 1e-9, format!("{x:.1e} {sigma:.1e} {q:.1e}"))?;
    }
    Ok(())
}

/// Within 2 % of the reference, whose order of summation differs.
#[test]
fn admm_needs_the_iterations_of_the_reference() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let [large, small] = Network::read(folder)?;
    let everyone: Vec<usize> = (0..9).collect();
    let cases = [
        (&large, &large.constraint_nodes, 0.5, 1.0, 790),
        (&large, &large.constraint_nodes, 0.5, 1.6, 523),
        (&small, &small.constraint_nodes, 2.0, 1.6, 120),
        (&small, &small.constraint_nodes, 1.0, 1.6, 153),
        (&small, &everyone, 2.0, 1.6, 65),
        (&small, &everyone, 1.0, 1.6, 97),
    ];
    for (network, hubs, rho, alpha, expected) in cases {
        let constraints = Constraints::new(&network.graph()?, hubs)?;
        let mut nodes = network.admm(&constraints, rho, synchronous(alpha))?;
        let xhat = &network.xhat;
        let count = settled(&mut nodes, 2 * expected, 1e-3, |n| sim::max_difference(n, xhat));
        let near = count.abs_diff(expected) as f64 <= 0.02 * expected as f64;
        expect(near, format!("rho {rho} alpha {alpha}: {count} iterations, not {expected}"))?;
    }
    Ok(())
}

#[test]
fn every_node_ends_within_a_nanometre_of_the_centre() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    for network in Network::read(folder)? {
        let constraints = network.constraints()?;
        let centre = network.centre()?;
        let mut nodes = network.admm(&constraints, 0.5, synchronous(1.6))?;
        (0..6000).for_each(|_| sim::iterate(&mut nodes));
        let admm = sim::max_difference(&nodes, centre.x.as_slice());
        let plan = plan::plan(&constraints)?;
        let mut nodes = network.info(&constraints, plan.rho, synchronous(plan.relaxation))?;
        (0..150).for_each(|_| sim::iterate(&mut nodes));
        let (mut x, mut q) = (0.0f64, 0.0f64);
        for node in &nodes {
            let solution = estimate(node, network.n)?;
            x = x.max((solution.x - &centre.x).amax());
            q = q.max((solution.covariance - &centre.covariance).amax());
        }
        let result = format!("admm {admm:.1e}, info {x:.1e}, its covariance {q:.1e}");
        expect(admm < 1e-9 && x < 1e-9 && q < 1e-9, result)?;
    }
    Ok(())
}

/// A node's solution from the mean normal equations.
fn estimate(node: &Node<Average>, nodes: usize) -> Result<NetworkSolution, Failed> {
    Ok(info::unpack(node.estimate(), 12)?.scaled(nodes as f64).solve(Datum::Observed)?)
}

/// The common value is the least-squares solution weighted by c_i, decimetres off.
#[test]
fn the_update_as_printed_agrees_on_a_wrong_value() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let [network, _] = Network::read(folder)?;
    let constraints = network.constraints()?;
    let mut nodes = network.nodes(&constraints, synchronous(1.6), |normals, _| {
        Ok(PrintedForm::new(normals, &Weight::Scalar(0.5))?)
    })?;
    (0..6000).for_each(|_| sim::iterate(&mut nodes));
    let mut weighted = Normals::none(12);
    for (id, normals) in network.normals().iter().enumerate() {
        weighted.add(&normals.scaled(constraints.hubs_of(id).len() as f64));
    }
    let wrong = weighted.solve(Datum::Observed)?.x;
    let apart = sim::max_difference(&nodes, wrong.as_slice());
    let off = (&wrong - DVector::from_row_slice(&network.xhat)).amax();
    let result = format!("agree on the weighted solution to {apart:.1e} m, {off:.4} m off");
    expect(apart < 1e-9 && (off - 0.1345).abs() < 1e-4, result)
}

/// Rounds of averaged normal equations, as planned from the graph, after which every node stays within 1 mm and
/// within 3 sigma of the centre, and has the sigmas to 1 %.
fn rounds(constraints: &Constraints, normals: &[Normals]) -> Result<[usize; 3], Failed> {
    let plan = plan::plan(constraints)?;
    let mut sum = Normals::none(12);
    normals.iter().for_each(|one| sum.add(one));
    let centre = sum.solve(Datum::Observed)?;
    let sigma = centre.sigma();
    let node = |(id, normals)| {
        let problem = Average { own: info::pack(normals), rho: plan.rho };
        Node::new(id, constraints, problem, synchronous(plan.relaxation))
    };
    let mut nodes: Vec<_> = normals.iter().enumerate().map(node).collect::<Result<_, _>>()?;
    let mut settled = [0; 3];
    for round in 1..=80 {
        sim::iterate(&mut nodes);
        let mut worst = [0.0f64; 3];
        for node in &nodes {
            let measures = estimate(node, normals.len()).map_or([f64::INFINITY; 3], |s| {
                let off = &s.x - &centre.x;
                let spread = s.sigma().component_div(&sigma).add_scalar(-1.0);
                [off.amax() / 1e-3, off.component_div(&sigma).amax() / 3.0, spread.amax() / 0.01]
            });
            worst.iter_mut().zip(measures).for_each(|(worst, one)| *worst = worst.max(one));
        }
        for (settled, _) in settled.iter_mut().zip(worst).filter(|(_, worst)| *worst >= 1.0) {
            *settled = round;
        }
    }
    Ok(settled.map(|round| round + 1))
}

#[test]
fn averaged_normal_equations_need_thirty_rounds() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let [network, _] = Network::read(folder)?;
    let constraints = network.constraints()?;
    let plan = plan::plan(&constraints)?;
    let [metres, within, spread] = rounds(&constraints, &network.normals())?;
    let result = format!("{plan:?}: 1 mm {metres}, 3 sigma {within}, sigma to 1 % {spread} rounds");
    expect(metres <= 32 && within <= 6 && spread <= 27, result)
}

/// Half of the networks keep the bounds that the independent implementation gives for its own; each converges at
/// the rate of the planned radius: from ten metres to 1 mm, with ten times as much for a rise before the fall.
/// (Not all keep the first bounds: the worst need 35, 9 and 29 rounds, so that medians are tested.)
#[test]
fn averages_settle_as_planned_in_thirty_networks() -> Tested {
    let network = |seed: u64| -> Result<([usize; 3], usize), String> {
        let rounds = || -> Result<_, Failed> {
            let scene = StationScene::new(NetworkLayout::Hubs, seed)?;
            let constraints = Constraints::new(&scene.graph, &scene.hubs)?;
            let models = scene.models(0, Datum::Observed, &mut SplitMix64::new(seed));
            let normals: Vec<Normals> = models.iter().map(|model| model.normals()).collect();
            let bound = plan::plan(&constraints)?.iterations(1e-5);
            Ok((rounds(&constraints, &normals)?, bound))
        };
        rounds().map_err(|failed| format!("{failed:?}"))
    };
    let all: Vec<_> = (1..=30u64).into_par_iter().map(network).collect::<Result<_, _>>()?;
    let median = |k: usize| {
        let mut each: Vec<usize> = all.iter().map(|(rounds, _)| rounds[k]).collect();
        each.sort_unstable();
        each[each.len() / 2]
    };
    let as_planned = all.iter().all(|(rounds, bound)| rounds[0] <= *bound);
    let [metres, within, spread] = [median(0), median(1), median(2)];
    let result = format!("1 mm {metres}, 3 sigma {within}, sigma to 1 % {spread} rounds; {all:?}");
    expect(as_planned && metres <= 32 && within <= 6 && spread <= 27, result)
}

#[test]
fn a_tree_is_exact_after_as_many_exchanges_as_its_diameter() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    for network in Network::read(folder)? {
        let tree = network.graph()?.spanning_tree()?;
        let node = |(id, normals)| TreeNode::new(id, &tree, info::pack(&normals), 0);
        let mut nodes: Vec<_> = network.normals().into_iter().enumerate().map(node).collect();
        let width = tree.diameter().ok_or("a tree is connected")?;
        (0..width).for_each(|_| sim::exchange(&mut nodes));
        for node in &nodes {
            let x = info::unpack(node.estimate(), 12)?.solve(Datum::Observed)?.x;
            let off = (x - DVector::from_row_slice(&network.xhat)).amax();
            if off > 1e-9 {
                return Err(format!("{off} m off after {width} exchanges").into());
            }
        }
        println!("{width} exchanges");
    }
    Ok(())
}

/// Clocks five times slower than others, delays of one to three ticks, one message in ten lost.
#[test]
fn acknowledged_links_converge_where_the_obvious_rules_diverge() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let [_, network] = Network::read(folder)?;
    let constraints = network.constraints()?;
    let ticks = |rule, relaxation, limit: u64, seed| -> Result<u64, Failed> {
        let options = NodeOptions { relaxation, rule, first_sequence: 0 };
        let nodes = network.admm(&constraints, 1.0, options)?;
        let conditions = Conditions { loss: 0.1, ..Conditions::default() };
        let mut simulation = Simulation::new(nodes, conditions, seed)?;
        let mut settled = 0;
        while simulation.ticks() < limit {
            simulation.tick();
            if sim::max_difference(&simulation.nodes, &network.xhat) >= 1e-3 {
                settled = simulation.ticks();
            }
        }
        Ok(settled)
    };
    let worst = |rule, relaxation, limit| -> Result<(u64, u64), Failed> {
        let all: Result<Vec<u64>, Failed> =
            (0..20).map(|seed| ticks(rule, relaxation, limit, seed)).collect();
        let all = all?;
        Ok((*all.iter().min().ok_or("no draws")?, *all.iter().max().ok_or("no draws")?))
    };
    let steady = worst(Rule::Acknowledged, 1.3, 4000)?;
    let eager = worst(Rule::Acknowledged, 1.6, 8000)?;
    let always = worst(Rule::Always, 1.3, 5000)?;
    let result = format!("acknowledged, alpha 1.3 {steady:?}, 1.6 {eager:?}; always {always:?}");
    expect(steady.1 <= 1800 && eager.1 <= 5000 && always.0 == 5000, result)
}
