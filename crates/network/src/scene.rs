//! A simulated network: stations in the clusters of the IGS, twelve satellites, one observation a satellite in view.
//!
//! The observation of satellite j by station i at an epoch is the combination y3 - IF - mu3 GF of its three codes
//! (Khodabandeh & Teunissen 2019, section 5), from which all but two biases is eliminated:
//! l_ij = x_j + b_i + e, with the satellite's bias x_j (m), the receiver's own b_i (m), and white noise of
//! 0.20 m sqrt(2.555) / sin(elevation), 0.32 m at the zenith.
//!
//! The paper gives neither its stations' positions nor its links; these are drawn by seed:
//! - Stations: eight clusters as dense as the IGS is (Europe most), each of a spread of some 12 degrees.
//! - Graph of 110: nine hubs, the first being station 0 and each next the one farthest from those before; every
//!   other station is linked with its nearest hub (101 links), the hubs by their shortest spanning tree (8), and
//!   the nine stations that lie most nearly between two hubs also with the second (9): 118 links, 92 stations
//!   with one. In the variant "bridges" no two hubs are linked: a station between them is, with both.
//! - Satellites: circular orbits of half a sidereal day, 55 degrees of inclination, in twelve even slots (Walker
//!   12/6/1),
//!   turned by an angle that the seed draws; elevation mask 10 degrees. Stations and angle are drawn again until
//!   each satellite is in view of five stations (two of nine) and each hub leads a station of its own. Of 110
//!   stations 0.30 x 110 x 12 = 395 observations are expected an epoch.
//! - Biases: satellites' of 1 m, receivers' of 3 m, normal.

use crate::{Datum, Graph, LinearModel, NINE_NODES, NetworkError};
use nalgebra::{DMatrix, DVector, Vector3};
use sdr_rx_gnss::constants::{EARTH_RADIUS, OMEGA_EARTH};
use sdr_rx_gnss::random::SplitMix64;
use std::f64::consts::{SQRT_2, TAU};

/// Satellites, the parameters of the network.
pub const SATELLITES: usize = 12;
/// Time between epochs, s.
pub const INTERVAL_S: f64 = 30.0;
/// Standard deviation of an undifferenced code at the zenith, m.
const CODE_SIGMA_M: f64 = 0.20;
/// Variance of the combination over that of a code (section 5 of the paper, the frequencies L1, L2, L5).
const COMBINATION: f64 = 2.555;
/// Sine of the elevation mask of 10 degrees.
const MASK: f64 = 0.173_648_177_666_930_35;
/// Radius of an orbit of half a sidereal day, m.
const ORBIT_RADIUS: f64 = 26.56e6;
/// Inclination, rad.
const INCLINATION: f64 = 55.0 * TAU / 360.0;
/// Spread of a cluster, in radii of the Earth.
const SPREAD: f64 = 0.2;
/// Constraint nodes of 110.
const HUBS: usize = 9;
const SATELLITE_BIAS_M: f64 = 1.0;
const RECEIVER_BIAS_M: f64 = 3.0;

/// Latitude and longitude (deg) of the clusters' centres, with their fraction of the stations.
const CLUSTERS: [(f64, f64, f64); 8] = [
    (48.0, 12.0, 0.28),    // Europe
    (40.0, -98.0, 0.20),   // North America
    (36.0, 120.0, 0.13),   // East Asia
    (-28.0, 140.0, 0.11),  // Australia
    (-18.0, -58.0, 0.10),  // South America
    (-10.0, 28.0, 0.07),   // Africa
    (20.0, 76.0, 0.06),    // India
    (-45.0, -170.0, 0.05), // New Zealand and the South Pacific
];

/// Links of the simulated stations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NetworkLayout {
    /// 110 stations, nine hubs that are linked among themselves.
    Hubs,
    /// 110 stations, nine hubs that are linked by stations between them.
    Bridges,
    /// The nine nodes of the paper's figure 5.
    Nine,
}

/// A network, its satellites and its biases.
#[derive(Clone, Debug)]
pub struct StationScene {
    /// Links.
    pub graph: Graph,
    /// Constraint nodes: the nine hubs, or C = {1, 3, 4, 6, 9} of the paper's nine nodes, numbered from 0.
    pub hubs: Vec<usize>,
    /// Unit vectors to the stations, Earth-fixed.
    stations: Vec<Vector3<f64>>,
    /// The Earth's turn at the first epoch, rad.
    turn: f64,
    satellite_biases: Vec<f64>,
    receiver_biases: Vec<f64>,
}

