//! Acquisition: 20 ms of a scenario, searched for all GPS codes.
//!
//! `cargo run --release --example acquire`

use sdr_rx::acquisition::{SearchOptions, SearchPlan};
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/signals/static_8sv.toml");
    let mut source = ScenarioSource::new(&Scenario::read(path.as_ref())?)?;
    let rate_hz = source.info().rate_hz;
    let mut block = Block::default();
    source.read(&mut block, (0.02 * rate_hz) as usize)?;

    let plan = SearchPlan::new(rate_hz, SearchOptions::default())?;
    println!("sat   Doppler, Hz     code, chips    C/N0, dB-Hz   (found / true)");
    let truth = source.truth_at(0);
    for found in plan.search(block.channel(0))? {
        let Some(sv) = truth.satellites.iter().find(|s| s.sv == found.sv()) else {
            return Err(format!("{} is a false alarm", found.sv()).into());
        };
        println!(
            "{}  {:6.0} / {:6.0}  {:6.1} / {:6.1}  {:5.1} / {:4.1}",
            found.sv(),
            found.doppler_hz,
            sv.doppler_hz,
            found.code_phase_chips,
            sv.code_phase_chips,
            found.cn0_dbhz,
            sv.cn0_dbhz,
        );
    }
    Ok(())
}
