//! A newcomer's mistakes: when next to nothing is acquired, the capture is read in other ways, and where
//! one of them shows a sky full of satellites, it is named.

use crate::acquisition::{SearchOptions, SearchPlan, remove_shadows};
use crate::capture::{Block, OpenOptions, SampleSource};
use crate::front_end::{Conditioner, LevelMeter};
use crate::gnss::constants::CA_CHIP_RATE;

/// Fewer satellites than this call for advice.
pub const FEW: usize = 4;

/// Signal that each way of reading is judged by, s: two windows of 10 ms and a margin.
pub const LOOK_S: f64 = 0.025;

/// Sample types that are mistaken for each other.
const TYPES: [&str; 9] = ["cs8", "cu8", "cs16", "cf32", "rs8", "rs16", "b1", "b2", "rb2"];

/// Sampling rates in use, Hz.
const RATES: [f64; 25] = [
    2e6, 2.046e6, 2.048e6, 2.4e6, 2.5e6, 2.6e6, 3e6, 4e6, 4.092e6, 5e6, 5.456e6, 6e6, 8e6, 8.184e6,
    10e6, 12e6, 12.5e6, 15e6, 16e6, 16.367e6, 16.368e6, 20e6, 24e6, 25e6, 26e6,
];

/// Widest Doppler of a poor oscillator (10 ppm and the satellites' own), Hz.
const WIDE_HZ: f64 = 21e3;

/// A way of reading a capture that differs from the one that was asked for.
#[derive(Clone, Debug, PartialEq)]
pub enum Reading {
    /// As asked for.
    AsGiven,
    /// Another sample type.
    Format(&'static str),
    /// Another sampling rate, Hz.
    Rate(f64),
    /// Another intermediate frequency, Hz.
    IntermediateFrequency(f64),
    /// The same, searched for Dopplers up to [`WIDE_HZ`].
    WideDoppler,
}

impl Reading {
    /// Changes options for opening a capture.
    pub fn apply(&self, options: &mut OpenOptions) {
        match *self {
            Self::Format(format) => options.format = Some(format.to_owned()),
            Self::Rate(rate_hz) => options.rate_hz = Some(rate_hz),
            Self::IntermediateFrequency(if_hz) => options.if_hz = Some(if_hz),
            Self::AsGiven | Self::WideDoppler => {}
        }
    }

    fn option(&self) -> String {
        match self {
            Self::Format(format) => format!("--format {format}"),
            Self::Rate(rate_hz) => format!("--rate {rate_hz}"),
            Self::IntermediateFrequency(if_hz) => format!("--if {if_hz}"),
            Self::WideDoppler => format!("--doppler-max {WIDE_HZ}"),
            Self::AsGiven => String::new(),
        }
    }
}

/// Opens the capture in another way; None where that is impossible.
pub type Open<'a> = dyn Fn(&Reading) -> Option<Box<dyn SampleSource>> + 'a;

/// What is probably wrong, and what to try. `found` satellites were found as the capture was read.
pub fn advise(open: &Open, search: &SearchOptions, found: usize) -> Vec<String> {
    let mut advice = Vec::new();
    let Some(source) = open(&Reading::AsGiven) else { return advice };
    let info = source.info().clone();
    let search =
        SearchOptions { false_alarm: 1e-3, coherent_ms: 10, max_windows: 2, ..search.clone() };
    let mut readings: Vec<Reading> = vec![Reading::WideDoppler];
    readings.extend(TYPES.iter().filter(|t| **t != info.format).map(|t| Reading::Format(t)));
    readings.extend(
        RATES.iter().filter(|r| (*r / info.rate_hz - 1.0).abs() > 1e-9).map(|&r| Reading::Rate(r)),
    );
    let frequencies =
        [0.0, -info.if_hz, info.rate_hz / 4.0, -info.rate_hz / 4.0, 420e3, 4.092e6, 2.42e6, 3e6];
    let other = |f: &&f64| (**f - info.if_hz).abs() > 1.0 && f.abs() < 0.6 * info.rate_hz;
    readings.extend(frequencies.iter().filter(other).map(|&f| Reading::IntermediateFrequency(f)));
    let best = readings
        .into_iter()
        .filter_map(|reading| {
            let mut search = search.clone();
            if reading == Reading::WideDoppler {
                search.doppler_hz = (-WIDE_HZ, WIDE_HZ);
            }
            let count = satellites(open(&reading)?, &search)?;
            Some((reading, count))
        })
        .max_by_key(|(_, count)| *count);
    match best {
        Some((reading, count)) if count >= FEW && count > found => {
            advice.push(format!("{count} satellites are there with {}: try it", reading.option()));
        }
        _ => advice.push(
            "next to no satellite was found, in any usual sample type, rate or intermediate frequency: was the antenna connected and under the sky, and the receiver tuned to 1575.42 MHz? `sdr-rx info` shows level and spectrum".to_owned(),
        ),
    }
    advice.extend(level_doubts(open));
    advice
}

/// Number of satellites in the first samples of a source.
fn satellites(mut source: Box<dyn SampleSource>, search: &SearchOptions) -> Option<usize> {
    let info = source.info().clone();
    if info.rate_hz < 2.0 * CA_CHIP_RATE * 0.97 {
        return None;
    }
    let decimation = ((info.rate_hz / 4e6) as usize).max(1);
    let mut conditioner = Conditioner::new(&info, decimation);
    let (mut raw, mut block) = (Block::default(), Block::default());
    source.read(&mut raw, (LOOK_S * info.rate_hz) as usize).ok()?;
    conditioner.process(&raw, &mut block);
    let plan = SearchPlan::new(conditioner.info().rate_hz, search.clone()).ok()?;
    let samples = if block.channels() > 0 { block.channel(0) } else { &[] };
    let mut found = plan.search(samples).ok()?;
    remove_shadows(&mut found, search.coherent_ms, plan.windows(samples.len()));
    Some(found.len())
}

/// What the level statistics of the capture as given say against its sample type.
fn level_doubts(open: &Open) -> Vec<String> {
    let doubts = || {
        let mut source = open(&Reading::AsGiven)?;
        let (rate_hz, real) = (source.info().rate_hz, source.info().real);
        let mut raw = Block::default();
        source.read(&mut raw, (LOOK_S * rate_hz) as usize).ok()?;
        let mut meter = LevelMeter::default();
        meter.add(raw.channel(0));
        Some(meter.level(real)?.doubts())
    };
    doubts().unwrap_or_default()
}
