//! The scenarios of the repository: simulated, received from the signals alone, compared with the
//! truth. They need no data.

use crate::common::{Failed, Tested};
use crate::program::{median, run, vector};
use sdr_rx::gnss::constants::SPEED_OF_LIGHT;
use sdr_rx::gnss::coordinates::Geodetic;
use sdr_rx::gnss::signal::{GPS_L1_CA, L1_WAVELENGTH};
use serde_json::Value;
use std::f64::consts::TAU;
use std::path::Path;

/// Three subframes of 6 s hold an ephemeris; the scenarios start with a frame.
const SECONDS: &str = "20";

/// One fix compared with the truth of the same sample.
struct Compared {
    position_m: f64,
    velocity_mps: f64,
    pdop: f64,
}

/// Simulates and receives one of the shipped scenarios.
fn compared(name: &str) -> Result<Vec<Compared>, Failed> {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("signals").join(name);
    let folder = tempfile::tempdir()?;
    let capture = folder.path().join("made.sigmf-meta").display().to_string();
    assert_cmd::Command::new(env!("CARGO_BIN_EXE_sdr-rx"))
        .arg("simulate")
        .arg(scenario)
        .args(["--duration", SECONDS, "--out", &capture])
        .unwrap();
    let truth = std::fs::read(folder.path().join("made.truth.json"))?;
    let truth: Value = serde_json::from_slice(&truth)?;
    let epochs = truth["epochs"].as_array().ok_or("no truth")?;
    let answer = run(&["process", &capture])?;
    if answer.code != 0 {
        return Err(format!("exit code {}: {}", answer.code, answer.messages()).into());
    }
    let by_default = |fix: &Value| fix["solver"] == "aw-dgn-bt" && fix["failed_solver"].is_null();
    if !answer.rows("fixes").iter().all(by_default) {
        return Err("a fix was led to by another solver than the default".into());
    }
    let compare = |fix: &Value| {
        // Fixes lie on round seconds, the truth on seconds of the receiver's clock, which is 0.12 ms off: at 25 m/s
        // that is 3 mm.
        let sample = fix["sample"].as_f64()?;
        let near = |e: &&Value| e["sample"].as_f64().is_some_and(|s| (s - sample).abs() < 1e3);
        let epoch = epochs.iter().find(near)?;
        Some(Compared {
            position_m: (vector(&fix["ecef_m"]) - vector(&epoch["position_ecef_m"])).norm(),
            velocity_mps: (vector(&fix["velocity_mps"]) - vector(&epoch["velocity_ecef_mps"]))
                .norm(),
            pdop: fix["pdop"].as_f64()?,
        })
    };
    let all: Vec<Compared> = answer.rows("fixes").iter().filter_map(compare).collect();
    // Every second has its fix, the first and the last excepted.
    if all.len() < 18 {
        return Err(format!("{} fixes compared, of {SECONDS} seconds", all.len()).into());
    }
    Ok(all)
}

/// Jitter of a delay-locked loop, m (Kaplan & Hegarty, 3rd ed., eq. 8.93, spacing 2 x 0.25 chips).
fn code_sigma_m(bandwidth_hz: f64, cn0_dbhz: f64) -> f64 {
    (bandwidth_hz * 0.5 / (2.0 * 10f64.powf(cn0_dbhz / 10.0))).sqrt() * SPEED_OF_LIGHT
        / GPS_L1_CA.chip_rate_hz
}

/// Jitter of a frequency estimate, m/s (Kaplan & Hegarty, 3rd ed., eq. 8.84, 10 ms).
fn rate_sigma_mps(bandwidth_hz: f64, cn0_dbhz: f64) -> f64 {
    L1_WAVELENGTH / (TAU * 0.01) * (4.0 * bandwidth_hz / 10f64.powf(cn0_dbhz / 10.0)).sqrt()
}

/// 45 dB-Hz and 2 bits (-0.6 dB); the loop of 0.5 Hz is four times as wide in its first second. The median
/// of a position error is below its rms, PDOP x sigma; five times that holds for each of twenty. The
/// message's steps add some 0.3 m.
#[test]
fn a_simulated_static_receiver_is_found_at_its_position() -> Tested {
    let all = compared("static_8sv.toml")?;
    let middle = median(all.iter().map(|c| c.position_m).collect());
    let largest = all.iter().map(|c| c.position_m).fold(0.0, f64::max);
    let speed = median(all.iter().map(|c| c.velocity_mps).collect());
    let pdop = all[0].pdop;
    println!("median {middle:.2} m, largest {largest:.2} m, speed {speed:.3} m/s, PDOP {pdop:.2}");
    let (steady, early) = (code_sigma_m(0.5, 44.4), code_sigma_m(2.0, 44.4));
    let right = middle < pdop * steady + 0.3
        && largest < 5.0 * pdop * early + 0.3
        && speed < pdop * rate_sigma_mps(15.0, 44.4);
    if right {
        Ok(())
    } else {
        Err(format!("median {middle} m, largest {largest} m, {speed} m/s").into())
    }
}

