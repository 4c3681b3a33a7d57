//! Two and a half hours of 110 stations: filters without a centre follow that of the centre.

use crate::common::Tested;
use nalgebra::DVector;
use rayon::prelude::*;
use sdr_rx::gnss::random::SplitMix64;
use sdr_rx::network::admm::{NodeLeastSquares, Weight};
use sdr_rx::network::consensus::{Node, NodeOptions, Proximal};
use sdr_rx::network::filter::{GainFilter, InformationFilter};
use sdr_rx::network::info::{self, Average};
use sdr_rx::network::scene::{NetworkLayout, SATELLITES, StationScene};
use sdr_rx::network::{
    Constraints, Datum, LinearModel, NetworkError, NetworkSolution, Normals, sim,
};

const STATIONS: usize = 110;
const RHO: f64 = 0.5;

/// A network's observations, epoch by epoch.
struct Epochs {
    constraints: Constraints,
    models: Vec<Vec<LinearModel>>,
}

/// Epochs of 30 s of the network of a seed, the first station's bias zero.
fn epochs(seed: u64, count: usize) -> Result<Epochs, NetworkError> {
    let scene = StationScene::new(NetworkLayout::Hubs, seed)?;
    let mut noise = SplitMix64::new(seed);
    let models = (0..count).map(|epoch| scene.models(epoch, Datum::Observed, &mut noise)).collect();
    Ok(Epochs { constraints: Constraints::new(&scene.graph, &scene.hubs)?, models })
}

/// The centre's solution of all epochs up to each.
fn centre(epochs: &Epochs, forgetting: f64) -> Result<Vec<NetworkSolution>, NetworkError> {
    let mut filter = InformationFilter::new(SATELLITES, forgetting)?;
    let solve = |models: &Vec<LinearModel>| {
        let mut sum = Normals::none(SATELLITES);
        models.iter().for_each(|model| sum.add(&model.normals()));
        filter.update(&sum);
        filter.normals().solve(Datum::Observed)
    };
    epochs.models.iter().map(solve).collect()
}

#[test]
fn the_gain_form_of_the_filter_is_its_information_form() -> Tested {
    for forgetting in [1.0, 0.97] {
        let epochs = epochs(1, 300)?;
        let expected = centre(&epochs, forgetting)?;
        let mut filter = GainFilter::new(&expected[0], forgetting)?;
        let mut largest = 0.0f64;
        for (models, expected) in epochs.models.iter().zip(&expected).skip(1) {
            filter.update(models)?;
            let x = (filter.estimate() - &expected.x).amax();
            largest = largest.max(x).max((filter.covariance() - &expected.covariance).amax());
        }
        // Biases of metres, condition of N below 1e4, 3e4 updates of 1e-16 each: far below 1e-10.
        if largest > 1e-10 {
            return Err(format!("forms differ by {largest}, forgetting {forgetting}").into());
        }
    }
    Ok(())
}

/// The largest |x_i - x| / (3 sigma) of nodes and parameters at each epoch. A node is given its filter at each
/// epoch by `renew`; its parameters are read by `read`.
fn run<P: Proximal>(
    epochs: &Epochs,
    forgetting: f64,
    iterations: usize,
    mut nodes: Vec<Node<P>>,
    renew: impl Fn(&InformationFilter, &mut Node<P>) -> Result<(), NetworkError>,
    read: impl Fn(&[f64]) -> Option<DVector<f64>> + Sync,
) -> Result<Vec<f64>, NetworkError> {
    let centre = centre(epochs, forgetting)?;
    let mut filters = vec![InformationFilter::new(SATELLITES, forgetting)?; STATIONS];
    let mut deviations = Vec::new();
    for (models, centre) in epochs.models.iter().zip(centre) {
        for ((filter, model), node) in filters.iter_mut().zip(models).zip(&mut nodes) {
            filter.update(&model.normals());
            renew(filter, node)?;
        }
        (0..iterations).for_each(|_| sim::iterate(&mut nodes));
        let allowed = centre.sigma() * 3.0;
        let estimates: Vec<&[f64]> = nodes.iter().map(Node::estimate).collect();
        let off = |estimate: &&[f64]| {
            let x = read(estimate)?;
            Some((x - &centre.x).component_div(&allowed).amax())
        };
        let off = estimates.par_iter().map(|e| off(e).unwrap_or(f64::INFINITY));
        deviations.push(off.reduce(|| 0.0, f64::max));
    }
    Ok(deviations)
}

