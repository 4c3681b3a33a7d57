//! The full model on exact, noisy and faulty observations of known truth.

use super::predicted::Predicted;
use super::*;
use crate::simulated::{Truth, navigation_data};
use crate::{Height, Robust};
use nalgebra::{Matrix3, Vector3};
use sdr_rx_gnss::Ephemeris;
use sdr_rx_gnss::atmosphere::Troposphere;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::signal::L1_CENTRE_HZ;

const MASK: f64 = 0.1;

fn shift(epoch: &mut ObservationEpoch, index: usize, error_m: f64) -> Sv {
    let observation = &mut epoch.observations[index];
    if let Some(CodeRange::Pseudorange(range_m)) = &mut observation.range {
        *range_m += error_m;
    }
    observation.sv()
}

fn keep(epoch: &mut ObservationEpoch, count: usize) {
    epoch.observations.truncate(count);
}

#[test]
fn exact_observations_give_position_velocity_and_clock_back() {
    let nav = navigation_data();
    let rest = Truth::at_rest();
    let moving = Truth {
        velocity_mps: Vector3::new(150.0, -80.0, 120.0),
        bias_s: 0.037,
        drift_sps: 6e-6,
        ..rest
    };
    let behind = Truth { bias_s: -2.5, drift_sps: -1e-6, ..rest };
    for troposphere in [Troposphere::None, Troposphere::Saastamoinen] {
        let options = PositioningOptions { troposphere, ..Default::default() };
        for truth in [rest, moving, behind] {
            let epoch = truth.observe(&nav, &options, MASK);
            assert!(epoch.observations.len() >= 6);
            let fix = solve_epoch(&epoch, &nav, &options).unwrap();
            // The last step was below 1e-4 m; GpsTime and f64 ranges resolve 1e-8 m.
            assert!((fix.position_m - truth.position_m).norm() < 1e-4);
            assert!((fix.clock_bias_s.unwrap() - truth.bias_s).abs() * SPEED_OF_LIGHT < 1e-4);
            assert!((fix.time - truth.time).abs() * SPEED_OF_LIGHT < 1e-4);
            // Third derivative of the range times 0.5^2/6: below 1e-5 m/s.
            assert!((fix.velocity_mps.unwrap() - truth.velocity_mps).norm() < 1e-4);
            let drift_error = fix.clock_drift_sps.unwrap() - truth.drift_sps;
            assert!(drift_error.abs() * SPEED_OF_LIGHT < 1e-4);
            assert!(fix.excluded.is_empty() && fix.residuals.len() == epoch.observations.len());
            // Bancroft's solution refined, the full model, and once more above the mask.
            assert!((4..=12).contains(&fix.iterations), "{}", fix.iterations);
            assert!(fix.pdop > 1.0 && fix.pdop.hypot(0.0) >= fix.hdop.max(fix.vdop));
        }
    }
}

#[test]
fn covariance_is_that_of_a_monte_carlo() {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    let (nav, truth, options) =
        (navigation_data(), Truth::at_rest(), PositioningOptions::default());
    let exact = truth.observe(&nav, &options, MASK);
    let sigmas: Vec<(f64, Vector3<f64>)> = exact
        .observations
        .iter()
        .map(|o| {
            let ephemeris = nav.nearest(o.sv(), truth.time).unwrap();
            let predicted = Predicted::new(
                ephemeris,
                L1_CENTRE_HZ,
                &truth.position_m,
                truth.time,
                &nav,
                &options,
            );
            // What satellites share, and the rest of the model with the noise.
            let shared = predicted.direction * predicted.ionosphere_sigma_m;
            let all = o.range_sigma_m.powi(2) + predicted.range_sigma_m.powi(2);
            ((all - shared.norm_squared()).sqrt(), shared)
        })
        .collect();
    let enu = sdr_rx_gnss::coordinates::Geodetic::from_ecef(&truth.position_m).ecef_to_enu();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let (mut sum, mut predicted) = (Matrix3::zeros(), Matrix3::zeros());
    const RUNS: usize = 2000;
    for _ in 0..RUNS {
        let mut epoch = exact.clone();
        let common = Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng));
        for (index, (sigma, shared)) in sigmas.iter().enumerate() {
            let noise: f64 = StandardNormal.sample(&mut rng);
            shift(&mut epoch, index, noise * sigma + shared.dot(&common));
        }
        let fix = solve_epoch(&epoch, &nav, &options).unwrap();
        let error = enu * (fix.position_m - truth.position_m);
        sum += error * error.transpose() / RUNS as f64;
        predicted = fix.covariance;
    }
    // A sample variance of 2000 runs has a relative deviation of sqrt(2/2000) = 3 %.
    for axis in 0..3 {
        let ratio = sum[(axis, axis)] / predicted[(axis, axis)];
        assert!((ratio - 1.0).abs() < 0.13, "axis {axis}: {ratio}");
    }
}

