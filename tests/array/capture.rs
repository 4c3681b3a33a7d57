//! Signals by their code periods in the capture of an independent simulator: 2 x 2 elements, 2 MHz, 45 dB-Hz,
//! clean noise.

use crate::common::{Failed, Tested, data};
use sdr_rx::array::code_periods::{CodePeriodLook, CodePeriodOptions, search_code_periods};
use sdr_rx::capture::{self, Block, OpenOptions};
use serde_json::Value;
use std::path::Path;

#[test]
fn code_periods_of_20_ms_of_the_independent_simulator_show_its_satellites() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    shows(d, 20)
}

#[test]
fn code_periods_of_100_ms_of_the_independent_simulator_show_its_satellites() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    shows(d, 100)
}

fn look(data: &Path, ms: usize) -> Result<CodePeriodLook, Failed> {
    let path = data.join("captures/sim_array4_2MHz_0.5s_cs8.bin");
    let options = OpenOptions {
        format: Some("cs8".into()),
        rate_hz: Some(2e6),
        channels: Some(4),
        ..OpenOptions::default()
    };
    let mut source = capture::open(&[path], &options)?;
    let mut block = Block::default();
    source.read(&mut block, 2000 * ms).map_err(|e| e.to_string())?;
    let channels: Vec<_> = (0..4).map(|m| block.channel(m)).collect();
    Ok(search_code_periods(&channels, 2e6, 0, &CodePeriodOptions::new(4, ms))?)
}

/// Every satellite above 5 degrees, at its code phase and Doppler, and no false one.
fn shows(data: &Path, ms: usize) -> Tested {
    let text = std::fs::read_to_string(data.join("captures/sim_array4_2MHz_0.5s_cs8.json"))?;
    let truth: Value = serde_json::from_str(&text)?;
    let truth = truth["satellites"].as_object().ok_or("the truth lists no satellites")?;
    let look = look(data, ms)?;
    println!(
        "rank {}, transforms {} of {}",
        look.svd.division.rank, look.transforms, look.full_search_transforms
    );
    let mut errors = Vec::new();
    for found in &look.found {
        let a = &found.acquisition;
        let Some(expected) = truth.get(&a.sv().prn().to_string()) else {
            errors.push(format!("{} is false: {a:?}", a.sv()));
            continue;
        };
        let number = |key: &str| expected[key].as_f64().unwrap_or(f64::NAN);
        let chips =
            (a.code_phase_chips - number("code_phase_chips") + 511.5).rem_euclid(1023.0) - 511.5;
        let hertz = a.doppler_hz - number("doppler_hz");
        println!(
            "{} fraction {:.3} {:+.3} chips {:+.1} Hz {:.1} dB-Hz",
            a.sv(),
            found.fraction,
            chips,
            hertz,
            a.cn0_dbhz
        );
        // Half a bin (a quarter of a chip), and half the inverse of a data bit.
        if !(chips.abs() < 0.25 && hertz.abs() < 25.0) {
            errors.push(format!("{}: {chips} chips, {hertz} Hz off", a.sv()));
        }
    }
    for (prn, satellite) in truth {
        let seen = look.found.iter().any(|f| f.acquisition.sv().prn().to_string() == *prn);
        if !seen && satellite["el"].as_f64().is_some_and(|el| el > 5.0) {
            errors.push(format!("PRN {prn} was not found"));
        }
    }
    if errors.is_empty() { Ok(()) } else { Err(errors.join("; ").into()) }
}
