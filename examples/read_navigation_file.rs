//! Contents of a navigation file: satellites, their ephemerides, and the position of one of them.
//!
//! `cargo run --release --example read_navigation_file [FILE.rnx]`; without a file it reads one that it
//! writes from the orbits of a scenario.

use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::gnss::format::rinex_nav::write;
use sdr_rx::scenario::Scenario;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let data = match std::env::args_os().nth(1) {
        Some(path) => rinex_nav::read(path)?.data,
        None => {
            let path = concat!(env!("CARGO_MANIFEST_DIR"), "/signals/circle_8sv.toml");
            let text = write(&Scenario::read(path.as_ref())?.navigation()?);
            rinex_nav::parse(&text, "circle_8sv.rnx")?.data
        }
    };
    let satellites: Vec<String> = data.satellites().map(|sv| sv.to_string()).collect();
    println!("{} ephemerides of {}", data.iter().count(), satellites.join(" "));
    println!("ionosphere model: {}", if data.ionosphere.is_some() { "Klobuchar" } else { "none" });
    let ephemeris = data.iter().next().ok_or("no ephemeris")?;
    let state = ephemeris.state(ephemeris.toe);
    println!("{} at its reference time, {}:", ephemeris.sv, ephemeris.toe.utc_iso());
    let [x, y, z]: [f64; 3] = (state.position_m / 1e3).into();
    println!("  position {x:.1} {y:.1} {z:.1} km, ECEF");
    println!(
        "  velocity {:.3} m/s, clock {:+.3e} s",
        state.velocity_mps.norm(),
        state.clock_bias_s
    );
    Ok(())
}