#[test]
fn a_faulty_satellite_is_excluded_with_six_and_refused_with_five() {
    let (nav, truth, options) =
        (navigation_data(), Truth::at_rest(), PositioningOptions::default());
    let exact = truth.observe(&nav, &options, MASK);
    for error_m in [300.0, -2e3, 3e4, 3e5] {
        for index in 0..6 {
            let mut epoch = exact.clone();
            let faulty = shift(&mut epoch, index, error_m);
            let fix = solve_epoch(&epoch, &nav, &options).unwrap();
            assert_eq!(fix.excluded, [faulty], "{error_m}");
            assert!((fix.position_m - truth.position_m).norm() < 1e-4);
        }
        let mut five = exact.clone();
        keep(&mut five, 5);
        shift(&mut five, 2, error_m);
        assert!(solve_epoch(&five, &nav, &options).is_err(), "{error_m}");
    }
}

#[test]
fn a_faulty_doppler_does_not_touch_the_velocity() {
    let (nav, truth, options) =
        (navigation_data(), Truth::at_rest(), PositioningOptions::default());
    let mut epoch = truth.observe(&nav, &options, MASK);
    *epoch.observations[3].doppler_hz.as_mut().unwrap() += 25.0;
    let fix = solve_epoch(&epoch, &nav, &options).unwrap();
    assert!(fix.velocity_mps.unwrap().norm() < 1e-4);
    assert!((fix.residuals[3].doppler_hz.unwrap() - 25.0).abs() < 1e-3);
}

#[test]
fn errors_name_the_cause() {
    let (nav, truth, options) =
        (navigation_data(), Truth::at_rest(), PositioningOptions::default());
    let epoch = truth.observe(&nav, &options, MASK);
    let fails = |epoch: &ObservationEpoch, nav: &NavigationData, words: &str| {
        let message = solve_epoch(epoch, nav, &options).unwrap_err().to_string();
        assert!(message.contains(words), "'{message}' does not say '{words}'");
    };
    let mut few = epoch.clone();
    keep(&mut few, 3);
    fails(&few, &nav, "3 usable satellites, a position needs 4");
    fails(&epoch, &NavigationData::default(), "no ephemeris");
    let late = ObservationEpoch { receive_time: epoch.receive_time + 86_400.0, ..epoch.clone() };
    fails(&late, &nav, "24.2 hours from the given time");
    let mut broken = epoch.clone();
    keep(&mut broken, 4);
    broken.observations[1].range = None;
    fails(&broken, &nav, "its measurement is not a number");
    let mut ill = NavigationData::default();
    nav.iter().for_each(|e| ill.insert(Ephemeris { health: 63, ..e.clone() }));
    fails(&epoch, &ill, "unhealthy");
    let mut snapshot = epoch.clone();
    snapshot.observations.iter_mut().for_each(|o| o.range = Some(CodeRange::ModuloCodePeriod(1.0)));
    fails(&snapshot, &nav, "wrong kind");
    let high = PositioningOptions { elevation_mask: 1.2, ..options };
    let error = solve_epoch(&epoch, &nav, &high).unwrap_err().to_string();
    assert!(error.contains("below the mask"), "{error}");
    // Seen under one line of predicted: copies of one satellite under other names.
    let mut clones = NavigationData::default();
    let first = nav.nearest(epoch.observations[0].sv(), truth.time).unwrap();
    for observation in &epoch.observations {
        clones.insert(Ephemeris { sv: observation.sv(), ..first.clone() });
    }
    fails(&truth.observe(&clones, &options, MASK), &clones, "one plane");
}

