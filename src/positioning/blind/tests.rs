//! Monte Carlo over places, times of a day or a week, subsets of satellites, clocks and noise.

use super::super::synthetic::{Truth, navigation_data_of_hours};
use super::super::{PositioningOptions, solve_snapshot};
use super::*;
use crate::gnss::coordinates::Geodetic;
use crate::observables::Observation;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::super::coarse_time::CODE_PERIOD_M;

/// One class of snapshots.
#[derive(Clone, Copy, Debug)]
struct Class {
    satellites: usize,
    doppler_sigma_hz: f64,
    code_sigma_m: f64,
    /// Length of the navigation data, h.
    hours: u32,
    /// Hours of the week in which the snapshots are taken.
    taken: (f64, f64),
    /// How far the time may be off, s; infinite for no time at all.
    uncertainty_s: f64,
}

/// A random snapshot of the class, with its truth; `None` if too few satellites are in view.
fn draw(class: &Class, nav: &NavigationData, seed: u64) -> Option<(Truth, ObservationEpoch)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let latitude = rng.random_range(-0.98f64..0.98).asin();
    let longitude = rng.random_range(-180.0..180.0);
    let place =
        Geodetic::from_degrees(latitude.to_degrees(), longitude, rng.random_range(0.0..2e3));
    let base = Truth::at_rest();
    let week = GpsTime::from_week_tow(base.time.week(), 0.0);
    let truth = Truth {
        time: week + 3600.0 * rng.random_range(class.taken.0..class.taken.1),
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
    epoch.observations.sort_by_key(|o| o.sv);
    let off_s = if class.uncertainty_s.is_finite() { class.uncertainty_s } else { 0.0 };
    epoch.receive_time = epoch.receive_time + rng.random_range(-1.0..1.0) * off_s;
    Some((truth, epoch))
}

#[derive(Debug, Default)]
struct Tally {
    runs: usize,
    right: usize,
    unproved: usize,
    ambiguous: usize,
    unexplained: usize,
    weak: usize,
    other: usize,
    wrong: usize,
    median_m: f64,
    median_time_s: f64,
    most_false: f64,
    cpu_s: f64,
    worst_cpu_s: f64,
}