/// The next normal number of variance 1: sqrt(-2 ln(1 - u1)) cos(2 pi u2).
pub fn normal(rng: &mut SplitMix64) -> f64 {
    SQRT_2 * rng.complex_normal().re
}

/// A unit vector near a position, Earth-fixed.
fn position(latitude: f64, longitude: f64, spread: f64, rng: &mut SplitMix64) -> Vector3<f64> {
    let (b, l) = (latitude.to_radians(), longitude.to_radians());
    let centre = Vector3::new(b.cos() * l.cos(), b.cos() * l.sin(), b.sin());
    (centre + spread * Vector3::from_fn(|_, _| normal(rng))).normalize()
}

impl StationScene {
    /// The network of a seed.
    ///
    /// # Errors
    /// [`NetworkError`] never for these layouts, whose graphs are connected.
    pub fn new(layout: NetworkLayout, seed: u64) -> Result<Self, NetworkError> {
        let mut rng = SplitMix64::new(seed);
        let nodes = if layout == NetworkLayout::Nine { 9 } else { 110 };
        let needed = if layout == NetworkLayout::Nine { 2 } else { 5 };
        let (stations, turn, (graph, hubs)) = loop {
            let stations: Vec<_> = (0..nodes).map(|_| station(layout, &mut rng)).collect();
            let turn = TAU * rng.uniform();
            let linked = match layout {
                NetworkLayout::Nine => (Graph::new(9, &NINE_NODES)?, vec![0, 2, 3, 5, 8]),
                NetworkLayout::Hubs | NetworkLayout::Bridges => stars(&stations, layout)?,
            };
            let (graph, hubs) = &linked;
            let led = |hub: &usize| graph.neighbours(*hub).iter().any(|&k| graph.degree(k) == 1);
            if receivers(&stations, turn).iter().all(|&count| count >= needed)
                && (layout == NetworkLayout::Nine || hubs.iter().all(led))
            {
                break (stations, turn, linked);
            }
        };
        let mut biases = |count: usize, sigma: f64| -> Vec<f64> {
            (0..count).map(|_| sigma * normal(&mut rng)).collect()
        };
        let satellite_biases = biases(SATELLITES, SATELLITE_BIAS_M);
        let receiver_biases = biases(nodes, RECEIVER_BIAS_M);
        Ok(Self { graph, hubs, stations, turn, satellite_biases, receiver_biases })
    }

    /// The Earth's turn at an epoch, rad.
    fn turn(&self, epoch: usize) -> f64 {
        self.turn + OMEGA_EARTH * INTERVAL_S * epoch as f64
    }

    /// Receivers with each satellite and another one in view.
    pub fn receivers(&self, epoch: usize) -> [usize; SATELLITES] {
        receivers(&self.stations, self.turn(epoch))
    }

    /// Standard deviation of an observation at this sine of the elevation, m.
    pub fn sigma_m(sine: f64) -> f64 {
        CODE_SIGMA_M * COMBINATION.sqrt() / sine
    }

    /// Satellites in view of a station, ascending, with the sine of their elevation.
    pub fn view(&self, station: usize, epoch: usize) -> Vec<(usize, f64)> {
        view(&self.stations[station], self.turn(epoch))
    }

    /// The network's parameters: the satellites' biases, m, less their mean or with receiver 0's added, as the
    /// datum demands.
    pub fn truth(&self, datum: Datum) -> DVector<f64> {
        let x = DVector::from_row_slice(&self.satellite_biases);
        match datum {
            Datum::Observed => x.add_scalar(self.receiver_biases[0]),
            Datum::ZeroMean => x.add_scalar(-x.mean()),
        }
    }

