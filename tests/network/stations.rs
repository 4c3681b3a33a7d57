//! Satellite code biases of two real stations.

use crate::common::{Failed, Tested, data};
use sdr_rx::gnss::Sv;
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::network::admm::{NodeLeastSquares, Weight};
use sdr_rx::network::code_bias::ReceiverBias;
use sdr_rx::network::consensus::{Node, NodeOptions};
use sdr_rx::network::file::rinex::{
    CodeOptions, StationEpoch, satellites, station_epochs, station_normals,
};
use sdr_rx::network::{Datum, Graph, constraints, sim};

/// Base and rover of a static pair: 301 epochs of a second, C1C, C2L and C5Q.
#[test]
fn two_real_stations_find_the_same_biases_of_the_satellites() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let folder = data.join("obs/matrtklib-static");
    let navigation = rinex_nav::read(folder.join("base.nav"))?.data;
    let options = CodeOptions::default();
    let read = |name| station_epochs(&folder.join(name), &navigation, None, &options);
    let stations = [read("base.obs")?.epochs, read("rover.obs")?.epochs];
    let [base, rover] = stations.each_ref().map(satellites);
    let all = satellites(stations.iter().flatten());
    let names = |list: &[Sv]| list.iter().map(Sv::to_string).collect::<Vec<_>>().join(" ");
    println!("base {}; rover {}", names(&base), names(&rover));

    // Each station alone, the satellites in view of both, the mean of their biases zero.
    let common: Vec<Sv> = base.into_iter().filter(|sv| rover.contains(sv)).collect();
    let alone = |epochs: &[StationEpoch]| -> Result<_, Failed> {
        let eliminated = ReceiverBias::Eliminated;
        Ok(station_normals(epochs, &common, &options, eliminated)?.solve(Datum::ZeroMean)?)
    };
    let [base, rover] = [alone(&stations[0])?, alone(&stations[1])?];
    for solution in [&base, &rover] {
        let factor = solution.misfit / solution.freedom;
        println!("variance factor {factor:.3}, {} degrees of freedom", solution.freedom);
    }
    let sigma = (&base.covariance + &rover.covariance).diagonal().map(f64::sqrt);
    for (k, sv) in common.iter().enumerate() {
        let [a, b] = [base.x[k], rover.x[k]];
        println!("{sv} {a:7.3} {b:7.3} difference {:6.3} formal {:.3} m", b - a, sigma[k]);
    }
    // Multipath lasts longer than these five minutes: modelled as one error common to all epochs,
    // so that their number n improves nothing over one epoch's precision, sqrt(n) sigma; three of that.
    let epochs = stations[0].len() as f64;
    let largest = (&rover.x - &base.x).component_div(&sigma).amax();
    if stations[1].len() != 301 || epochs != 301.0 || largest > 3.0 * epochs.sqrt() {
        return Err(format!("{} epochs, {largest} sigma apart", stations[1].len()).into());
    }

    // The two as a network, by the paper's solver, against the centre.
    let p = all.len();
    let normals = |k: usize, bias| station_normals(&stations[k], &all, &options, bias);
    let eliminated = ReceiverBias::Eliminated;
    let own = [normals(0, eliminated)?, normals(1, eliminated)?];
    let mut sum = own[0].clone();
    sum.add(&own[1]);
    let centre = sum.solve(Datum::ZeroMean)?;
    let constraints = constraints::choose(&Graph::new(2, &[(0, 1)])?)?;
    let weight = Weight::Scalar(0.5 * sum.matrix.trace() / (2 * p) as f64);
    let mut nodes = Vec::new();
    for (id, own) in own.into_iter().enumerate() {
        let problem = NodeLeastSquares::new(own, &weight, constraints.hubs_of(id).len())?;
        nodes.push(Node::new(id, &constraints, problem, NodeOptions::default())?);
    }
    (0..3000).for_each(|_| sim::iterate(&mut nodes));
    let difference_m = sim::max_difference(&nodes, centre.x.as_slice());
    println!("network {difference_m:.1e} m, centre {:.3}", centre.misfit / centre.freedom);
    if difference_m > 1e-9 {
        return Err(format!("{difference_m} m from the centre").into());
    }
    Ok(())
}
