//! Impulsive noise: ten percent of the samples with 50, 1000 and 10000 times the variance of the rest.

use crate::common::{Failed, Tested, data};
use crate::program::{file, median, run, vector};
use nalgebra::Vector3;
use sdr_rx::capture::{self, OpenOptions, SampleSource};
use sdr_rx::front_end::Suppression;
use sdr_rx::receiver::{self, ReceiverOptions, Record};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::path::Path;

#[test]
fn impulses_of_50_times_the_variance_cost_no_satellite() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    impulses(d, "gmm50_")
}

#[test]
fn impulses_of_1000_times_the_variance_cost_no_satellite() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    impulses(d, "gmm1000_")
}

const TOKYO: Vector3<f64> = Vector3::new(-3_959_617.5, 3_350_136.6, 3_699_531.5);
const SATELLITES: [&str; 10] =
    ["G10", "G12", "G13", "G15", "G18", "G19", "G23", "G24", "G25", "G32"];

fn arguments<'a>(capture: &'a str, command: &'a str) -> Vec<&'a str> {
    vec![command, capture, "-f", "cs8", "-r", "2.6M"]
}

fn capture_file(data: &Path, kind: &str) -> String {
    file(data, &format!("captures/sim_tokyo_2.6MHz_1s_{kind}cs8.bin"))
}

/// All satellites and no others from 20 ms; C/N0 over the second 1 dB or less below that of the same capture
/// without impulses
/// (the signals were drawn at the same C/N0 against the background; clipping of impulses only helps); the
/// snapshot's position.
fn impulses(data: &Path, kind: &str) -> Tested {
    let (name, clean) = (capture_file(data, kind), capture_file(data, ""));
    let short = run(&[&arguments(&name, "acquire")[..], &["--duration", "0.02"]].concat())?;
    let long = |name| run(&[&arguments(name, "acquire")[..], &["--seconds", "1"]].concat());
    let (impulsive, clean) = (long(&name)?, long(&clean)?);
    let losses =
        SATELLITES.map(|sv| clean.acquired(sv, "cn0_dbhz") - impulsive.acquired(sv, "cn0_dbhz"));
    let nav = file(data, "nav/brdc0010.22n");
    let options = ["--nav", &nav, "--time", "2190:525633", "--troposphere", "none"];
    let fix = run(&[&arguments(&name, "process")[..], &options].concat())?;
    let error_m =
        fix.rows("fixes").first().map_or(f64::NAN, |f| (vector(&f["ecef_m"]) - TOKYO).norm());
    println!(
        "losses {losses:.2?} dB, mean {:.2} dB; fix {error_m:.2} m",
        losses.iter().sum::<f64>() / 10.0
    );
    println!("{}", fix.json["noise"]);
    let kept = losses.iter().all(|l| *l <= 1.0) && clean.json["noise"].is_null();
    if short.satellites() == SATELLITES && kept && error_m <= 15.0 {
        Ok(())
    } else {
        Err(format!("{:?}, losses {losses:?} dB, {error_m} m", short.satellites()).into())
    }
}

#[test]
fn without_suppression_strong_impulses_hide_all_satellites() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let open = OpenOptions {
        format: Some("cs8".to_owned()),
        rate_hz: Some(2.6e6),
        duration_s: Some(0.02),
        ..OpenOptions::default()
    };
    let mut source = capture::open(&[capture_file(data, "gmm1000_").into()], &open)?;
    let options = ReceiverOptions { suppression: Suppression::Off, ..ReceiverOptions::default() };
    let outcome = receiver::acquire(source.as_mut(), &options, 0.02)?;
    let found = outcome.acquisitions.len();
    if found == 0 { Ok(()) } else { Err(format!("{found} found").into()) }
}

/// The receiver's answer to `seconds` of a shipped scenario with impulses of this ratio.
fn received(ratio: f64, seconds: f64) -> Result<(Record, Vector3<f64>), Failed> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("signals/impulsive_8sv.toml");
    let mut scenario = Scenario::read(&path)?;
    scenario.duration_s = seconds;
    scenario.noise.impulse_variance_ratio = ratio;
    let mut source = ScenarioSource::new(&scenario)?;
    let mut options =
        ReceiverOptions { time: source.info().start_time, ..ReceiverOptions::default() };
    options.positioning.troposphere = scenario.atmosphere.troposphere;
    let outcome = receiver::process(&mut source, &options, &mut |_| ())?;
    Ok((outcome, scenario.receiver.position.ecef()))
}

/// Mean C/N0 of all observations, dB-Hz.
fn cn0_dbhz(outcome: &Record) -> f64 {
    let all: Vec<f64> =
        outcome.epochs.iter().flat_map(|e| &e.observations).filter_map(|o| o.cn0_dbhz).collect();
    all.iter().sum::<f64>() / all.len() as f64
}

/// One sample in ten has 1000 times the variance of the rest: the fix as on clean noise. The theory's loss is
/// 0.48 dB; the jitter of code loop and position is that of 44.5 dB-Hz instead of 45, and the shipped scenario's
/// test derives the bound of 5 x PDOP (1.7) x 0.6 m for each fix.
#[test]
fn a_cold_start_in_strong_impulses_gives_the_position() -> Tested {
    let (clean, _) = received(1.0, 12.0)?;
    let (outcome, truth_m) = received(1000.0, 24.0)?;
    let loss_db = cn0_dbhz(&clean) - cn0_dbhz(&outcome);
    let errors: Vec<f64> = outcome.fixes.iter().map(|f| (f.position_m - truth_m).norm()).collect();
    let largest = errors.iter().copied().fold(0.0, f64::max);
    println!(
        "{} fixes, median error {:.2} m, largest {largest:.2} m, loss {loss_db:.2} dB, {:?}",
        errors.len(),
        median(errors.clone()),
        outcome.noise
    );
    let right = errors.len() >= 22
        && largest <= 8.0
        && loss_db <= 0.8
        && clean.noise.is_none()
        && outcome.noise.is_some();
    if right {
        Ok(())
    } else {
        Err(format!("{} fixes, {largest} m, {loss_db} dB", errors.len()).into())
    }
}
