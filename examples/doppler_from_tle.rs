//! A position from ten seconds of Doppler of low satellites whose orbits are two-line element sets.
//!
//! `cargo run --release --example doppler_from_tle [-- ELEMENTS.tle]`; without a file: a shell made here.

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use sdr_rx::gnss::coordinates::{Geodetic, azimuth_elevation};
use sdr_rx::gnss::format::tle;
use sdr_rx::position::{Row, RowKind, Satellite, Solver};

/// Error of a range rate, m/s (0.5 Hz at L1), and drift of the receiver's oscillator, m/s.
const SIGMA_MPS: f64 = 0.1;
const DRIFT_MPS: f64 = 140.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let elements = match std::env::args().nth(1) {
        Some(path) => tle::read(path)?,
        None => tle::parse(&(0..720).map(element_set).collect::<String>(), "the shell made here")?,
    };
    let start = elements.first().ok_or("the file holds no element set")?.epoch;
    let here = Geodetic::from_degrees(48.1372, 11.5755, 560.0).to_ecef();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let mut rows = Vec::new();
    for second in 0..10 {
        for element in &elements {
            let tle::EcefState { position_m, velocity_mps } =
                element.state(start + f64::from(second))?;
            if azimuth_elevation(&here, &position_m).1 > 25f64.to_radians() {
                let satellite = Satellite { position_m, velocity_mps };
                let noise: f64 = rng.sample(StandardNormal);
                let rate = RowKind::RangeRate.see(&satellite, &here).value;
                let rate = rate + DRIFT_MPS + SIGMA_MPS * noise;
                rows.push(Row::range_rate(satellite, rate).with_sigma(SIGMA_MPS));
            }
        }
    }
    let found = Solver::Best.solve(&rows, |_| ())?;
    let error_m = (found.state.position_m - here).norm();
    let sigma_m = found.covariance.trace().sqrt();
    println!("{} Dopplers, {} iterations from the Earth's centre", rows.len(), found.iterations);
    println!("{error_m:.1} m off, deviation {sigma_m:.1} m; drift {:.2} m/s", found.state.clock());
    assert!(error_m < 4.0 * sigma_m);
    Ok(())
}

/// Element set of satellite `k` of a shell of 720 in 36 planes at 550 km, 53 degrees.
fn element_set(k: u32) -> String {
    let (number, node, anomaly) = (10_000 + k, 10 * (k / 20), 18 * (k % 20) + 9 * (k / 20 % 2));
    let lines = [
        format!("1 {number}U 26001A   26204.50000000  .00000000  00000-0  00000-0 0  999"),
        format!(
            "2 {number}  53.0000 {node:3}.0000 0001000   0.0000 {anomaly:3}.0000 15.05000000    1"
        ),
    ];
    let digit = |c: char| c.to_digit(10).unwrap_or(u32::from(c == '-'));
    let checksum = |line: &String| line.chars().map(digit).sum::<u32>() % 10;
    lines.iter().map(|line| format!("{line}{}\n", checksum(line))).collect()
}