    /// All stations' models of an epoch, their noise from `rng`. Observation k of a station is of the k-th
    /// satellite of its [`StationScene::view`]. Where the observations are the datum, station 0's bias is taken as
    /// zero; where it is free, every station's bias is eliminated.
    pub fn models(&self, epoch: usize, datum: Datum, rng: &mut SplitMix64) -> Vec<LinearModel> {
        let mut model =
            |station: usize| {
                let view = self.view(station, epoch);
                let weights: Vec<f64> =
                    view.iter().map(|(_, sine)| Self::sigma_m(*sine).powi(-2)).collect();
                let design = DMatrix::from_fn(view.len(), SATELLITES, |k, j| {
                    if view[k].0 == j { 1.0 } else { 0.0 }
                });
                let observed = view.iter().zip(&weights).map(|((satellite, _), weight)| {
                    let bias = self.satellite_biases[*satellite] + self.receiver_biases[station];
                    bias + normal(rng) / weight.sqrt()
                });
                let observed = DVector::from_iterator(view.len(), observed);
                match datum {
                    Datum::Observed if station == 0 => {
                        LinearModel::independent(design, observed, &weights)
                    }
                    _ => LinearModel::with_receiver_bias(design, observed, &weights),
                }
            };
        (0..self.stations.len()).map(&mut model).collect()
    }
}

/// Satellites in view, with the sine of their elevation.
fn view(up: &Vector3<f64>, turn: f64) -> Vec<(usize, f64)> {
    let sine = |satellite| {
        let sight = satellite_position(satellite, turn) - up * EARTH_RADIUS;
        (satellite, sight.dot(up) / sight.norm())
    };
    (0..SATELLITES).map(sine).filter(|(_, sine)| *sine > MASK).collect()
}

fn receivers(stations: &[Vector3<f64>], turn: f64) -> [usize; SATELLITES] {
    let mut count = [0; SATELLITES];
    for view in stations.iter().map(|up| view(up, turn)).filter(|view| view.len() > 1) {
        view.iter().for_each(|(satellite, _)| count[*satellite] += 1);
    }
    count
}

/// Position of a satellite, m, Earth-fixed.
fn satellite_position(satellite: usize, turn: f64) -> Vector3<f64> {
    let (plane, slot) = ((satellite / 2) as f64, (satellite % 2) as f64);
    let node = TAU * plane / 6.0 - turn;
    let along = TAU * (slot / 2.0 + plane / 12.0) + 2.0 * turn;
    let (x, y) = (along.cos(), along.sin() * INCLINATION.cos());
    let in_space = Vector3::new(
        x * node.cos() - y * node.sin(),
        x * node.sin() + y * node.cos(),
        along.sin() * INCLINATION.sin(),
    );
    ORBIT_RADIUS * in_space
}

/// A station of a cluster, or anywhere in a network of nine.
fn station(layout: NetworkLayout, rng: &mut SplitMix64) -> Vector3<f64> {
    if layout == NetworkLayout::Nine {
        return position(0.0, 0.0, 1e6, rng);
    }
    let mut left = rng.uniform();
    let chosen = CLUSTERS.iter().find(|(_, _, fraction)| {
        left -= fraction;
        left < 0.0
    });
    let (latitude, longitude, _) = *chosen.unwrap_or(&CLUSTERS[0]);
    position(latitude, longitude, SPREAD, rng)
}