/// By averages of the normal equations, rho 3.
fn averages(seed: u64, count: usize, forgetting: f64, k: usize) -> Result<Vec<f64>, NetworkError> {
    let epochs = epochs(seed, count)?;
    let own = info::pack(&Normals::none(SATELLITES));
    let node = |id| {
        let problem = Average { own: own.clone(), rho: 3.0 };
        Node::new(id, &epochs.constraints, problem, NodeOptions::default())
    };
    let nodes = (0..STATIONS).map(node).collect::<Result<_, _>>()?;
    let renew = |filter: &InformationFilter, node: &mut Node<Average>| {
        filter.renew_average(node);
        Ok(())
    };
    let read = |mean: &[f64]| {
        let mean = info::unpack(mean, SATELLITES).ok()?;
        Some(mean.solve(Datum::Observed).ok()?.x)
    };
    run(&epochs, forgetting, k, nodes, renew, read)
}

/// By the paper's solver, W growing with the epoch.
fn agreements(
    seed: u64,
    count: usize,
    forgetting: f64,
    k: usize,
) -> Result<Vec<f64>, NetworkError> {
    let epochs = epochs(seed, count)?;
    let links = |id| epochs.constraints.hubs_of(id).len();
    let node = |id| {
        let weight = Weight::Scalar(RHO);
        let problem = NodeLeastSquares::new(Normals::none(SATELLITES), &weight, links(id))?;
        Node::new(id, &epochs.constraints, problem, NodeOptions::default())
    };
    let nodes = (0..STATIONS).map(node).collect::<Result<_, _>>()?;
    let renew = |filter: &InformationFilter, node: &mut Node<NodeLeastSquares>| {
        let links = links(node.id());
        filter.renew_least_squares(node, RHO, links)
    };
    let read = |x: &[f64]| Some(DVector::from_row_slice(x));
    run(&epochs, forgetting, k, nodes, renew, read)
}

/// The first epoch, from 1, from which on all are below 1.
fn below_from(deviations: &[f64]) -> usize {
    deviations.iter().rposition(|d| *d >= 1.0).map_or(1, |k| k + 2)
}

#[test]
fn a_few_iterations_an_epoch_keep_every_node_near_the_centre() -> Tested {
    // What an independent implementation reached on a network of its own: five averages an epoch are below 1 at
    // every epoch and at 0.043 in the end, for which 0.06 is allowed. Of four networks here one may miss that at
    // its first epoch, where five iterations of about 0.7 each leave a sixth of the disagreement; ten may not.
    let good = |deviations: &[f64]| below_from(deviations) == 1 && deviations[299] <= 0.06;
    let trial = |(seed, k)| averages(seed, 300, 1.0, k);
    let trials = [(1, 10), (1, 5), (2, 5), (3, 5), (4, 5)];
    let averaged: Vec<Vec<f64>> = trials.into_par_iter().map(trial).collect::<Result<_, _>>()?;
    for ((seed, k), deviations) in trials.iter().zip(&averaged) {
        let shown = [0, 9, 49, 299].map(|epoch| deviations[epoch]);
        println!("seed {seed}, {k} averages: {shown:.3?}, below 1 from {}", below_from(deviations));
    }
    if !good(&averaged[0]) || averaged[1..].iter().filter(|d| good(d)).count() < 3 {
        return Err("averages stray from the centre".into());
    }
    // The same by ten iterations of the paper's solver: below 1 from epoch 16, for which 45 is allowed.
    let agreed = agreements(1, 300, 1.0, 10)?;
    let shown = [0, 9, 49, 299].map(|epoch| agreed[epoch]);
    println!("ten agreements: {shown:.3?}, below 1 from {}", below_from(&agreed));
    if below_from(&agreed) > 45 {
        return Err(format!("agreements are below 1 from epoch {}", below_from(&agreed)).into());
    }
    Ok(())
}

#[test]
fn a_few_iterations_an_epoch_suffice_with_forgetting() -> Tested {
    // An effective length of 20 epochs: each epoch is forgotten before the bounds above begin to hold.
    let averaged = averages(2, 120, 0.95, 5)?;
    let agreed = agreements(2, 120, 0.95, 10)?;
    if below_from(&averaged) > 1 || below_from(&agreed) > 45 {
        return Err(format!("{} {}", below_from(&averaged), below_from(&agreed)).into());
    }
    Ok(())
}
