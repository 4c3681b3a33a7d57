//! The paper's two studies: satellites in view of Turin, and of three sites, brought down to a hundred heights.

use super::geometry::{Shell, altitudes_m, observe, scaled_down};
use super::tally::{Tally, judge};
use nalgebra::Vector3;
use rayon::prelude::*;
use sdr_rx::gnss::constants::EARTH_RADIUS;
use sdr_rx::gnss::coordinates::Geodetic;
use sdr_rx::gnss::signal::L1_WAVELENGTH;
use sdr_rx::position::{RowKind, Satellite, Solver};

/// Name of an observable.
pub fn name(kind: RowKind) -> &'static str {
    match kind {
        RowKind::Range => "pseudorange",
        RowKind::RangeRate => "Doppler",
    }
}

/// Standard deviation of its error, m or m/s: 3 m, and 0.5 Hz.
pub fn sigma(kind: RowKind) -> f64 {
    match kind {
        RowKind::Range => 3.0,
        RowKind::RangeRate => 0.5 * L1_WAVELENGTH,
    }
}

/// The paper's choice of sites, by latitude and longitude, deg, and height, m.
pub const SITES: [(&str, [f64; 3]); 3] = [
    ("Cape Town", [-33.92899, 18.4174, 0.0]),
    ("Longyearbyen", [78.22894, 15.39493, 0.0]),
    ("Shanghai", [31.14274, 121.80411, 5.0]),
];
/// Turin, the site of the paper's first dampings, m ECEF.
const TURIN: Vector3<f64> = Vector3::new(4_472_425.929, 601_429.172, 4_492_704.238);
/// Elevation mask, rad.
const MASK: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// A receiver, and satellites in view of it at some epochs.
#[derive(Clone, Debug)]
pub struct Study {
    receiver_m: Vector3<f64>,
    epochs: Vec<Vec<(u32, Satellite)>>,
}

impl Study {
    /// Five satellites of a GPS-like constellation over Turin, 11 epochs a minute apart.
    pub fn turin() -> Self {
        let state = |k, t| (k, Shell::GPS.state(k, t));
        let epochs = (0..11).map(|minute| {
            [0, 7, 12, 16, 23].map(|k| state(k, 9000.0 + 60.0 * f64::from(minute))).to_vec()
        });
        Self { receiver_m: TURIN, epochs: epochs.collect() }
    }

    /// A site under Galileo for ten hours, with an epoch every `interval_s`.
    pub fn site(site: [f64; 3], interval_s: f64) -> Self {
        let receiver_m = Geodetic::from_degrees(site[0], site[1], site[2]).to_ecef();
        let count = (36_000.0 / interval_s) as u32;
        let epochs = (0..count)
            .map(|k| Shell::GALILEO.in_view(interval_s * f64::from(k), &receiver_m, MASK));
        Self { receiver_m, epochs: epochs.collect() }
    }

    /// What becomes of each of `solvers` at each height, errors `scale` times those of the observable: for each
    /// solver a tally a height.
    pub fn run(&self, kind: RowKind, solvers: &[Solver], scale: f64) -> Vec<Vec<Tally>> {
        let sigma = scale * sigma(kind);
        let by_height: Vec<Vec<Tally>> = altitudes_m()
            .par_iter()
            .enumerate()
            .map(|(height, altitude)| {
                let mut tallies = vec![Tally::default(); solvers.len()];
                for (epoch, in_view) in self.epochs.iter().enumerate() {
                    let radius_m = EARTH_RADIUS + altitude;
                    let low =
                        in_view.iter().map(|(_, s)| scaled_down(s, &self.receiver_m, radius_m));
                    let error = |k: usize| wave(in_view[k].0, epoch, height);
                    let rows = observe(kind, low, &self.receiver_m, sigma, error);
                    let judged = judge(solvers, &rows, &self.receiver_m, sigma);
                    tallies.iter_mut().zip(judged).for_each(|(sum, one)| *sum += one);
                }
                tallies
            })
            .collect();
        (0..solvers.len()).map(|k| by_height.iter().map(|row| row[k]).collect()).collect()
    }
}

/// A reproducible error of unit variance.
fn wave(satellite: u32, epoch: usize, height: usize) -> f64 {
    let angle =
        1.0 + 12.9898 * f64::from(satellite) + 78.233 * epoch as f64 + 37.719 * height as f64;
    2f64.sqrt() * angle.sin()
}
