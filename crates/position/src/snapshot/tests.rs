//! Monte Carlo over places, subsets of satellites, clocks and time errors.

use super::coarse_time::CODE_PERIOD_M;
use super::*;
use crate::simulated::{Truth, navigation_data, navigation_data_of_hours};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use sdr_rx_gnss::Ephemeris;
use sdr_rx_gnss::observation::Observation;

/// One class of snapshots.
#[derive(Clone, Copy)]
struct Class {
    satellites: usize,
    doppler_sigma_hz: f64,
    code_sigma_m: f64,
    /// False acquisitions among the satellites.
    false_ones: usize,
    /// Largest error of the given time, s.
    time_error_s: f64,
}

/// A random snapshot of the class, with its truth; `None` if too few satellites are in view.
fn draw(class: &Class, nav: &NavigationData, seed: u64) -> Option<(Truth, ObservationEpoch)> {
    draw_at(class, nav, Truth::at_rest().time, seed)
}

/// The same within an hour of a time.
fn draw_at(
    class: &Class,
    nav: &NavigationData,
    time: GpsTime,
    seed: u64,
) -> Option<(Truth, ObservationEpoch)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let latitude = rng.random_range(-0.98f64..0.98).asin();
    let longitude = rng.random_range(-180.0..180.0);
    let place =
        Geodetic::from_degrees(latitude.to_degrees(), longitude, rng.random_range(0.0..2e3));
    let base = Truth::at_rest();
    let truth = Truth {
        time: time + rng.random_range(-3600.0..3600.0),
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
        if let Some(CodeRange::Pseudorange(range_m)) = *range {
            let phase_m = (range_m + noise(class.code_sigma_m)).rem_euclid(CODE_PERIOD_M);
            *range = Some(CodeRange::ModuloCodePeriod(phase_m));
        }
        *doppler_hz.as_mut().unwrap() += noise(class.doppler_sigma_hz);
        *range_sigma_m = class.code_sigma_m;
        *doppler_sigma_hz = class.doppler_sigma_hz;
    }
    for observation in epoch.observations.iter_mut().take(class.false_ones) {
        let phase_m = rng.random_range(0.0..CODE_PERIOD_M);
        observation.range = Some(CodeRange::ModuloCodePeriod(phase_m));
        observation.doppler_hz = Some(rng.random_range(-5e3..5e3));
    }
    epoch.observations.sort_by_key(|o| o.sv());
    epoch.receive_time = epoch.receive_time + rng.random_range(-1.0..1.0) * class.time_error_s;
    Some((truth, epoch))
}

/// One period too many or too few moves the place by tens of kilometres; a right set of integers at
/// the largest deviation that is printed, 300 m, by 1.5 km in five deviations.
const WRONG_INTEGER_M: f64 = 1500.0;

/// What became of the snapshots of a class.
#[derive(Debug)]
struct Outcome {
    runs: usize,
    /// Within 500 m and 0.5 s.
    right: usize,
    /// Refused because the satellites lie badly.
    weak: usize,
    /// With a wrong integer.
    wrong: usize,
    median_m: f64,
    time_p95_s: f64,
}

fn outcome(class: Class, runs: u64) -> Outcome {
    let nav = navigation_data();
    let options = PositioningOptions {
        time_uncertainty_s: class.time_error_s,
        ..PositioningOptions::default()
    };
    let results: Vec<Result<(f64, f64), PositioningError>> = (0..runs)
        .into_par_iter()
        .filter_map(|seed| draw(&class, &nav, seed))
        .map(|(truth, epoch)| {
            let fix = solve_snapshot(&epoch, &nav, &options)?;
            Ok(((fix.position_m - truth.position_m).norm(), (fix.time - truth.time).abs()))
        })
        .collect();
    let found: Vec<(f64, f64)> = results.iter().flatten().copied().collect();
    let weak = |r: &&Result<_, _>| matches!(r, Err(PositioningError::DegenerateGeometry { .. }));
    let quantile = |mut values: Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values.get((values.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN)
    };
    Outcome {
        runs: results.len(),
        right: found.iter().filter(|e| e.0 <= 500.0 && e.1 <= 0.5).count(),
        weak: results.iter().filter(weak).count(),
        wrong: found.iter().filter(|e| e.0 > WRONG_INTEGER_M).count(),
        median_m: quantile(found.iter().map(|e| e.0).collect(), 0.5),
        time_p95_s: quantile(found.iter().map(|e| e.1).collect(), 0.95),
    }
}