/// Hubs with the stations about them, and the hubs' tree; 118 links of 110 stations with nine hubs.
fn stars(
    stations: &[Vector3<f64>],
    layout: NetworkLayout,
) -> Result<(Graph, Vec<usize>), NetworkError> {
    let bridges = layout == NetworkLayout::Bridges;
    let angle = |a: usize, b: usize| stations[a].angle(&stations[b]);
    let nearest = |station: usize, hubs: &[usize]| {
        hubs.iter().map(|&hub| angle(station, hub)).fold(f64::INFINITY, f64::min)
    };
    let mut hubs = vec![0];
    while hubs.len() < HUBS {
        let by_distance = |a: &usize, b: &usize| nearest(*a, &hubs).total_cmp(&nearest(*b, &hubs));
        hubs.extend((0..stations.len()).max_by(by_distance));
    }
    let others: Vec<usize> = (0..stations.len()).filter(|k| !hubs.contains(k)).collect();
    // Each station's hubs, nearest first.
    let ranked = |station: usize| {
        let mut ranked = hubs.clone();
        ranked.sort_by(|&a, &b| angle(station, a).total_cmp(&angle(station, b)));
        ranked
    };
    let mut links: Vec<(usize, usize)> = others.iter().map(|&k| (ranked(k)[0], k)).collect();

    let mut joined = vec![hubs[0]];
    while joined.len() < hubs.len() {
        let open = hubs.iter().filter(|hub| !joined.contains(hub));
        let pairs = open.flat_map(|&to| joined.iter().map(move |&from| (from, to)));
        let shortest = pairs.min_by(|p, q| angle(p.0, p.1).total_cmp(&angle(q.0, q.1)));
        let Some((a, b)) = shortest else { break };
        joined.push(b);
        let between = |k: &usize| angle(*k, a) + angle(*k, b);
        let free = others.iter().filter(|k| {
            let mut own = links.iter().filter(|link| link.1 == **k);
            own.next().is_some_and(|(hub, _)| *hub == a || *hub == b) && own.next().is_none()
        });
        match free.min_by(|p, q| between(p).total_cmp(&between(q))).filter(|_| bridges) {
            Some(&k) => links.extend([(a, k), (b, k)]),
            None => links.push((a, b)),
        }
        links.sort_unstable();
        links.dedup();
    }

    let mut seconds: Vec<usize> = others.clone();
    let tie = |&k: &usize| angle(k, ranked(k)[1]) - angle(k, ranked(k)[0]);
    seconds.retain(|k| links.iter().filter(|link| link.1 == *k).count() == 1);
    seconds.sort_by(|a, b| tie(a).total_cmp(&tie(b)));
    let missing = (stations.len() + HUBS - 1).saturating_sub(links.len());
    links.extend(seconds.iter().take(missing).map(|&k| (ranked(k)[1], k)));
    hubs.sort_unstable();
    Ok((Graph::new(stations.len(), &links)?, hubs))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::choose;
    use crate::{Constraints, Normals};

    #[test]
    fn normals_are_those_of_the_reference() {
        // Printed by an independent implementation of the generator.
        let mut rng = SplitMix64::new(1);
        assert!((normal(&mut rng) + 0.034_267_321_791_851_144).abs() < 1e-15);
        assert!((normal(&mut rng) + 2.500_067_493_369_867_7).abs() < 1e-14);
    }

    #[test]
    fn the_networks_have_the_paper_s_counts() {
        for seed in 1..=10 {
            for (layout, leaves) in [(NetworkLayout::Hubs, 92), (NetworkLayout::Bridges, 84)] {
                let scene = StationScene::new(layout, seed).unwrap();
                let graph = &scene.graph;
                assert_eq!((graph.nodes(), graph.links().count()), (110, 118));
                assert_eq!(choose(graph).unwrap().hubs().len(), 9);
                assert_eq!((0..110).filter(|&k| graph.degree(k) == 1).count(), leaves);
                let stars = Constraints::new(graph, &scene.hubs).unwrap();
                assert_eq!((stars.hubs().len(), stars.cover_every_link(graph)), (9, true));
                let linked =
                    |a: &usize| scene.hubs.iter().any(|b| graph.neighbours(*a).contains(b));
                assert_eq!(scene.hubs.iter().any(linked), layout == NetworkLayout::Hubs);
            }
        }
    }

    #[test]
    fn the_estimate_is_right_within_its_covariance_and_the_satellites_move() {
        for (layout, datum) in [
            (NetworkLayout::Hubs, Datum::Observed),
            (NetworkLayout::Hubs, Datum::ZeroMean),
            (NetworkLayout::Nine, Datum::ZeroMean),
        ] {
            let (mut squares, mut degrees) = (0.0, 0.0);
            for seed in 1..=20 {
                let scene = StationScene::new(layout, seed).unwrap();
                let models = scene.models(0, datum, &mut SplitMix64::new(seed));
                let mut sum = Normals::none(SATELLITES);
                models.iter().for_each(|model| sum.add(&model.normals()));
                let solution = sum.solve(datum).unwrap();
                let error = &solution.x - scene.truth(datum);
                // Under N, the error's square is chi-square of as many degrees as are estimable.
                squares += error.dot(&(&sum.matrix * &error));
                degrees += (SATELLITES - datum.defect()) as f64;
            }
            // 20 draws: mean `degrees`, variance 2 `degrees`; four sigma.
            assert!(
                (squares - degrees).abs() < 4.0 * (2.0 * degrees).sqrt(),
                "{squares} {degrees}"
            );
        }
        let scene = StationScene::new(NetworkLayout::Hubs, 1).unwrap();
        assert_ne!(scene.receivers(0), scene.receivers(299));
    }
}
