//! Mistakes in options: when almost nothing is acquired, the capture is read with other options, one mistake or two at a
//! time, and the reading that shows satellites as they can be in view is reported.
//!
//! Counted work: each reading is searched in one window of 4 ms first, all readings together in at most
//! some 10^9 / 2 cells; those that show three satellites in five windows. The likeliest mistakes come first.

use crate::acquisition::search::searched_signal;
use crate::acquisition::{Acquisition, SearchOptions, SearchPlan};
use crate::capture::{BitOrder, Block, Encoding, OpenOptions, SampleSource, StreamInfo};
use crate::front_end::{Conditioner, LevelMeter};
use num_complex::Complex32;

/// Fewer satellites than this call for advice.
pub const FEW: usize = 4;
/// More cannot be in view, of one system near the ground.
const MOST: usize = 14;

/// Satellites below this C/N0 do not count, dB-Hz: they may be cross-correlations of stronger ones outside
/// the search.
pub const SOUND_DBHZ: f64 = 30.0;

/// Signal that is searched with each reading, s: five windows of 4 ms and a margin.
pub const LOOK_S: f64 = 0.025;
const WINDOW_MS: usize = 4;
const WINDOWS: usize = 5;
/// Satellites in one window for which five are searched.
const HINT: usize = 3;
/// Satellites in five windows that settle it: no other reading is looked at.
const SURE: usize = 6;
/// Cells (code phases, Dopplers and satellites) of all readings together: some 2 s of a core.
const MOST_CELLS: f64 = 0.45e9;
/// Satellites at Dopplers nearer to each other than this are one artefact, Hz.
const ALIKE_HZ: f64 = 150.0;

/// Power of the mean over that of all samples from which a reading is not looked at.
const MOST_OF_MEAN: f32 = 0.9;

/// Minimum rate after decimation, for a quick search without much loss, Hz.
const ENOUGH_HZ: f64 = 2.4e6;

/// Sample types that are easily confused.
const TYPES: [&str; 9] = ["cs8", "cu8", "cs16", "cf32", "rs8", "rs16", "b1", "b2", "rb2"];
/// Values of 2-bit codes.
const ENCODINGS: [Encoding; 4] = [
    Encoding::SignMagnitudeAdjusted,
    Encoding::OffsetBinaryAdjusted,
    Encoding::TwosComplementAdjusted,
    Encoding::TwosComplement,
];

/// Sampling rates of RTL-SDR, HackRF, Airspy, LimeSDR, USRP, bladeRF and of front ends for GNSS, Hz; those of the first
/// kinds first.
const RATES: [f64; 30] = [
    2.048e6, 2.4e6, 2.56e6, 2.88e6, 3.2e6, 2e6, 4e6, 8e6, 10e6, 20e6, 2.5e6, 3e6, 5e6, 6e6, 2.6e6,
    2.046e6, 4.092e6, 5.115e6, 5.456e6, 8.184e6, 16.368e6, 16.3676e6, 12e6, 12.5e6, 15e6, 15.36e6,
    16e6, 24e6, 25e6, 26e6,
];
/// Rates that are tried beside another mistake.
const FIRST_RATES: usize = 15;

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
    /// Order of packed samples.
    pub bit_order: Option<BitOrder>,
    /// Values of 2-bit codes.
    pub encoding: Option<Encoding>,
    /// Channels side by side.
    pub channels: Option<usize>,
    /// Dopplers are searched up to this, Hz.
    pub doppler_hz: Option<f64>,
}

impl Reading {
    /// Changes options for opening a capture.
    pub fn apply(&self, options: &mut OpenOptions) {
        options.format = self.format.map(str::to_owned).or(options.format.take());
        options.rate_hz = self.rate_hz.or(options.rate_hz);
        options.if_hz = self.if_hz.or(options.if_hz);
        options.bit_order = self.bit_order.or(options.bit_order);
        options.encoding = self.encoding.or(options.encoding);
        options.channels = self.channels.or(options.channels);
    }

