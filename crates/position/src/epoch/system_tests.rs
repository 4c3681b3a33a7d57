//! Epochs of one system, of several, and of a system with one satellite, of known truth.

use super::*;
use crate::simulated::{Truth, navigation_data};
use crate::solve_static;
use sdr_rx_gnss::signal::{GALILEO_E1B, GALILEO_E1C};
use sdr_rx_gnss::{Constellation, Ephemeris, Transmission};

/// The constellation with satellites of another system in place of those that `others` chooses.
fn mixed(system: Constellation, others: impl Fn(u8) -> bool) -> NavigationData {
    let gps = navigation_data();
    let mut nav = NavigationData::default();
    nav.ionosphere = gps.ionosphere;
    for ephemeris in gps.iter() {
        let number = ephemeris.sv.number();
        let sv = Sv::new(system, number).filter(|_| others(number)).unwrap_or(ephemeris.sv);
        nav.insert(Ephemeris { sv, ..ephemeris.clone() });
    }
    nav
}

fn truth() -> Truth {
    Truth { bias_s: 2e-3, drift_sps: 1e-7, ..Truth::at_rest() }
}

/// Observations whose ranges of one system are longer by `offset_m`.
fn observed(nav: &NavigationData, system: Constellation, offset_m: f64) -> ObservationEpoch {
    let mut epoch = truth().observe(nav, &PositioningOptions::default(), 0.1);
    for o in epoch.observations.iter_mut().filter(|o| o.sv().constellation() == system) {
        if let Some(CodeRange::Pseudorange(range_m)) = &mut o.range {
            *range_m += offset_m;
        }
    }
    epoch
}

/// Simulated ranges are exact to rounding; dilutions of place and time are below 10.
const EXACT_M: f64 = 1e-3;

#[test]
fn one_system_alone_gives_place_time_bias_and_their_deviations() {
    let options = PositioningOptions::default();
    let gps = solve_epoch(
        &observed(&navigation_data(), Constellation::Sbas, 0.0),
        &navigation_data(),
        &options,
    )
    .unwrap();
    let nav = mixed(Constellation::Galileo, |_| true);
    let epoch = observed(&nav, Constellation::Galileo, 0.0);
    let fix = solve_epoch(&epoch, &nav, &options).unwrap();
    assert!((fix.position_m - truth().position_m).norm() < EXACT_M);
    let bias_s = fix.clock_bias_s.unwrap();
    assert!((bias_s - truth().bias_s).abs() * SPEED_OF_LIGHT < EXACT_M);
    assert!((fix.time - truth().time).abs() < EXACT_M / SPEED_OF_LIGHT);
    assert!(fix.integrity.is_proved() && fix.offsets.is_empty());
    assert_eq!((fix.reference, gps.reference), (Constellation::Galileo, Constellation::Gps));
    // The geometry is the same but for the constants of the systems; deviations of a range differ by those of orbits
    // (0.4 of 0.7 m) beside metres of the ionosphere.
    let ratio = fix.clock_bias_sigma_s.unwrap() / gps.clock_bias_sigma_s.unwrap();
    assert!((0.8..1.0).contains(&ratio), "{ratio}");
    let (at_rest, _) = solve_static(&[epoch], &nav, &options, &mut |_, _| ()).unwrap();
    assert!((at_rest.position_m - truth().position_m).norm() < EXACT_M);
}

#[test]
fn offsets_between_systems_are_found_with_their_deviations() {
    let options = PositioningOptions::default();
    for (system, number) in [(Constellation::Galileo, 1), (Constellation::BeiDou, 0)] {
        // Numbers 1 to 5 and 59 to 63 of BeiDou are of another kind of orbit.
        let nav = mixed(system, |n| n % 2 == number && n > 5);
        let epoch = observed(&nav, system, 40.0);
        let fix = solve_epoch(&epoch, &nav, &options).unwrap();
        assert!((fix.position_m - truth().position_m).norm() < EXACT_M, "{system:?}");
        let [offset] = fix.offsets[..] else { panic!("{:?}", fix.offsets) };
        assert_eq!((offset.system, fix.reference), (system, Constellation::Gps));
        assert!((offset.offset_s * SPEED_OF_LIGHT - 40.0).abs() < EXACT_M, "{offset:?}");
        // The variance of a difference of correlated biases lies below the sum of those of both alone.
        let of = |systems: &str| {
            let options = PositioningOptions { systems: systems.parse().unwrap(), ..options };
            solve_epoch(&epoch, &nav, &options).map(|fix| fix.clock_bias_sigma_s.unwrap())
        };
        let letter = system.letter().to_string();
        if let (Ok(gps), Ok(other)) = (of("G"), of(&letter)) {
            assert!(offset.sigma_s > 0.0 && offset.sigma_s < gps.hypot(other));
        }
    }
}

