//! Positioning alone, without a sample: the bare iteration from the Earth's centre, and the receiver's
//! full model: `cargo run --release --example position_from_observations`

use nalgebra::Vector3;
use sdr_rx::gnss::constants::SPEED_OF_LIGHT;
use sdr_rx::gnss::observation::{CodeRange, Observation, ObservationEpoch};
use sdr_rx::gnss::signal::{self, L1_WAVELENGTH};
use sdr_rx::position::solver::aw_dgn_bt::aw_dgn_bt;
use sdr_rx::position::{PositioningOptions, Row, Satellite, solve_epoch};
use sdr_rx::scenario::{SatelliteTruth, Scenario, ScenarioSource};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/signals/circle_8sv.toml");
    let scenario = Scenario::read(path.as_ref())?;
    let truth = ScenarioSource::new(&scenario)?.truth_at(0);
    let error_m = |p: &Vector3<f64>| (p - Vector3::from(truth.position_ecef_m)).norm();

    // The bare algorithm: where the satellites were, and how far away.
    let rows: Vec<Row> = truth
        .satellites
        .iter()
        .map(|s| {
            let position_m = s.position_ecef_m.into();
            let range_m = s.range_m + truth.clock_bias_s * SPEED_OF_LIGHT;
            Row::range(Satellite { position_m, velocity_mps: Vector3::zeros() }, range_m)
        })
        .collect();
    let bare = aw_dgn_bt(&rows)?;
    let bare_m = error_m(&bare.state.position_m);
    println!("bare: {} iterations, off by {bare_m:.1e} m", bare.iterations);

    // The receiver's: pseudoranges as measured, orbits as broadcast, atmosphere modelled.
    let observation = |s: &SatelliteTruth| Observation {
        transmission: signal::of(s.sv),
        range: Some(CodeRange::Pseudorange(s.pseudorange_m)),
        range_sigma_m: 1.0,
        doppler_hz: Some(s.doppler_hz),
        doppler_sigma_hz: 0.1 / L1_WAVELENGTH,
        carrier_phase_cycles: None,
        lost_lock: false,
        cn0_dbhz: Some(s.cn0_dbhz),
    };
    let epoch = ObservationEpoch {
        receive_time: scenario.start,
        sample: 0.0,
        observations: truth.satellites.iter().map(observation).collect(),
    };
    let fix = solve_epoch(&epoch, &scenario.navigation()?, &PositioningOptions::default())?;
    let speed = fix.velocity_mps.ok_or("no velocity")?.norm();
    let clock_bias_s = fix.clock_bias_s.ok_or("no clock")?;
    println!("full: {} iterations, off by {:.1e} m", fix.iterations, error_m(&fix.position_m));
    println!("      {speed:.3} m/s, clock {:+.3} us", clock_bias_s * 1e6);
    if bare_m > 1e-3 || error_m(&fix.position_m) > 0.1 {
        return Err("noise-free observations must give the position".into());
    }
    Ok(())
}
