//! Captures too short for their navigation message: a navigation file and the time to a minute give the fix.

use crate::common::{Failed, Tested, data};
use crate::program::median;
use nalgebra::Vector3;
use sdr_rx::capture::{self, OpenOptions, SampleSource};
use sdr_rx::gnss::GpsTime;
use sdr_rx::gnss::atmosphere::Troposphere;
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::position::{Fix, PositioningOptions};
use sdr_rx::receiver::{self, ReceiverOptions, Record};
use sdr_rx::scenario::receiver::Trajectory;
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::path::Path;

#[test]
fn snapshots_of_20_ms_give_fixes() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    windows(d, 0.02, 50, 48, 40.0)
}

#[test]
fn snapshots_of_100_ms_give_fixes() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    windows(d, 0.1, 50, 50, 20.0)
}

#[test]
fn a_snapshot_of_a_second_gives_a_fix() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    windows(d, 1.0, 1, 1, 10.0)
}

/// Position of the capture over Tokyo, and GPS time of its first sample.
pub const TOKYO: Vector3<f64> = Vector3::new(-3_959_617.5, 3_350_136.6, 3_699_531.5);
pub const TOKYO_WEEK_TOW: (i32, f64) = (2190, 525_633.0);

/// Maximum error of the time given, s; of the time found, s; and of any printed position, m.
const TIME_OFF_S: f64 = 60.0;
const TIME_S: f64 = 0.1;
const FAR_M: f64 = 500.0;

/// The receiver's answer to part of a capture, with a time that is `off_s` late.
pub fn snapshot(
    data: &Path,
    name: &str,
    open: OpenOptions,
    start: GpsTime,
    off_s: f64,
) -> Result<Record, Failed> {
    let open = OpenOptions { start_time: Some(start + off_s), ..open };
    let mut source = capture::open(&[data.join("captures").join(name)], &open)?;
    let options = ReceiverOptions {
        positioning: PositioningOptions {
            troposphere: Troposphere::None,
            ..PositioningOptions::default()
        },
        navigation: rinex_nav::read(data.join("nav/brdc0010.22n"))?.data,
        time: source.info().start_time,
        ..ReceiverOptions::default()
    };
    Ok(receiver::process(source.as_mut(), &options, &mut |_| ())?)
}

/// Position error (m) and time error (s) of a fix in a part that starts `start_s` into the capture.
fn errors(
    fix: &Fix,
    truth_m: Vector3<f64>,
    start: GpsTime,
    start_s: f64,
    rate_hz: f64,
) -> (f64, f64) {
    let true_time = start + (start_s + fix.sample / rate_hz);
    ((fix.position_m - truth_m).norm(), fix.time - true_time)
}

/// `count` windows evenly over the second, the time off by another amount in each, from -60 to 60 s.
fn windows(data: &Path, seconds: f64, count: usize, minimum: usize, median_m: f64) -> Tested {
    let start = GpsTime::from_week_tow(TOKYO_WEEK_TOW.0, TOKYO_WEEK_TOW.1);
    let rate_hz = 2.6e6;
    let (mut found, mut problems) = (Vec::new(), Vec::new());
    for k in 0..count {
        let start_s = (1.0 - seconds) * k as f64 / count.max(2).saturating_sub(1) as f64;
        // 17 has no factor in common with 49: every twenty-fourth of a minute once.
        let off_s = TIME_OFF_S * ((17 * k % 49) as f64 / 24.0 - 1.0);
        let open = OpenOptions {
            format: Some("cs8".to_owned()),
            rate_hz: Some(rate_hz),
            start_s,
            duration_s: Some(seconds),
            ..OpenOptions::default()
        };
        let outcome = snapshot(data, "sim_tokyo_2.6MHz_1s_cs8.bin", open, start, off_s)?;
        match outcome.fixes.first() {
            Some(fix) => {
                let (position_m, time_s) = errors(fix, TOKYO, start, start_s, rate_hz);
                if position_m > FAR_M || time_s.abs() > TIME_S {
                    problems.push(format!(
                        "at {start_s:.3} s, time given {off_s:+.1} s late: {position_m:.0} m, {time_s:+.3} s"
                    ));
                }
                found.push((position_m, time_s.abs()));
            }
            None => {
                println!("at {start_s:.3} s, time given {off_s:+.1} s late: {:?}", outcome.reason)
            }
        }
    }
    let middle = median(found.iter().map(|f| f.0).collect());
    let worst = found.iter().fold((0f64, 0f64), |w, f| (w.0.max(f.0), w.1.max(f.1)));
    println!(
        "{seconds} s: {} fixes of {count}, median error {middle:.1} m, maximum {:.1} m and {:.4} s",
        found.len(),
        worst.0,
        worst.1
    );
    if found.len() < minimum || middle.is_nan() || middle > median_m {
        problems.push(format!("{} fixes of {count}, median {middle:.1} m", found.len()));
    }
    if problems.is_empty() { Ok(()) } else { Err(problems.join("; ").into()) }
}