/// Its range and its clock cancel, whatever it is; excluding it, or the whole system, changes nothing.
#[test]
fn a_system_with_one_satellite_does_no_harm() {
    let gps_only = |epoch: &ObservationEpoch, nav: &NavigationData| {
        let systems = "G".parse().unwrap();
        let options = PositioningOptions { systems, ..PositioningOptions::default() };
        solve_epoch(epoch, nav, &options).unwrap()
    };
    let all = truth().observe(&navigation_data(), &PositioningOptions::default(), 0.1);
    for o in &all.observations {
        let nav = mixed(Constellation::Galileo, |n| n == o.sv().number());
        for offset_m in [0.0, 3e5] {
            let epoch = observed(&nav, Constellation::Galileo, offset_m);
            let fix = solve_epoch(&epoch, &nav, &PositioningOptions::default()).unwrap();
            let alone = gps_only(&epoch, &nav);
            assert!((fix.position_m - alone.position_m).norm() < EXACT_M, "{}", o.sv());
            // But for the weight that nothing adds.
            assert!((fix.covariance - alone.covariance).norm() < 1e-6 * alone.covariance.norm());
            assert_eq!(fix.residuals.len() + fix.excluded.len(), alone.residuals.len() + 1);
        }
    }
}

/// Without a third of GPS, five satellites of two systems would be needed.
#[test]
fn too_few_satellites_of_two_systems_are_counted_with_both_clocks() {
    let nav = mixed(Constellation::Galileo, |n| n % 2 == 0);
    let mut epoch = observed(&nav, Constellation::Galileo, 0.0);
    let is_galileo = |o: &Observation| o.sv().constellation() == Constellation::Galileo;
    let galileo = epoch.observations.iter().filter(|o| is_galileo(o)).take(1).cloned();
    let gps = epoch.observations.iter().filter(|o| !is_galileo(o)).take(3).cloned();
    epoch.observations = gps.chain(galileo).collect();
    let error = solve_epoch(&epoch, &nav, &PositioningOptions::default()).unwrap_err();
    assert!(error.to_string().contains("4 usable satellites, a position needs 5"), "{error}");
}

#[test]
fn one_signal_of_a_satellite_is_used_and_the_next_where_that_cannot_be() {
    let nav = mixed(Constellation::Galileo, |_| true);
    let mut epoch = observed(&nav, Constellation::Galileo, 0.0);
    let sv = epoch.observations[0].sv();
    assert_eq!(epoch.observations[0].transmission.signal, &GALILEO_E1C);
    let both = epoch.observations[0].clone();
    epoch.observations[0].transmission = Transmission { sv, signal: &GALILEO_E1B };
    // The data component is wrong: the pilot goes before it.
    epoch.observations[0].range = Some(CodeRange::Pseudorange(1e7));
    epoch.observations.insert(1, both);
    let fix = solve_epoch(&epoch, &nav, &PositioningOptions::default()).unwrap();
    assert!((fix.position_m - truth().position_m).norm() < EXACT_M);
    let count = fix.residuals.iter().filter(|r| r.sv == sv).count();
    assert!(count == 1 && fix.unused.is_empty() && fix.excluded.is_empty());
    // A pilot without range leaves the data component.
    epoch.observations[0].range = epoch.observations[1].range.take();
    let data = epoch.observations[0].range;
    epoch.observations[0].range = data.map(|_| CodeRange::Pseudorange(1e7));
    let fix = solve_epoch(&epoch, &nav, &PositioningOptions::default()).unwrap();
    assert_eq!(fix.excluded, [sv], "the data component was tried");
}

#[test]
fn a_satellite_of_an_unknown_frequency_channel_is_dropped_with_the_reason() {
    let mut nav = navigation_data();
    let mut epoch = observed(&nav, Constellation::Galileo, 0.0);
    let sv: Sv = "R05".parse().unwrap();
    let state = nav.iter().next().unwrap().state(truth().time);
    let glonass = sdr_rx_gnss::GlonassEphemeris {
        sv,
        tb: truth().time,
        sent: None,
        clock_bias_s: 0.0,
        clock_drift_sps: 0.0,
        position_m: state.position_m,
        velocity_mps: state.velocity_mps,
        acceleration_mps2: Vector3::zeros(),
        health: 0,
        channel: None,
        age_days: 0,
    };
    nav.insert_glonass(glonass);
    let transmission = sdr_rx_gnss::signal::of(sv);
    epoch.observations.push(Observation { transmission, ..epoch.observations[0].clone() });
    let fix = solve_epoch(&epoch, &nav, &PositioningOptions::default()).unwrap();
    let dropped = [Dropped { sv, reason: DropReason::UnknownChannel }];
    assert_eq!(fix.unused, dropped);
    nav.glonass_channels.insert(sv, 6);
    let fix = solve_epoch(&epoch, &nav, &PositioningOptions::default()).unwrap();
    assert!(fix.unused.iter().all(|d| d.reason != DropReason::UnknownChannel));
}
