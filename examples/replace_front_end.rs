//! A front end of one's own: a comparator on each rail, one bit, and what it costs.
//!
//! `cargo run --release --example replace_front_end`

use num_complex::Complex32;
use sdr_rx::acquisition::{SearchOptions, SearchPlan};
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::scenario::{FrontEnd, Scenario, ScenarioSource};
use std::error::Error;

/// Gives the signs of I and Q, as a comparator with an offset of its threshold does.
struct Comparator {
    threshold: f32,
}

impl FrontEnd for Comparator {
    fn delay(&self) -> usize {
        0
    }

    fn process(&mut self, _channel: usize, samples: &mut [Complex32]) {
        let sign = |x: f32| (x - self.threshold).signum();
        samples.iter_mut().for_each(|s| *s = Complex32::new(sign(s.re), sign(s.im)));
    }
}

/// Mean C/N0 of the scenario's satellites in a search of 40 ms, dB-Hz, and how many it finds.
fn mean_cn0(mut source: ScenarioSource) -> Result<(f64, usize), Box<dyn Error + Send + Sync>> {
    let rate_hz = source.info().rate_hz;
    let mut block = Block::default();
    source.read(&mut block, (0.04 * rate_hz) as usize)?;
    let options = SearchOptions {
        satellites: source.satellites().collect(),
        coherent_ms: 5,
        max_windows: 8,
        ..SearchOptions::default()
    };
    let found = SearchPlan::new(rate_hz, options)?.search(block.channel(0))?;
    Ok((found.iter().map(|a| a.cn0_dbhz).sum::<f64>() / found.len() as f64, found.len()))
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/signals/static_8sv.toml");
    let mut scenario = Scenario::read(path.as_ref())?;
    scenario.front_end.bits = None;
    let (cn0, found) = mean_cn0(ScenarioSource::new(&scenario)?)?;
    println!("no quantiser:           {cn0:.2} dB-Hz, {found} satellites");
    for threshold in [0.0, 0.5, 1.0] {
        let comparator = Box::new(Comparator { threshold });
        let (cn0, found) = mean_cn0(ScenarioSource::with_front_end(&scenario, comparator)?)?;
        println!("comparator, offset {threshold:.1}: {cn0:.2} dB-Hz, {found} satellites");
    }
    println!("theory at offset 0:     a loss of 10 log10(pi / 2) = 1.96 dB");
    Ok(())
}