#[test]
fn dopplers_alone_and_both_observables_give_position_and_drift_back() {
    let (nav, positioning) = (navigation_data(), PositioningOptions::default());
    let truth = Truth { drift_sps: 6e-6, ..Truth::at_rest() };
    let epoch = truth.observe(&nav, &positioning, MASK);
    // Dopplers are differences over a second: good to 1e-5 m/s, which dilutions of 1e4 to 1e5 s turn into 1 m.
    for (observable, limit_m) in [(Observable::Doppler, 1.0), (Observable::Both, 1e-2)] {
        for solver in [Solver::AwDgnBt, Solver::Vp] {
            let options =
                PositioningOptions { observable, solver, ..PositioningOptions::default() };
            let mut steps = 0;
            let fix = solve_traced(&epoch, &nav, &options, &mut |_| steps += 1).unwrap();
            let error_m = (fix.position_m - truth.position_m).norm();
            assert!(error_m < limit_m, "{observable:?}: {error_m}");
            let drift = fix.clock_drift_sps.unwrap() - truth.drift_sps;
            assert!(drift.abs() * SPEED_OF_LIGHT < 1e-3);
            assert_eq!((fix.start.solver, &fix.start.failed), (solver.name(), &None));
            assert!(fix.velocity_mps.is_none() && steps > 2 && steps < fix.iterations);
            assert_eq!(fix.clock_bias_s.is_none(), observable == Observable::Doppler);
        }
    }
}

#[test]
fn a_known_height_takes_the_place_of_a_satellite() {
    let (nav, truth) = (navigation_data(), Truth::at_rest());
    let options =
        PositioningOptions { observable: Observable::Doppler, ..PositioningOptions::default() };
    let mut epoch = truth.observe(&nav, &options, MASK);
    // 0.2 Hz of error, alternating.
    for (k, observation) in epoch.observations.iter_mut().enumerate() {
        *observation.doppler_hz.as_mut().unwrap() += if k % 2 == 0 { 0.2 } else { -0.2 };
    }
    let free = solve_traced(&epoch, &nav, &options, &mut |_| ()).unwrap();
    let height = Some(Height { height_m: 10.0, sigma_m: 1.0 });
    let held = PositioningOptions { height, ..options };
    let held = solve_traced(&epoch, &nav, &held, &mut |_| ()).unwrap();
    let up = |fix: &Fix| Geodetic::from_ecef(&fix.position_m).height - 10.0;
    // A standard deviation at most, against 0.04 m/s times a dilution of 1e3 s.
    assert!(up(&held).abs() < 1.0 && up(&free).abs() > 10.0, "{} {}", up(&held), up(&free));
    assert!(held.covariance[(2, 2)] < 1.0 + 1e-6, "but for rounding, that of the height");
}

#[test]
fn robust_weights_bound_what_a_faulty_satellite_does() {
    let (nav, truth) = (navigation_data(), Truth::at_rest());
    let plain = PositioningOptions { exclusion: Exclusion::Off, ..PositioningOptions::default() };
    let mut epoch = truth.observe(&nav, &plain, MASK);
    let faulty = shift(&mut epoch, 2, 300.0);
    let solve = |robust| {
        let options = PositioningOptions { robust, ..plain };
        let fix = solve_traced(&epoch, &nav, &options, &mut |_| ()).unwrap();
        ((fix.position_m - truth.position_m).norm(), fix.excluded)
    };
    let (none, huber, igg3) = (solve(Robust::None), solve(Robust::Huber), solve(Robust::Igg3));
    // Huber leaves a pull of 1.345 deviations, IGG-III nothing: exact data are found.
    assert!(none.0 > 50.0 && huber.0 < 0.5 * none.0, "{} {}", none.0, huber.0);
    assert!(igg3.0 < 1e-3, "{}", igg3.0);
    assert_eq!((none.1, huber.1, igg3.1), (vec![], vec![], vec![faulty]));
    let refuse = PositioningOptions { exclusion: Exclusion::Refuse, ..plain };
    let error = solve_traced(&epoch, &nav, &refuse, &mut |_| ()).unwrap_err().to_string();
    assert!(error.contains(&faulty.to_string()), "{error}");
}