const CLASS: Class = Class {
    satellites: 8,
    doppler_sigma_hz: 25.0,
    code_sigma_m: 15.0,
    false_ones: 0,
    time_error_s: 60.0,
};

/// An independent numpy reference solves 99.9 % (m = 6, 10 Hz) and 99.7 to 99.9 % (25 Hz) of such
/// snapshots to 500 m and 0.5 s; its misses are weak geometries, which are refused here by name.
#[test]
fn snapshots_are_solved_from_the_earths_centre_and_no_wrong_integer_is_printed() {
    for (satellites, doppler_sigma_hz, runs) in [(6, 10.0, 1000), (7, 25.0, 300), (8, 25.0, 300)] {
        let class = Class { satellites, doppler_sigma_hz, ..CLASS };
        let outcome = outcome(class, runs);
        println!("{satellites} satellites, {doppler_sigma_hz} Hz: {outcome:?}");
        let share = |count: usize| count as f64 / outcome.runs as f64;
        assert!(share(outcome.right + outcome.weak) >= 0.995, "{outcome:?}");
        assert!(share(outcome.right) >= 0.98, "{outcome:?}");
        assert_eq!(outcome.wrong, 0, "{outcome:?}");
        // The reference: median 37 m (m = 6) and 24 m (m = 8), 95 % of times within 70 ms.
        assert!(outcome.median_m < 45.0 && outcome.time_p95_s < 0.1, "{outcome:?}");
    }
}

#[test]
fn false_acquisitions_are_excluded_and_named() {
    for (satellites, false_ones, runs) in [(8, 1, 60), (9, 2, 10)] {
        let class = Class { satellites, false_ones, doppler_sigma_hz: 5.0, ..CLASS };
        let outcome = outcome(class, runs);
        println!("{false_ones} false of {satellites}: {outcome:?}");
        // Seven true satellites are left, of which some per cent lie badly.
        assert!(outcome.right as f64 >= 0.95 * outcome.runs as f64, "{outcome:?}");
        assert_eq!(outcome.wrong, 0, "{outcome:?}");
    }
}

#[test]
fn time_may_be_five_minutes_off() {
    let class = Class { time_error_s: 300.0, doppler_sigma_hz: 5.0, ..CLASS };
    let outcome = outcome(class, 200);
    println!("five minutes: {outcome:?}");
    assert!(outcome.right as f64 >= 0.99 * outcome.runs as f64, "{outcome:?}");
    assert_eq!(outcome.wrong, 0, "{outcome:?}");
}

#[test]
fn an_oscillator_error_of_ten_kilohertz_does_not_matter() {
    let nav = navigation_data();
    let class = Class { code_sigma_m: 3.0, doppler_sigma_hz: 1.0, ..CLASS };
    let (truth, mut epoch) = (0..).find_map(|seed| draw(&class, &nav, seed)).unwrap();
    epoch.observations.iter_mut().for_each(|o| *o.doppler_hz.as_mut().unwrap() += 1e4);
    let fix = solve_snapshot(&epoch, &nav, &PositioningOptions::default()).unwrap();
    assert!((fix.position_m - truth.position_m).norm() < 100.0);
    // 10 kHz of 1575.42 MHz, to five deviations of 1 Hz times a time dilution of at most 3.
    let drift = fix.clock_drift_sps.unwrap() - truth.drift_sps;
    assert!((drift + 1e4 / 1575.42e6).abs() < 15.0 / 1575.42e6, "{drift}");
    assert_eq!(fix.method, FixMethod::Snapshot);
}

#[test]
fn what_cannot_be_solved_is_refused_with_its_cause() {
    let nav = navigation_data();
    let exact = Class { code_sigma_m: 3.0, doppler_sigma_hz: 1.0, ..CLASS };
    let (_, epoch) = (0..).find_map(|seed| draw(&exact, &nav, seed)).unwrap();
    let refusal = |epoch: &ObservationEpoch| {
        solve_snapshot(epoch, &nav, &PositioningOptions::default()).unwrap_err().to_string()
    };
    let mut few = epoch.clone();
    few.observations.truncate(4);
    assert!(refusal(&few).contains("4 usable satellites, a position needs 5"));
    let mut wrong_day = epoch.clone();
    wrong_day.receive_time = wrong_day.receive_time + 2.0 * 86_400.0;
    assert!(refusal(&wrong_day).contains("hours from the given time"));
    // An hour off, where a minute is promised: the same ephemerides, other Dopplers.
    let mut wrong_hour = epoch.clone();
    wrong_hour.receive_time = wrong_hour.receive_time + 3600.0;
    let message = refusal(&wrong_hour);
    assert!(message.contains("the time is further off"), "{message}");
    // Code phases of nothing.
    let mut random = epoch.clone();
    for (k, observation) in random.observations.iter_mut().enumerate() {
        let share = (k as f64 * 0.618).fract();
        observation.range = Some(CodeRange::ModuloCodePeriod(share * CODE_PERIOD_M));
    }
    assert!(refusal(&random).contains("no place on Earth explains the code phases"));
}