/// The first of four interleaved channels, the time half a minute off.
#[test]
fn one_channel_of_an_array_gives_a_fix_from_100_ms() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let start = GpsTime::from_week_tow(2190, 551_667.0);
    let truth_m =
        sdr_rx::gnss::coordinates::Geodetic::from_degrees(-1.292066, 36.821945, 1700.0).to_ecef();
    let rate_hz = 2e6;
    let open = OpenOptions {
        format: Some("cs8".to_owned()),
        rate_hz: Some(rate_hz),
        channels: Some(4),
        duration_s: Some(0.1),
        ..OpenOptions::default()
    };
    let outcome = snapshot(data, "sim_array4_2MHz_0.5s_cs8.bin", open, start, 30.0)?;
    let fix = outcome.fixes.first().ok_or(format!("no fix: {:?}", outcome.reason))?;
    let (position_m, time_s) = errors(fix, truth_m, start, 0.0, rate_hz);
    println!("{position_m:.1} m, {time_s:+.4} s with {} satellites", fix.residuals.len());
    let right = position_m <= 20.0 && time_s.abs() <= TIME_S;
    if right { Ok(()) } else { Err(format!("{position_m} m, {time_s} s").into()) }
}

/// Scenes of a receiver in motion, and high, of 0.1 s with nine satellites: the code phases do not know the motion.
#[test]
fn snapshots_of_moving_and_high_receivers_give_fixes() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    for name in [
        "07-snapshot-of-a-moving-receiver/v0",
        "07-snapshot-of-a-moving-receiver/v05",
        "07-snapshot-of-a-moving-receiver/v10",
        "07-snapshot-of-a-moving-receiver/v30",
        "08-snapshot-above-10km/airliner",
    ] {
        let path = d.join(format!("cases/{name}.toml"));
        let scenario = Scenario::read(&path)?;
        let trajectory = Trajectory::new(&scenario.receiver, scenario.start);
        let options = ReceiverOptions {
            navigation: scenario.navigation()?,
            time: Some(scenario.start),
            ..ReceiverOptions::default()
        };
        let mut source = ScenarioSource::new(&scenario)?;
        let record = receiver::process(&mut source, &options, &mut |_| ())?;
        let fix = record.fixes.first().ok_or(format!("{name}: {:?}", record.reason))?;
        let truth_m = trajectory.state(fix.sample / source.info().rate_hz).position_m;
        let error_m = (fix.position_m - truth_m).norm();
        let sigma_m = fix.covariance.trace().sqrt();
        println!("{name}: {error_m:.1} m, sigma {sigma_m:.1} m, {:?}", fix.integrity);
        assert!(fix.integrity.is_proved() && fix.excluded.is_empty(), "{name}");
        // Five standard deviations, and the way of half of the 0.1 s.
        let moved_m = 0.05 * trajectory.state(0.0).velocity_mps.norm();
        assert!(error_m < 5.0 * sigma_m + moved_m, "{name}: {error_m} of {sigma_m}");
    }
    Ok(())
}
