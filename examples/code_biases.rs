//! Nine stations without a centre find the code biases of eight satellites, each with its covariance:
//! `cargo run --release --example code_biases`

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use sdr_rx::network::code_bias::*;
use sdr_rx::network::consensus::{Node, NodeOptions};
use sdr_rx::network::{Datum, Graph, Normals, constraints, info, plan, sim};

const SATELLITES: usize = 8;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Truth, and each station's observations: five satellites, with a bias of its own and noise.
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let biases_m: Vec<f64> = (0..SATELLITES).map(|_| random.sample(StandardNormal)).collect();
    let sigma_m = ZENITH_SIGMA_M * Carriers::GPS.variance_factor().sqrt();
    let mut stations = Vec::new();
    for station in 0..9 {
        let receiver_m: f64 = 3.0 * random.sample::<f64, _>(StandardNormal);
        let mut observe = |k: usize| {
            let satellite = (station + k * (k + 1) / 2) % SATELLITES;
            let elevation_rad = random.random_range(0.2..1.5);
            let noise_m = sigma_m / elevation_weight(elevation_rad).sqrt();
            let noise_m = noise_m * random.sample::<f64, _>(StandardNormal);
            let combination_m = biases_m[satellite] + receiver_m + noise_m;
            BiasObservation { satellite, combination_m, elevation_rad }
        };
        let seen: Vec<_> = (0..5).map(&mut observe).collect();
        let bias = ReceiverBias::Eliminated;
        let model = station_model(&seen, SATELLITES, &Carriers::GPS, ZENITH_SIGMA_M, bias)?;
        stations.push(model.normals());
    }

    // A ring with two chords; rho and alpha follow from the graph.
    let ring: Vec<_> = (0..9).map(|k| (k, (k + 1) % 9)).chain([(0, 4), (2, 7)]).collect();
    let constraints = constraints::choose(&Graph::new(9, &ring)?)?;
    let plan = plan::plan(&constraints)?;
    let options = NodeOptions { relaxation: plan.relaxation, ..NodeOptions::default() };
    let mut nodes = Vec::new();
    for (id, station) in stations.iter().enumerate() {
        let average = info::Average { own: info::pack(station), rho: plan.rho };
        nodes.push(Node::new(id, &constraints, average, options)?);
    }
    let iterations = plan.iterations(1e-9);
    (0..iterations).for_each(|_| sim::iterate(&mut nodes));

    let mut sum = Normals::none(SATELLITES);
    stations.iter().for_each(|station| sum.add(station));
    let centre = sum.solve(Datum::ZeroMean)?;
    let mean = info::unpack(nodes[8].estimate(), SATELLITES)?;
    let node = mean.scaled(9.0).solve(Datum::ZeroMean)?;
    println!("after {iterations} iterations (m):\n     truth   centre   node 8   sigma");
    let free = biases_m.iter().sum::<f64>() / SATELLITES as f64;
    for (k, (truth, sigma)) in biases_m.iter().zip(&node.sigma()).enumerate() {
        println!("  {:8.4} {:8.4} {:8.4} {sigma:7.4}", truth - free, centre.x[k], node.x[k]);
    }
    assert!((&node.x - &centre.x).amax() < 1e-6, "the node's solution must be the centre's");
    Ok(())
}