fn tally(class: Class, runs: u64) -> Tally {
    let nav = navigation_data_of_hours(class.hours);
    let sky = navigation_data_of_hours(class.hours.max(class.taken.1 as u32));
    let options =
        SnapshotOptions { time_uncertainty_s: class.uncertainty_s, ..SnapshotOptions::default() };
    let results: Vec<_> = (0..runs)
        .into_par_iter()
        .filter_map(|seed| Some((seed, draw(&class, &sky, seed)?)))
        .map(|(seed, (truth, epoch))| {
            let start = std::time::Instant::now();
            let fix = solve_snapshot(&epoch, &nav, &options);
            (seed, truth, fix, start.elapsed().as_secs_f64())
        })
        .collect();
    let mut tally = Tally { runs: results.len(), ..Tally::default() };
    let (mut errors, mut times) = (Vec::new(), Vec::new());
    for (seed, truth, fix, seconds) in results {
        tally.cpu_s += seconds / tally.runs as f64;
        tally.worst_cpu_s = tally.worst_cpu_s.max(seconds);
        match fix {
            Ok(fix) => {
                let far_m = (fix.position_m - truth.position_m).norm();
                let off_s = (fix.time - truth.time).abs();
                let expected = fix.time_search.map_or(0.0, |s| s.false_expected);
                tally.most_false = tally.most_false.max(expected);
                errors.push(far_m);
                times.push(off_s);
                if far_m <= 1500.0 && off_s <= 1.0 {
                    tally.right += 1;
                } else {
                    println!(
                        "wrong: seed {seed} {class:?}: {far_m:.0} m {off_s:.1} s, {expected:.1e}"
                    );
                    tally.wrong += 1;
                }
            }
            Err(PositioningError::Unproved { .. }) => tally.unproved += 1,
            Err(PositioningError::Ambiguous { .. }) => tally.ambiguous += 1,
            Err(PositioningError::TimeNotFound { .. }) => {
                if std::env::var_os("SHOW").is_some() {
                    println!("unexplained: seed {seed}");
                }
                tally.unexplained += 1
            }
            Err(PositioningError::DegenerateGeometry { .. }) => tally.weak += 1,
            Err(cause) => {
                println!("{cause}");
                tally.other += 1
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    times.sort_by(f64::total_cmp);
    tally.median_m = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
    tally.median_time_s = times.get(times.len() / 2).copied().unwrap_or(f64::NAN);
    tally
}

#[test]
#[ignore = "minutes"]
fn table() {
    let env = |name: &str, default: &str| std::env::var(name).unwrap_or(default.to_owned());
    let list = |text: String| -> Vec<f64> { text.split(',').map(|s| s.parse().unwrap()).collect() };
    let runs = env("RUNS", "200").parse().unwrap();
    for hours in list(env("HOURS", "24")) {
        for doppler_sigma_hz in list(env("HZ", "1,5,25")) {
            for satellites in list(env("M", "5,6,7,8,10")) {
                let class = Class {
                    satellites: satellites as usize,
                    doppler_sigma_hz,
                    code_sigma_m: 15.0,
                    hours: hours as u32,
                    taken: (
                        env("FROM", "0").parse().unwrap(),
                        env("TO", &hours.to_string()).parse().unwrap(),
                    ),
                    uncertainty_s: env("U", "inf").parse().unwrap(),
                };
                let t = tally(class, runs);
                println!("{hours} h {doppler_sigma_hz} Hz m={satellites}: {t:?}");
            }
        }
    }
}

/// How far the ranges of the real sky are from repeating.
#[test]
#[ignore = "data"]
fn alias_spread() {
    let nav = crate::gnss::rinex_nav::read("/work/shared/nav/brdc0010.22n").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut all = Vec::new();
    for k in [1, 2] {
        let mut rms = Vec::new();
        for _ in 0..200 {
            let latitude = rng.random_range(-0.98f64..0.98).asin();
            let longitude: f64 = rng.random_range(-180.0..180.0);
            let place = Geodetic::from_degrees(latitude.to_degrees(), longitude, 0.0).to_ecef();
            let t0 = GpsTime::from_week_tow(2190, 518_400.0);
            let t = t0 + rng.random_range(0.0..(86400.0 - 43082.0 * f64::from(k)));
            let turned = if k == 1 { Vector3::new(-place.x, -place.y, place.z) } else { place };
            let t2 = t + f64::from(k) * ALIAS_S;
            let mut system = super::super::least_squares::LeastSquares::<5>::default();
            let mut rows = Vec::new();
            let options = PositioningOptions::default();
            for sv in nav.satellites() {
                let (Some(a), Some(b)) = (nav.ephemeris(sv, t), nav.ephemeris(sv, t2)) else {
                    continue;
                };
                let a = super::super::sight::Sight::new(a, &place, t, &nav, &options);
                let b = super::super::sight::Sight::new(b, &turned, t2, &nav, &options);
                if a.elevation < 0.1 {
                    continue;
                }
                let g = -b.direction;
                let rate = b.range_rate(&Vector3::zeros(), 0.0);
                let row = DopplerState::new(g.x, g.y, g.z, 1.0, rate);
                system.push(&row, a.range_m - b.range_m);
                rows.push((row, a.range_m - b.range_m));
            }
            if rows.len() < 7 {
                continue;
            }
            let n = rows.len();
            let x = system.solve().unwrap().x;
            let cost: f64 = rows.iter().map(|(r, y)| (y - r.dot(&x)).powi(2)).sum();
            rms.push((cost / (n - 5) as f64).sqrt());
        }
        rms.sort_by(f64::total_cmp);
        let n = rms.len();
        println!(
            "k {k}: n {n} rms p5 {:.0} median {:.0} p95 {:.0}",
            rms[n / 20],
            rms[n / 2],
            rms[n * 19 / 20]
        );
        all.push(rms);
    }
}