#[test]
fn precise_orbits_alone_give_the_same_position() {
    use sdr_rx_gnss::orbit::precise::{PreciseOrbit, PrecisePoint};
    let (broadcast, truth) = (navigation_data(), Truth::at_rest());
    let options = PositioningOptions::default();
    let epoch = truth.observe(&broadcast, &options, MASK);
    let mut precise = NavigationData::default();
    precise.ionosphere = broadcast.ionosphere;
    for ephemeris in broadcast.iter() {
        let point = |k: i32| {
            let time = truth.time + 900.0 * f64::from(k) + 300.0;
            let state = ephemeris.state(time);
            let relativity =
                -2.0 / SPEED_OF_LIGHT.powi(2) * state.position_m.dot(&state.velocity_mps);
            let clock_s = Some(state.clock_bias_s - relativity);
            PrecisePoint { time, position_m: state.position_m, clock_s }
        };
        precise.insert_precise(ephemeris.sv, PreciseOrbit::new((-8..8).map(point).collect(), None));
    }
    let fix = solve_epoch(&epoch, &precise, &options).unwrap();
    // Interpolation to 2 cm and relativity to 3 cm (see there), times a dilution of 2.
    assert!((fix.position_m - truth.position_m).norm() < 0.1);
    assert!((fix.velocity_mps.unwrap() - truth.velocity_mps).norm() < 1e-3);
}

/// Four Dopplers can have two places: one of those that are named is the truth. Two that lie nearer than
/// `DISTINCT_M` count as one.
#[test]
fn four_dopplers_name_every_place_that_explains_them() {
    let (nav, truth) = (navigation_data(), Truth::at_rest());
    let options =
        PositioningOptions { observable: Observable::Doppler, ..PositioningOptions::default() };
    let sky = truth.observe(&nav, &options, MASK);
    let (mut solved, mut found) = (0, 0);
    let n = sky.observations.len();
    for set in (0..1u32 << n).filter(|set| set.count_ones() == 4) {
        let mut epoch = sky.clone();
        let mut index = 0..n;
        epoch.observations.retain(|_| index.next().is_some_and(|k| set >> k & 1 == 1));
        let Ok(fix) = solve_traced(&epoch, &nav, &options, &mut |_| ()) else { continue };
        let mut places = std::iter::once(&fix.position_m).chain(&fix.alternatives_m);
        solved += 1;
        found += usize::from(places.any(|p| (p - truth.position_m).norm() < DISTINCT_M));
    }
    assert!(solved > 100 && found == solved, "{found} of {solved}");
}

#[test]
fn another_solver_takes_over_beyond_the_altitude_wall_and_the_fix_says_so() {
    let nav = navigation_data();
    let options = PositioningOptions { max_height_m: 1e6, ..PositioningOptions::default() };
    let place = Geodetic::from_degrees(35.681298, 139.766247, 400e3);
    let truth = Truth { position_m: place.to_ecef(), ..Truth::at_rest() };
    let fix = solve_epoch(&truth.observe(&nav, &options, MASK), &nav, &options).unwrap();
    assert!((fix.position_m - truth.position_m).norm() < 1e-3);
    assert_eq!(fix.start.solver, Solver::Bancroft.name());
    let failed = fix.start.failed.unwrap();
    assert_eq!(failed.solver, Solver::AwDgnBt.name());
    let FailedStartCause::NoPlace(cause) = failed.cause else { panic!("{:?}", failed.cause) };
    assert!(cause.to_string().contains("altitude wall"), "{cause}");
    assert!(cause.iterations() < fix.start.iterations && fix.start.iterations < fix.iterations);
}
