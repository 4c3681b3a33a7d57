//! A position from a tenth of a second: acquisition, refinement, code phases modulo 1 ms, coarse time.
//!
//! `cargo run --release --example snapshot_fix`

use sdr_rx::acquisition::snapshot_epoch;
use sdr_rx::acquisition::{Refiner, SearchOptions, SearchPlan};
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::correlator::{CodeTable, SampleBuffer};
use sdr_rx::position::{PositioningOptions, solve_snapshot};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::error::Error;

/// Error of the time given to the receiver, s.
const WRONG_BY_S: f64 = 47.0;

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/signals/circle_8sv.toml");
    let mut scenario = Scenario::read(path.as_ref())?;
    scenario.front_end.if_hz = 0.0;
    let mut source = ScenarioSource::new(&scenario)?;
    let rate_hz = source.info().rate_hz;
    let mut block = Block::default();
    let samples = source.read(&mut block, (0.1 * rate_hz) as usize)? as u64;

    // Coarse: all codes, all Dopplers. Fine: each satellite over the whole tenth of a second.
    let found = SearchPlan::new(rate_hz, SearchOptions::default())?.search(block.channel(0))?;
    let mut buffer = SampleBuffer::default();
    buffer.push(block.channel(0));
    let refiner = Refiner::new(&buffer, rate_hz, 0, samples);
    let refined: Vec<_> = found
        .iter()
        .filter_map(|a| refiner.refine(a, &CodeTable::new(a.transmission, rate_hz), 100.0))
        .collect();

    let epoch = snapshot_epoch(&refined, scenario.start + WRONG_BY_S, samples, rate_hz);
    let options = PositioningOptions { user_speed_mps: 20.0, ..PositioningOptions::default() };
    let fix = solve_snapshot(&epoch, &scenario.navigation()?, &options)?;

    let truth = source.truth_at(samples / 2);
    let error_m = (fix.position_m - nalgebra::Vector3::from(truth.position_ecef_m)).norm();
    println!("{} satellites, {} linearisations", fix.residuals.len(), fix.iterations);
    println!("position off by {error_m:.1} m, PDOP {:.1}", fix.pdop);
    println!(
        "time off by {:+.4} s, given with an error of {WRONG_BY_S} s",
        fix.time.tow() - truth.tow_s
    );
    if error_m > 100.0 {
        return Err("worse than 100 m".into());
    }
    Ok(())
}
