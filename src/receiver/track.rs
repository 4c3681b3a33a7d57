//! One satellite in track: its beam, loops, message and measurements.

use super::find::{BeamFormer, Found};
use crate::acquisition::Acquisition;
use crate::array::code_periods::despread;
use crate::array::{Beam, Signature};
use crate::capture::Block;
use crate::correlator::SampleBuffer;
use crate::gnss::message::{MessageDecoder, NavigationCollector, Update};
use crate::gnss::{Sv, Transmission};
use crate::tracking::{Channel, Epoch, LockState, Symbol, TrackLog, TrackStart, TrackingOptions};
use num_complex::Complex32;

/// Variance (of a response of 1) up to which a beam follows a signature: C/N0 of some 22 dB-Hz in a chunk. Noise
/// alone gives 0.3 and more, so that a beam is not moved while its satellite is obstructed.
const CLEAR_SIGNATURE: f64 = 0.1;

/// The beam to a satellite, and its output.
struct BeamFeed {
    beam: Beam,
    samples: Vec<Complex32>,
    buffer: SampleBuffer,
}

impl BeamFeed {
    fn new(beam: Beam, first: &Block) -> Self {
        let buffer = SampleBuffer::starting_at(first.first_sample());
        let mut feed = Self { beam, samples: Vec::new(), buffer };
        feed.push(first);
        feed
    }

    fn push(&mut self, chunk: &Block) {
        self.beam.form(chunk, &mut self.samples);
        self.buffer.push(&self.samples);
    }
}

/// One satellite in track.
pub(super) struct Track {
    /// With an array; else all tracks use the samples of the one channel.
    feed: Option<BeamFeed>,
    channel: Channel,
    /// `None` for a pilot.
    decoder: Option<Box<dyn MessageDecoder>>,
    pub(super) log: TrackLog,
    epochs: Vec<Epoch>,
    symbols: Vec<Symbol>,
    /// Symbol edge of the symbols decoded so far.
    edge: Option<u64>,
    /// State of lock when last asked.
    reported: LockState,
    /// Sample since which the dates do not fit the symbols.
    pub(super) misfit_since: Option<u64>,
}

impl Track {
    /// Starts at sample `start`; the samples from there on are in `held`.
    pub(super) fn new(
        found: &Found,
        start: u64,
        held: &Block,
        rate_hz: f64,
        code_offset: f64,
        options: &TrackingOptions,
    ) -> Self {
        let start = TrackStart::from_refined(&found.refined, start);
        let transmission = start.acquisition.transmission;
        Self {
            feed: found.spatial.as_ref().map(|(_, beam)| BeamFeed::new(beam.clone(), held)),
            channel: Channel::new(&start, rate_hz, options.clone()).with_code_offset(code_offset),
            decoder: transmission.decoder(),
            log: TrackLog::new(transmission),
            epochs: Vec::new(),
            symbols: Vec::new(),
            edge: None,
            reported: LockState::PullingIn,
            misfit_since: None,
        }
    }

    pub(super) fn sv(&self) -> Sv {
        self.log.transmission.sv
    }

    /// By how many correlation intervals the dates do not fit the symbols. Where the code itself tells the symbols, they
    /// always do.
    pub(super) fn misfit(&self) -> Option<i64> {
        let timing = self.log.transmission.timing();
        let edge = self.edge.filter(|_| !timing.is_aligned)?;
        self.log.misfit(edge, timing.cycle as u64)
    }

    /// What the code loop corrects, as a fraction of the chip rate, while the signal is there.
    pub(super) fn code_correction(&self) -> Option<f64> {
        (self.channel.lock() == LockState::Locked).then(|| self.channel.code_correction())
    }

    pub(super) fn set_code_offset(&mut self, code_offset: f64) {
        self.channel.set_code_offset(code_offset);
    }

    pub(super) fn doppler_hz(&self) -> f64 {
        self.channel.doppler_hz()
    }

