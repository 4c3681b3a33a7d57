//! Mistakes in options: when almost nothing is acquired, the capture is read with other options, and those that
//! show several satellites are reported.

use crate::acquisition::search::searched_signal;
use crate::acquisition::{SearchOptions, SearchPlan};
use crate::capture::{Block, OpenOptions, SampleSource, StreamInfo};
use crate::front_end::{Conditioner, ImpulseSuppressor, LevelMeter, Suppression};

/// Fewer satellites than this call for advice.
pub const FEW: usize = 4;

/// Satellites below this C/N0 do not count, dB-Hz: they may be cross-correlations of stronger ones outside
/// the search.
pub const SOUND_DBHZ: f64 = 30.0;

/// Signal that is searched with each reading, s: five windows of 4 ms and a margin.
pub const LOOK_S: f64 = 0.025;
const WINDOW_MS: usize = 4;
const WINDOWS: usize = 5;

/// Minimum rate after decimation, for a quick search without much loss, Hz.
const ENOUGH_HZ: f64 = 2.4e6;

/// Sample types that are easily confused.
const TYPES: [&str; 9] = ["cs8", "cu8", "cs16", "cf32", "rs8", "rs16", "b1", "b2", "rb2"];

/// Sampling rates in use, Hz.
const RATES: [f64; 25] = [
    2e6, 2.046e6, 2.048e6, 2.4e6, 2.5e6, 2.6e6, 3e6, 4e6, 4.092e6, 5e6, 5.456e6, 6e6, 8e6, 8.184e6,
    10e6, 12e6, 12.5e6, 15e6, 16e6, 16.367e6, 16.368e6, 20e6, 24e6, 25e6, 26e6,
];

/// Widest Doppler of a poor oscillator (13 ppm and the satellites' own), Hz.
const WIDE_HZ: f64 = 26e3;

/// A reading of a capture: options that differ from the requested ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Sample type.
    pub format: Option<&'static str>,
    /// Sampling rate, Hz.
    pub rate_hz: Option<f64>,
    /// Intermediate frequency, Hz.
    pub if_hz: Option<f64>,
    /// Dopplers are searched up to this, Hz.
    pub doppler_hz: Option<f64>,
}

impl Reading {
    /// Changes options for opening a capture.
    pub fn apply(&self, options: &mut OpenOptions) {
        options.format = self.format.map(str::to_owned).or(options.format.take());
        options.rate_hz = self.rate_hz.or(options.rate_hz);
        options.if_hz = self.if_hz.or(options.if_hz);
    }

    /// All alternative readings, the most likely first.
    fn others(info: &StreamInfo) -> Vec<Self> {
        let mut list = Vec::new();
        for format in TYPES.into_iter().filter(|t| *t != info.format) {
            // Real samples have an intermediate frequency; a quarter of the rate is the usual one.
            let needs_if = format.starts_with('r') && info.if_hz == 0.0;
            let if_hz = needs_if.then_some(info.rate_hz / 4.0);
            list.push(Self { format: Some(format), if_hz, ..Self::default() });
        }
        for rate_hz in RATES.into_iter().filter(|r| (r / info.rate_hz - 1.0).abs() > 1e-9) {
            list.push(Self { rate_hz: Some(rate_hz), ..Self::default() });
            if info.if_hz != 0.0 {
                let if_hz = Some(info.if_hz * rate_hz / info.rate_hz);
                list.push(Self { rate_hz: Some(rate_hz), if_hz, ..Self::default() });
            }
        }
        let quarter = info.rate_hz / 4.0;
        let frequencies = [0.0, quarter, 420e3, 4.092e6, 2.42e6, 3e6, -info.if_hz, -quarter];
        for if_hz in frequencies {
            if (if_hz - info.if_hz).abs() > 1.0 && if_hz.abs() < 0.6 * info.rate_hz {
                list.push(Self { if_hz: Some(if_hz), ..Self::default() });
            }
        }
        list.push(Self { doppler_hz: Some(WIDE_HZ), ..Self::default() });
        list
    }
}

