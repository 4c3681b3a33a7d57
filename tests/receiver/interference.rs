//! Interference over the noise of one antenna: a fix as without it, no false satellite, and its name.

use crate::common::{Failed, Tested};
use crate::program::median;
use sdr_rx::capture::SampleSource;
use sdr_rx::front_end::InterfererKind;
use sdr_rx::receiver::{self, ReceiverOptions, Record};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::path::Path;

/// Three subframes and some fixes.
const SECONDS: f64 = 22.0;

/// The record of the static scenario with this jammer in eight bits of 32 steps rms, and the errors of its fixes, m.
fn received(jammer: &str) -> Result<(Record, Vec<f64>), Failed> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("signals/static_8sv.toml");
    let text = std::fs::read_to_string(path)?;
    let (before, _) = text.split_once("[front_end]").ok_or("no front end")?;
    let jammer =
        format!("[[jammer]]\n{jammer}\ndirection.sky = {{ azimuth_deg = 0, elevation_deg = 5 }}\n");
    let front_end = "[front_end]\nrate_hz = 2.6e6\nbits = 8\nrms_steps = 32.0\n";
    let mut scenario = Scenario::parse(&format!("{before}\n{jammer}{front_end}"), "jammed.toml")?;
    scenario.duration_s = SECONDS;
    let mut source = ScenarioSource::new(&scenario)?;
    let mut options =
        ReceiverOptions { time: source.info().start_time, ..ReceiverOptions::default() };
    options.positioning.troposphere = scenario.atmosphere.troposphere;
    let record = receiver::process(&mut source, &options, &mut |_| ())?;
    let truth_m = scenario.receiver.position.ecef();
    let errors = record.fixes.iter().map(|f| (f.position_m - truth_m).norm()).collect();
    Ok((record, errors))
}

/// All eight satellites and no other; every second has its fix. Without interference the median error is 1.1 m; half a
/// decibel, or two and a half by a converter of 32 steps (10 lg(1 + 1 / 12 s^2), s^2 the noise's variance), costs a third
/// of that.
fn check(jammer: &str, is_named: impl Fn(&InterfererKind) -> bool) -> Tested {
    let (record, errors) = received(jammer)?;
    let named: Vec<String> = record.interferers.iter().map(ToString::to_string).collect();
    let (count, middle) = (errors.len(), median(errors));
    println!("{named:?}: {count} fixes, median {middle:.2} m");
    let known = record.acquisitions.len() == 8 && record.scenario_satellites_only();
    let first = record.interferers.first().ok_or("nothing was found")?;
    if known && count >= 19 && middle < 1.5 && is_named(&first.kind) {
        Ok(())
    } else {
        Err(format!("{} satellites, {count} fixes, {middle} m", record.acquisitions.len()).into())
    }
}

/// The satellites of the scenario.
trait Known {
    fn scenario_satellites_only(&self) -> bool;
}

impl Known for Record {
    fn scenario_satellites_only(&self) -> bool {
        const THERE: [&str; 8] = ["G01", "G02", "G05", "G10", "G14", "G17", "G18", "G21"];
        self.acquisitions.iter().all(|a| THERE.contains(&a.acquisition.sv().to_string().as_str()))
    }
}

#[test]
fn a_continuous_wave_of_30_db() -> Tested {
    check("kind = \"cw\"\npower_db = 30.0\nfrequency_hz = 12300.0", |kind| match kind {
        InterfererKind::Tone { frequency_hz } => (frequency_hz - 12.3e3).abs() < 50.0,
        _ => false,
    })
}

#[test]
fn a_sweep_of_20_db() -> Tested {
    let is_sweep = |kind: &InterfererKind| matches!(kind, InterfererKind::Sweep { .. });
    check("kind = \"chirp\"\npower_db = 20.0\nsweep_hz = 2e6\nperiod_s = 1e-3", is_sweep)
}

#[test]
fn narrow_noise_of_20_db() -> Tested {
    let jammer = "kind = \"noise\"\npower_db = 20.0\nwidth_hz = 3e4";
    check(jammer, |kind| !matches!(kind, InterfererKind::Offset))
}