/// Dopplers of 10 Hz of bandwidth are good to some 0.1 m/s, which geometry turns into kilometres; with the pseudoranges
/// they may not spoil what those give.
#[test]
fn each_observable_gives_a_position_of_a_tracked_receiver_at_rest() -> Tested {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("signals/static_8sv.toml");
    let scenario = scenario.display().to_string();
    let truth = Geodetic::from_degrees(48.1372, 11.5755, 560.0).to_ecef();
    for (observable, method, bound_m) in
        [("both", "combined", 5.0), ("doppler", "doppler", f64::INFINITY)]
    {
        let answer = run(&["process", &scenario, "--observable", observable, "--solver", "vp"])?;
        let fixes = answer.rows("fixes");
        let right = |fix: &&Value| {
            let error_m = (vector(&fix["ecef_m"]) - truth).norm();
            let sigma_m = vector(&fix["sigma_m"]).norm();
            let labels = fix["method"] == method && fix["solver"] == "vp";
            labels && error_m < bound_m && error_m < 5.0 * sigma_m
        };
        let count = fixes.iter().filter(right).count();
        if fixes.len() < 18 || count < fixes.len() {
            let messages = answer.messages();
            return Err(format!("{observable}: {count} of {}: {messages}", fixes.len()).into());
        }
    }
    Ok(())
}

/// Satellites at 550 and 1200 km, whose Doppler changes by up to 500 Hz a second. The position lies within
/// four of the fix's standard deviations. A Doppler of 0.2 s is good to 0.03 Hz (Cramer-Rao, 44 dB-Hz),
/// 6 mm/s, to which the receiver adds 20 mm/s for its model: times PDOP, four standard deviations.
#[test]
fn a_fifth_of_a_second_under_low_shells_gives_position_and_velocity() -> Tested {
    for name in ["leo_550km.toml", "leo_1200km.toml"] {
        let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("signals").join(name);
        let folder = tempfile::tempdir()?;
        let made =
            |suffix: &str| folder.path().join(format!("made.{suffix}")).display().to_string();
        assert_cmd::Command::new(env!("CARGO_BIN_EXE_sdr-rx"))
            .arg("simulate")
            .arg(scenario)
            .args(["--duration", "0.2", "--out", &made("sigmf-meta")])
            .unwrap();
        let truth: Value = serde_json::from_slice(&std::fs::read(made("truth.json"))?)?;
        let here = vector(&truth["epochs"][0]["position_ecef_m"]);
        let (capture, nav) = (made("sigmf-meta"), made("nav.rnx"));
        let answer = run(&["process", &capture, "--nav", &nav, "--doppler-max", "40k"])?;
        let [fix] = answer.rows("fixes") else {
            return Err(format!("{name}: {}", answer.messages()).into());
        };
        let error = (vector(&fix["ecef_m"]) - here).norm();
        let (sigma, speed) = (vector(&fix["sigma_m"]).norm(), vector(&fix["velocity_mps"]).norm());
        let pdop = fix["pdop"].as_f64().ok_or("no PDOP")?;
        println!("{name}: {error:.2} m, sigma {sigma:.2} m, {speed:.3} m/s, PDOP {pdop:.2}");
        if error > 4.0 * sigma || speed > 4.0 * pdop * 0.021 {
            return Err(format!("{name}: {error} m, {speed} m/s").into());
        }
    }
    Ok(())
}

/// 40 dB-Hz at the horizon and more above. The turn's jerk, 0.2 m/s^3, leaves a third-order loop of 15 Hz
/// (19 rad/s) behind by 0.2 / 19^3 m: nothing. The troposphere changes by millimetres a second.
#[test]
fn a_simulated_car_on_a_circle_has_its_velocity() -> Tested {
    let all = compared("circle_8sv.toml")?;
    let middle = median(all.iter().map(|c| c.velocity_mps).collect());
    let largest = all.iter().map(|c| c.velocity_mps).fold(0.0, f64::max);
    let (pdop, sigma) = (all[0].pdop, rate_sigma_mps(15.0, 40.0));
    println!("velocity: median {middle:.3} m/s, largest {largest:.3} m/s, PDOP {pdop:.2}");
    let right = middle < pdop * sigma && largest < 5.0 * pdop * sigma;
    if right { Ok(()) } else { Err(format!("median {middle} m/s, largest {largest} m/s").into()) }
}