/// A probable mistake, or what to try.
#[derive(Clone, Debug, PartialEq)]
pub enum Advice {
    /// With another reading the capture shows satellites.
    Read {
        /// The other reading.
        reading: Reading,
        /// Number of satellites with it.
        satellites: usize,
    },
    /// No usual reading shows satellites.
    NothingFound,
    /// Level statistics that do not fit the sample type.
    Level(String),
}

/// Opens the capture with another reading; `None` where that is impossible.
pub type Open<'a> = dyn Fn(&Reading) -> Option<Box<dyn SampleSource>> + 'a;

/// Probable mistakes and what to try. `found` satellites were found with the requested options.
pub fn advise(open: &Open, search: &SearchOptions, found: usize) -> Vec<Advice> {
    let mut advice = Vec::new();
    let Some(source) = open(&Reading::default()) else { return advice };
    let info = source.info().clone();
    let search = SearchOptions {
        false_alarm: 1e-3,
        coherent_ms: WINDOW_MS,
        max_windows: WINDOWS,
        ..search.clone()
    };
    let readings = Reading::others(&info);
    let best = readings
        .into_iter()
        .filter_map(|reading| {
            let mut search = search.clone();
            if let Some(most) = reading.doppler_hz {
                search.doppler_hz = (-most, most);
            }
            let seen = satellites(open(&reading)?, &search)?;
            Some((reading, seen))
        })
        .reduce(|best, next| if next.1.shows_more_than(&best.1) { next } else { best });
    match best {
        Some((reading, Seen { count, .. })) if count >= FEW && count > found => {
            advice.push(Advice::Read { reading, satellites: count });
        }
        _ => advice.push(Advice::NothingFound),
    }
    advice.extend(level_doubts(open).into_iter().map(Advice::Level));
    advice
}

/// Number of satellites above [`SOUND_DBHZ`], and the sum of their C/N0.
struct Seen {
    count: usize,
    total_dbhz: f64,
}

impl Seen {
    /// More satellites, or as many that are stronger by a decibel: real samples show the same satellites at an
    /// intermediate frequency and at its negative, and the same Dopplers may be searched under two options.
    fn shows_more_than(&self, other: &Self) -> bool {
        let stronger = self.total_dbhz > other.total_dbhz + self.count as f64;
        self.count > other.count || (self.count == other.count && stronger)
    }
}

/// The satellites in the first samples of a source.
fn satellites(mut source: Box<dyn SampleSource>, search: &SearchOptions) -> Option<Seen> {
    let info = source.info().clone();
    let signal = searched_signal(&search.satellites, info.rate_hz).ok()?;
    if info.rate_hz < 2.0 * signal.chip_rate_hz * 0.97 {
        return None;
    }
    let decimation = ((info.rate_hz / ENOUGH_HZ) as usize).max(1);
    let mut conditioner = Conditioner::new(&info, decimation);
    let (mut raw, mut block) = (Block::default(), Block::default());
    source.read(&mut raw, (LOOK_S * info.rate_hz) as usize).ok()?;
    ImpulseSuppressor::new(Suppression::Auto, &info).process(&mut raw);
    conditioner.process(&raw, &mut block);
    let plan = SearchPlan::new(conditioner.info().rate_hz, search.clone()).ok()?;
    let samples = if block.channels() > 0 { block.channel(0) } else { &[] };
    let mut found = plan.search(samples).ok()?;
    found.retain(|a| a.cn0_dbhz >= SOUND_DBHZ);
    Some(Seen { count: found.len(), total_dbhz: found.iter().map(|a| a.cn0_dbhz).sum() })
}

/// Level statistics of the capture that do not fit its sample type.
fn level_doubts(open: &Open) -> Vec<String> {
    let doubts = || {
        let mut source = open(&Reading::default())?;
        let (rate_hz, real) = (source.info().rate_hz, source.info().real);
        let mut raw = Block::default();
        source.read(&mut raw, (LOOK_S * rate_hz) as usize).ok()?;
        let mut meter = LevelMeter::default();
        meter.add(raw.channel(0));
        Some(meter.level(real)?.warnings())
    };
    doubts().unwrap_or_default()
}
