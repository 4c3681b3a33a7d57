//! A custom front end on each of four antenna elements: comparators of I and Q, one bit, with thresholds whose
//! offset grows from element to element. Without offset it loses 10 log10(pi / 2) = 1.96 dB.

use num_complex::Complex32;
use sdr_rx::acquisition::{SearchOptions, SearchPlan};
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::gnss::signal;
use sdr_rx::scenario::{FrontEnd, Scenario, ScenarioSource};

/// Gives the signs of I and Q against a threshold that grows with the channel.
struct Comparator;

impl FrontEnd for Comparator {
    fn process(&mut self, channel: usize, samples: &mut [Complex32]) {
        let sign = |x: f32| (x - 0.3 * channel as f32).signum();
        samples.iter_mut().for_each(|s| *s = Complex32::new(sign(s.re), sign(s.im)));
    }
}

fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let mut scenario = Scenario::parse(include_str!("../signals/ula4.toml"), "ula4.toml")?;
    scenario.noise.impulse_probability = 0.0;
    scenario.front_end.bits = None;
    let ideal = ScenarioSource::new(&scenario)?;
    let own = ScenarioSource::with_front_end(&scenario, Box::new(Comparator))?;
    let satellites = ideal.satellites().map(signal::of).collect();
    let options = SearchOptions { satellites, max_windows: 8, ..SearchOptions::default() };
    let plan = SearchPlan::new(ideal.info().rate_hz, options)?;
    for (name, mut source) in [("no quantiser", ideal), ("comparator", own)] {
        let mut block = Block::default();
        source.read(&mut block, 1 << 18)?;
        for channel in 0..block.channels() {
            let found = plan.search(block.channel(channel))?;
            let mean = found.iter().map(|a| a.cn0_dbhz).sum::<f64>() / found.len() as f64;
            println!("{name}, element {channel}: {} satellites, {mean:.2} dB-Hz", found.len());
        }
    }
    Ok(())
}