    /// All alternative readings, the most likely first: those with one mistake, then those with two. The first so many of
    /// them may be taken for each other.
    fn others(info: &StreamInfo) -> (Vec<Self>, usize) {
        let types = Self::types(info);
        let (rates, frequencies) = (Self::rates(info), Self::frequencies(info));
        let channels: Vec<Self> = [2, 1, 4, 8]
            .into_iter()
            .filter(|n| *n != info.channels)
            .map(|n| Self { channels: Some(n), ..Self::default() })
            .collect();
        let codes = Self::codes(&info.format);
        let wide = Self { doppler_hz: Some(WIDE_HZ), ..Self::default() };
        let of_types: Vec<Self> = types
            .iter()
            .flat_map(|of_type| {
                let codes = Self::codes(of_type.format.unwrap_or_default());
                codes.into_iter().map(move |code| Self {
                    format: of_type.format,
                    if_hz: of_type.if_hz,
                    ..code
                })
            })
            .collect();
        let both = |a: &Self, b: &Self| Self {
            format: a.format.or(b.format),
            rate_hz: a.rate_hz.or(b.rate_hz),
            if_hz: a.if_hz.or(b.if_hz),
            bit_order: a.bit_order.or(b.bit_order),
            encoding: a.encoding.or(b.encoding),
            channels: a.channels.or(b.channels),
            doppler_hz: None,
        };
        let pairs = |first: &[Self], second: &[Self]| -> Vec<Self> {
            second.iter().flat_map(|b| first.iter().map(move |a| both(a, b))).collect()
        };
        // A real type at another rate has its quarter elsewhere.
        let at_rate = |reading: Self| match (reading.format, reading.rate_hz, reading.if_hz) {
            (Some(format), Some(rate_hz), Some(_)) if format.starts_with('r') => {
                Self { if_hz: Some(rate_hz / 4.0), ..reading }
            }
            _ => reading,
        };
        let first_rates = &rates[..rates.len().min(FIRST_RATES)];
        let two = pairs(&types, first_rates).into_iter().map(at_rate);
        let two = two.chain(pairs(&codes, first_rates)).chain(pairs(&channels, first_rates));
        let two: Vec<Self> = two.collect();
        // Half of all bytes, or twice as many, may look like another type: of these all are looked at.
        let factor = |r: &Self| r.rate_hz.map_or(0.0, |rate| rate / info.rate_hz);
        let (doubled, rates): (Vec<Self>, Vec<Self>) =
            rates.into_iter().partition(|r| [0.5, 2.0, 4.0].contains(&factor(r)));
        let (before, after) =
            if info.channels > 1 { (channels, vec![]) } else { (vec![], channels) };
        let alike = doubled.len() + before.len() + frequencies.len() + types.len();
        let one = [doubled, before, frequencies, types, codes, rates, after, vec![wide]];
        (one.into_iter().flatten().chain(of_types).chain(two).collect(), alike)
    }

    fn types(info: &StreamInfo) -> Vec<Self> {
        let reading = |format: &'static str| {
            // Real samples have an intermediate frequency, a quarter of the rate as a rule; complex ones have none.
            let if_hz = match format.starts_with('r') {
                true => (info.if_hz == 0.0).then_some(info.rate_hz / 4.0),
                false => (info.if_hz != 0.0).then_some(0.0),
            };
            Self { format: Some(format), if_hz, ..Self::default() }
        };
        TYPES.into_iter().filter(|t| *t != info.format).map(reading).collect()
    }

    fn rates(info: &StreamInfo) -> Vec<Self> {
        let other = RATES.into_iter().filter(|r| (r / info.rate_hz - 1.0).abs() > 1e-9);
        let readings = |rate_hz: f64| {
            let scaled = (info.if_hz != 0.0).then_some(info.if_hz * rate_hz / info.rate_hz);
            let with = |if_hz| Self { rate_hz: Some(rate_hz), if_hz, ..Self::default() };
            [Some(with(None)), scaled.map(|f| with(Some(f)))].into_iter().flatten()
        };
        other.flat_map(readings).collect()
    }

    fn frequencies(info: &StreamInfo) -> Vec<Self> {
        let quarter = info.rate_hz / 4.0;
        [0.0, quarter, 420e3, 4.092e6, 2.42e6, 3e6, -info.if_hz, -quarter]
            .into_iter()
            .filter(|f| (f - info.if_hz).abs() > 1.0 && f.abs() < 0.6 * info.rate_hz)
            .map(|f| Self { if_hz: Some(f), ..Self::default() })
            .collect()
    }

    /// Other bit orders and encodings of a packed type.
    fn codes(format: &str) -> Vec<Self> {
        let orders = [None, Some(BitOrder::LeastFirst)];
        let encodings = ENCODINGS.map(Some);
        let reading = |bit_order, encoding| Self { bit_order, encoding, ..Self::default() };
        let all: Vec<Self> = match format {
            "b1" => orders.map(|order| reading(order, None)).to_vec(),
            "b2" | "rb2" => encodings
                .into_iter()
                .flat_map(|encoding| orders.map(|order| reading(order, encoding)))
                .collect(),
            _ => Vec::new(),
        };
        all.into_iter().filter(|reading| *reading != Self::default()).collect()
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
    /// There is too little signal to tell: so many s.
    TooShort(f64),
    /// Level statistics that do not fit the sample type.
    Level(String),
}

/// Opens the capture with another reading; `None` where that is impossible.
pub type Open<'a> = dyn Fn(&Reading) -> Option<Box<dyn SampleSource>> + 'a;

