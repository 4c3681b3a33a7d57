//! Monte Carlo over places, subsets of satellites, clocks and time errors.

use super::super::PositioningOptions;
use super::super::synthetic::{Truth, navigation_data};
use super::*;
use crate::observables::Observation;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// One class of snapshots.
#[derive(Clone, Copy)]
struct Class {
    satellites: usize,
    doppler_sigma_hz: f64,
    code_sigma_m: f64,
    /// False acquisitions among the satellites.
    false_ones: usize,
}

/// A random snapshot of the class, with its truth; `None` if too few satellites are in view.
fn draw(class: &Class, nav: &NavigationData, seed: u64) -> Option<(Truth, ObservationEpoch)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let latitude = rng.random_range(-0.98f64..0.98).asin();
    let longitude = rng.random_range(-180.0..180.0);
    let place =
        Geodetic::from_degrees(latitude.to_degrees(), longitude, rng.random_range(0.0..2e3));
    let base = Truth::at_rest();
    let truth = Truth {
        time: base.time + rng.random_range(-3600.0..3600.0),
        position_m: place.to_ecef(),
        bias_s: rng.random_range(-5e-4..5e-4),
        drift_sps: rng.random_range(-3e-6..3e-6),
        ..base
    };
    let mut epoch = truth.observe(nav, &PositioningOptions::default(), 5f64.to_radians());
    epoch.observations.shuffle(&mut rng);
    if epoch.observations.len() < class.satellites {
        return None;
    }
    epoch.observations.truncate(class.satellites);
    let mut noise = |sigma: f64| {
        let z: f64 = StandardNormal.sample(&mut rng);
        z * sigma
    };
    for Observation { range, range_sigma_m, doppler_hz, doppler_sigma_hz, .. } in
        &mut epoch.observations
    {
        if let CodeRange::Pseudorange(range_m) = *range {
            let phase_m = (range_m + noise(class.code_sigma_m)).rem_euclid(CODE_PERIOD_M);
            *range = CodeRange::ModuloCodePeriod(phase_m);
        }
        *doppler_hz += noise(class.doppler_sigma_hz);
        *range_sigma_m = class.code_sigma_m;
        *doppler_sigma_hz = class.doppler_sigma_hz;
    }
    for observation in epoch.observations.iter_mut().take(class.false_ones) {
        observation.range = CodeRange::ModuloCodePeriod(rng.random_range(0.0..CODE_PERIOD_M));
        observation.doppler_hz = rng.random_range(-5e3..5e3);
    }
    epoch.observations.sort_by_key(|o| o.sv);
    epoch.receive_time = epoch.receive_time + rng.random_range(-60.0..60.0);
    Some((truth, epoch))
}

/// What became of the snapshots of a class.
#[derive(Debug, Default)]
struct Outcome {
    runs: usize,
    right: usize,
    wrong: usize,
    median_m: f64,
    time_p95_s: f64,
}

fn outcome(class: Class, runs: u64) -> Outcome {
    let nav = navigation_data();
    let options = SnapshotOptions::default();
    let errors: Vec<Option<(f64, f64)>> = (0..runs)
        .into_par_iter()
        .filter_map(|seed| draw(&class, &nav, seed))
        .map(|(truth, epoch)| {
            let fix = solve_snapshot(&epoch, &nav, &options).ok()?;
            Some(((fix.position_m - truth.position_m).norm(), (fix.time - truth.time).abs()))
        })
        .collect();
    let quantile = |mut values: Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values.get((values.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN)
    };
    let found: Vec<(f64, f64)> = errors.iter().copied().flatten().collect();
    let right = found.iter().filter(|e| e.0 <= 500.0 && e.1 <= 0.5).count();
    Outcome {
        runs: errors.len(),
        right,
        wrong: found.len() - right,
        median_m: quantile(found.iter().map(|e| e.0).collect(), 0.5),
        time_p95_s: quantile(found.iter().map(|e| e.1).collect(), 0.95),
    }
}

#[test]
fn explore() {
    for (satellites, doppler_sigma_hz) in
        [(5, 10.0), (6, 10.0), (6, 25.0), (7, 25.0), (8, 10.0), (8, 25.0), (8, 50.0)]
    {
        let class = Class { satellites, doppler_sigma_hz, code_sigma_m: 15.0, false_ones: 0 };
        let now = std::time::Instant::now();
        println!("{satellites} {doppler_sigma_hz} {:?} {:?}", outcome(class, 300), now.elapsed());
    }
    for false_ones in [1, 2] {
        let class = Class { satellites: 9, doppler_sigma_hz: 10.0, code_sigma_m: 15.0, false_ones };
        let now = std::time::Instant::now();
        println!("false {false_ones} {:?} {:?}", outcome(class, 60), now.elapsed());
    }
}