    /// As an acquisition at a sample near the end of what was tracked.
    pub(super) fn at(&self, sample: u64) -> Acquisition {
        Acquisition {
            transmission: self.log.transmission,
            doppler_hz: self.channel.doppler_hz(),
            code_phase_chips: self.channel.code_phase_chips(sample),
            cn0_dbhz: self.channel.quality().cn0_dbhz.unwrap_or(0.0),
            statistic: f64::INFINITY,
            false_alarm: 0.0,
        }
    }

    pub(super) fn is_lost(&self) -> bool {
        self.channel.lock() == LockState::Lost
    }

    /// The state of lock where it is another than when last asked.
    pub(super) fn changed_lock(&mut self) -> Option<LockState> {
        let now = self.channel.lock();
        (std::mem::replace(&mut self.reported, now) != now).then_some(now)
    }

    /// Takes the next samples of an array.
    pub(super) fn take(&mut self, chunk: &Block) {
        if let Some(feed) = &mut self.feed
            && feed.buffer.end() <= chunk.first_sample()
        {
            feed.push(chunk);
        }
    }

    /// Tracks the satellite through all samples held, of channel 0 in `buffer`, and measures it at the instants
    /// among them.
    pub(super) fn advance(&mut self, buffer: &SampleBuffer, instants: &[u64]) {
        self.epochs.clear();
        let buffer = match &mut self.feed {
            Some(feed) => {
                // Earlier samples are needed only from the start of the unfinished period.
                feed.buffer.discard_before(buffer.first_sample());
                &feed.buffer
            }
            None => buffer,
        };
        self.channel.process(buffer, &mut self.epochs, &mut self.symbols);
        self.log.extend(&self.epochs, &self.channel.quality(), instants);
    }

    /// Steers the beam to the satellite's signature in the newest chunk, which has been tracked, and gives the
    /// signature if its variance is small. Cost: one pass over the chunk's channels.
    pub(super) fn follow(
        &mut self,
        buffers: &[SampleBuffer],
        beams: &BeamFormer,
        rate_hz: f64,
    ) -> Option<(Transmission, Signature)> {
        let is_locked = self.channel.lock() == LockState::Locked;
        let feed = self.feed.as_mut().filter(|_| is_locked)?;
        let (first, middle) = (self.epochs.first()?, self.epochs.get(self.epochs.len() / 2)?);
        let start = (first.start_sample as u64).max(buffers[0].first_sample());
        let transmission = self.log.transmission;
        let code_rate = transmission.clock(middle.doppler_hz).chip_rate_hz;
        let intervals = transmission.signal.intervals() as u64;
        let before = (first.period % intervals) as f64 * transmission.timing().interval_s;
        let since_s = (start as f64 - first.start_sample) / rate_hz;
        let chips = before * transmission.signal.chip_rate_hz + since_s * code_rate;
        let at = (middle.doppler_hz, chips.rem_euclid(transmission.signal.chips as f64));
        let span = (start, buffers[0].end());
        let prompts = despread(buffers, rate_hz, span, at, self.channel.code_table());
        let signature = Signature::estimate(&prompts).filter(|s| s.variance < CLEAR_SIGNATURE)?;
        feed.beam = beams.beam(&signature);
        Some((transmission, signature))
    }

    /// Decodes the new symbols; gives what is new in the collector.
    pub(super) fn decode(&mut self, collector: &mut NavigationCollector) -> Vec<Update> {
        let Some(decoder) = &mut self.decoder else {
            self.symbols.clear();
            return Vec::new();
        };
        let cycle = self.log.transmission.timing().cycle as u64;
        let mut news = Vec::new();
        for symbol in self.symbols.drain(..) {
            let edge = symbol.first_period % cycle;
            if self.edge.replace(edge).is_some_and(|before| before != edge)
                && let Some(fresh) = self.log.transmission.decoder()
            {
                *decoder = fresh;
            }
            let Some(page) = decoder.push(symbol.value, symbol.first_period / cycle) else {
                continue;
            };
            if let Some(tow_s) = page.tow_s {
                self.log.anchor(page.start_index * cycle + edge, tow_s);
            }
            news.extend(collector.add(self.log.transmission.sv, &page.content));
        }
        news
    }
}