/// What became of the snapshots of one time given and one number of satellites.
#[derive(Default)]
struct Trust {
    /// Printed as verified or excluded.
    proved: usize,
    proved_wrong: usize,
    unverified: usize,
    unverified_wrong: usize,
}

/// Farther than this from the truth a place is wrong, m.
const WRONG_M: f64 = 500.0;

/// With the time right, a minute, half a day or a day off, or not given, and a wrong ephemeris in every fifth snapshot,
/// no wrong place counts as proved.
#[test]
fn a_wrong_time_or_ephemeris_makes_no_wrong_place_that_counts_as_proved() {
    // 2000 snapshots by SDR_RX_DRAWS=66.
    let draws = std::env::var("SDR_RX_DRAWS").ok().and_then(|n| n.parse().ok()).unwrap_or(8u64);
    let nav = navigation_data_of_hours(60);
    let middle = GpsTime::from_week_tow(Truth::at_rest().time.week(), 29.0 * 3600.0);
    let times = [
        ("right", Some(0.0)),
        ("60 s", Some(60.0)),
        ("12 h", Some(43_200.0)),
        ("a day", Some(86_400.0)),
        ("none", None),
    ];
    let mut far: Vec<String> = Vec::new();
    let (mut unverified, mut unverified_wrong) = (0, 0);
    for (name, off_s) in times {
        for satellites in 5..=10 {
            let class = Class { satellites, doppler_sigma_hz: 5.0, time_error_s: 0.0, ..CLASS };
            let one = |seed: u64| {
                let seed = seed + 10_000 * satellites as u64;
                let (truth, mut epoch) = draw_at(&class, &nav, middle, seed)?;
                let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xbad);
                let sign = if rng.random() { 1.0 } else { -1.0 };
                epoch.receive_time = epoch.receive_time + sign * off_s.unwrap_or(0.0);
                let mut own = nav.clone();
                if seed.is_multiple_of(5) {
                    // 270 m to 2700 km along the orbit.
                    let bad = epoch.observations[0].sv();
                    let along = sign * 10f64.powf(rng.random_range(-5.0..-1.0));
                    for ephemeris in nav.iter().filter(|e| e.sv == bad) {
                        own.insert(Ephemeris { m0: ephemeris.m0 + along, ..ephemeris.clone() });
                    }
                }
                let time_uncertainty_s = off_s.map_or(f64::INFINITY, |_| 60.0);
                let options = PositioningOptions { time_uncertainty_s, ..Default::default() };
                let fix = solve_snapshot(&epoch, &own, &options).ok();
                Some(fix.map(|f| (f.integrity, (f.position_m - truth.position_m).norm(), seed)))
            };
            let results: Vec<_> = (0..draws).into_par_iter().filter_map(one).collect();
            let runs = results.len();
            let mut trust = Trust::default();
            for (integrity, error_m, seed) in results.into_iter().flatten() {
                let wrong = usize::from(error_m > WRONG_M);
                if integrity == Integrity::Unverified {
                    trust.unverified += 1;
                    trust.unverified_wrong += wrong;
                } else {
                    trust.proved += 1;
                    trust.proved_wrong += wrong;
                    if wrong > 0 {
                        far.push(format!("{name}, {satellites}, seed {seed}: {error_m:.0} m"));
                    }
                }
            }
            let Trust { proved, proved_wrong, unverified: few, unverified_wrong: few_wrong } =
                trust;
            println!(
                "time {name}, {satellites} of {runs}: proved {proved} (wrong {proved_wrong}), unverified {few} ({few_wrong})"
            );
            unverified += trust.unverified;
            unverified_wrong += trust.unverified_wrong;
        }
    }
    assert!(far.is_empty(), "{far:?}");
    assert!(unverified_wrong * 100 <= unverified, "{unverified_wrong} of {unverified}");
}