/// Probable mistakes and what to try. `found` satellites were found with the requested options; `progress` is told the
/// part of the work that is done.
pub fn advise(
    open: &Open,
    search: &SearchOptions,
    found: usize,
    progress: &mut dyn FnMut(f64),
) -> Vec<Advice> {
    let Some(source) = open(&Reading::default()) else { return Vec::new() };
    let info = source.info().clone();
    if let Some(samples) = info.samples
        && (samples as f64) < 0.9 * LOOK_S * info.rate_hz
    {
        return vec![Advice::TooShort(samples as f64 / info.rate_hz)];
    }
    let search = SearchOptions {
        false_alarm: 1e-3,
        coherent_ms: WINDOW_MS,
        max_windows: 1,
        ..search.clone()
    };
    let (mut best, mut cells) = (None::<(Reading, Seen)>, 0.0);
    let (readings, alike) = Reading::others(&info);
    for (k, reading) in readings.into_iter().enumerate() {
        let mut search = search.clone();
        if let Some(most) = reading.doppler_hz {
            search.doppler_hz = (-most, most);
        }
        let look = |search: &SearchOptions, cells: &mut f64| {
            Some(Seen::of(&satellites(open(&reading)?, search, cells)?))
        };
        if look(&search, &mut cells).is_some_and(|hint| hint.count >= HINT) {
            search.max_windows = WINDOWS;
            let seen = look(&search, &mut cells)
                .filter(|s| (FEW.max(found + 1)..=MOST).contains(&s.count));
            if let Some(seen) = seen
                && best.as_ref().is_none_or(|(_, best)| seen.shows_more_than(best))
            {
                best = Some((reading, seen));
            }
        }
        progress(cells / MOST_CELLS);
        let is_sure = k + 1 >= alike && best.as_ref().is_some_and(|(_, seen)| seen.count >= SURE);
        if is_sure || cells > MOST_CELLS {
            break;
        }
    }
    let named = best.map(|(reading, seen)| Advice::Read { reading, satellites: seen.count });
    let mut advice = vec![named.unwrap_or(Advice::NothingFound)];
    advice.extend(level_doubts(open).into_iter().map(Advice::Level));
    advice
}

/// Number of satellites above [`SOUND_DBHZ`], of those at one Doppler no more than two, and the sum of their C/N0.
struct Seen {
    count: usize,
    total_dbhz: f64,
}

impl Seen {
    fn of(found: &[Acquisition]) -> Self {
        let sound: Vec<_> = found.iter().filter(|a| a.cn0_dbhz >= SOUND_DBHZ).collect();
        // What repeats itself in the samples shows all codes, and all of them at one Doppler.
        let alike = |a: &Acquisition| {
            sound.iter().filter(|b| (a.doppler_hz - b.doppler_hz).abs() < ALIKE_HZ).count()
        };
        if sound.len() > MOST || sound.iter().any(|a| alike(a) > 2 + sound.len() / 3) {
            return Self { count: 0, total_dbhz: 0.0 };
        }
        Self { count: sound.len(), total_dbhz: sound.iter().map(|a| a.cn0_dbhz).sum() }
    }

    /// More satellites, or as many that are stronger by a decibel: real samples show the same satellites at an
    /// intermediate frequency and at its negative, and the same Dopplers may be searched under two options.
    fn shows_more_than(&self, other: &Self) -> bool {
        let stronger = self.total_dbhz > other.total_dbhz + self.count as f64;
        self.count > other.count || (self.count == other.count && stronger)
    }
}

/// The satellites in the first samples of a source; the cells searched are counted.
fn satellites(
    mut source: Box<dyn SampleSource>,
    search: &SearchOptions,
    cells: &mut f64,
) -> Option<Vec<Acquisition>> {
    let info = source.info().clone();
    let signal = searched_signal(&search.satellites, info.rate_hz).ok()?;
    if info.rate_hz < 2.0 * signal.chip_rate_hz * 0.97 {
        return None;
    }
    let seconds = ((search.coherent_ms * search.max_windows) as f64 * 1e-3 + 0.005).min(LOOK_S);
    let decimation = ((info.rate_hz / ENOUGH_HZ) as usize).max(1);
    let mut conditioner = Conditioner::new(&info, decimation);
    let (mut raw, mut block) = (Block::default(), Block::default());
    source.read(&mut raw, (seconds * info.rate_hz) as usize).ok()?;
    // Hard limiting costs a decibel, and impulses do not matter; a wrong type has a mean, or no place in its range.
    for samples in raw.channels_mut() {
        let mean = samples.iter().sum::<Complex32>() / samples.len().max(1) as f32;
        let power: f32 = samples.iter().map(Complex32::norm_sqr).sum();
        if mean.norm_sqr() * samples.len() as f32 > MOST_OF_MEAN * power {
            return None;
        }
        samples.iter_mut().for_each(|z| *z /= z.norm().max(f32::MIN_POSITIVE));
    }
    conditioner.process(&raw, &mut block);
    let plan = SearchPlan::new(conditioner.info().rate_hz, search.clone()).ok()?;
    let samples = if block.channels() > 0 { block.channel(0) } else { &[] };
    *cells += plan.cells() * plan.windows(samples.len()) as f64;
    plan.search(samples).ok()
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
