//! All satellites followed from the first sample to the last, and what comes of it.

use super::find::{BeamFormer, Found, Region, search};
use super::head::deep_windows;
use super::input::{CHUNK_S, Head, Input};
use super::sky::{manifold, removed};
use super::{NOTHING_FOUND, Outcome, ReceiverError, ReceiverOptions};
use crate::acquisition::{Acquisition, AcquisitionError, SearchOptions};
use crate::array::code_periods::despread;
use crate::array::sky::interference::Interference;
use crate::array::{ArraySky, Beam, Signature, SkyEpoch};
use crate::capture::Block;
use crate::correlator::SampleBuffer;
use crate::gnss::constants::{CA_CHIP_RATE, CA_CODE_LENGTH, L1_HZ};
use crate::gnss::message::lnav::{FrameDecoder, NavigationCollector, Update};
use crate::gnss::observation::ObservationEpoch;
use crate::gnss::{GpsTime, NavigationData, Sv};
use crate::position::solve_epoch;
use crate::tracking::{Bit, Channel, Epoch, LockState, TrackStart, TrackingOptions};
use crate::tracking::{TrackLog, observation_epochs};
use num_complex::Complex32;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// How often beams are turned to where their satellites are now, and lost satellites are searched again, s.
const RETRY_S: f64 = 1.0;
/// How often all that are not tracked are searched, s.
const SEARCH_AGAIN_S: f64 = 30.0;

/// Doppler interval around the last known one in which a lost satellite is searched, Hz.
const RETRY_HZ: f64 = 500.0;

/// Variance (of a response of 1) up to which a beam follows a signature: C/N0 of some 22 dB-Hz in a chunk. What
/// noise alone passes for has 0.3 and more, so that a beam stays where it was while its satellite is hidden.
const CLEAR_SIGNATURE: f64 = 0.1;

/// Receive time of the first guess: flight time of the nearest satellite, s.
const FLIGHT_S: f64 = 0.068;

/// Instants of a second at which a jump of all code phases counts as one slip of the samples.
const SLIP_AGREEMENT_S: f64 = 1.5e-6;

/// The beam to a satellite, and what comes out of it.
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

/// One satellite being followed.
struct Track {
    /// With an array; else the samples of the one channel are those of all.
    feed: Option<BeamFeed>,
    channel: Channel,
    decoder: FrameDecoder,
    log: TrackLog,
    epochs: Vec<Epoch>,
    bits: Vec<Bit>,
}

impl Track {
    /// Starts at sample `start`; the samples from there on are in `held`.
    fn new(
        found: &Found,
        start: u64,
        held: &Block,
        rate_hz: f64,
        options: &TrackingOptions,
    ) -> Self {
        let start = TrackStart::from_refined(&found.refined, start);
        Self {
            feed: found.spatial.as_ref().map(|(_, beam)| BeamFeed::new(beam.clone(), held)),
            channel: Channel::new(&start, rate_hz, options.clone()),
            decoder: FrameDecoder::new(),
            log: TrackLog::new(start.acquisition.sv),
            epochs: Vec::new(),
            bits: Vec::new(),
        }
    }

    /// Takes in the next samples of an array; those of one channel are shared.
    fn take(&mut self, chunk: &Block) {
        if let Some(feed) = &mut self.feed
            && feed.buffer.end() <= chunk.first_sample()
        {
            feed.push(chunk);
        }
    }

    /// Follows the satellite through all samples held: of channel 0 in `buffer`.
    fn advance(&mut self, buffer: &SampleBuffer, spacing: u64) {
        self.epochs.clear();
        let buffer = match &mut self.feed {
            Some(feed) => {
                // What was processed before is needed no more but for the period that lay open.
                feed.buffer.discard_before(buffer.first_sample());
                &feed.buffer
            }
            None => buffer,
        };
        self.channel.process(buffer, &mut self.epochs, &mut self.bits);
        self.log.extend(&self.epochs, &self.channel.quality(), spacing);
    }

    /// Turns the beam to where the satellite is in the newest chunk, which has been tracked, and gives what the
    /// elements see of it if that is clear. Cost: one pass over the chunk's channels.
    fn follow(
        &mut self,
        buffers: &[SampleBuffer],
        beams: &BeamFormer,
        rate_hz: f64,
    ) -> Option<(Sv, Signature)> {
        let is_locked = self.channel.lock() == LockState::Locked;
        let feed = self.feed.as_mut().filter(|_| is_locked)?;
        let (first, middle) = (self.epochs.first()?, self.epochs.get(self.epochs.len() / 2)?);
        let start = (first.start_sample as u64).max(buffers[0].first_sample());
        let code_rate = CA_CHIP_RATE * (1.0 + middle.doppler_hz / L1_HZ);
        let chips = (start as f64 - first.start_sample) / rate_hz * code_rate;
        let at = (middle.doppler_hz, chips.rem_euclid(CA_CODE_LENGTH as f64));
        let span = (start, buffers[0].end());
        let prompts = despread(buffers, rate_hz, span, at, self.channel.code_table());
        let signature = Signature::estimate(&prompts).filter(|s| s.variance < CLEAR_SIGNATURE)?;
        feed.beam = beams.beam(&signature);
        Some((self.log.sv, signature))
    }

    /// Hands the new bits to the decoder, and what it gives to the collector. Says whether an ephemeris
    /// came.
    fn decode(&mut self, collector: &mut NavigationCollector) -> bool {
        let mut news = false;
        for bit in self.bits.drain(..) {
            let edge = bit.first_period % 20;
            let Some(subframe) = self.decoder.push(bit.value, bit.first_period / 20) else {
                continue;
            };
            self.log.anchor(subframe.start_index * 20 + edge, subframe.tow());
            let update = collector.add(self.log.sv, &subframe);
            news |= matches!(update, Some(Update::Ephemeris(_)));
        }
        news
    }
}

/// A satellite whose track ended.
struct Lost {
    log: TrackLog,
    doppler_hz: f64,
}

/// All that is followed, and all that was.
struct Tracker<'a> {
    options: &'a ReceiverOptions,
    rate_hz: f64,
    /// Channels that a search sums.
    searched: usize,
    /// Jammers that are removed.
    interference: Option<Interference>,
    /// What a person should know.
    warnings: Vec<String>,
    spacing: u64,
    tracks: Vec<Track>,
    lost: BTreeMap<Sv, Lost>,
    /// Logs of tracks that ended.
    ended: Vec<TrackLog>,
    collector: NavigationCollector,
    /// When each satellite was first ready for a fix: dated, and its ephemeris known; s.
    ready: BTreeMap<Sv, f64>,
    /// Jumps of code phases seen when tracks were taken up again: sample, jump in s.
    jumps: Vec<(u64, f64)>,
    /// Where an array saw the satellites, look by look.
    sky_epochs: Vec<SkyEpoch>,
}

pub(super) fn track_all(
    input: &mut Input,
    head: Head,
    found: Vec<Found>,
    options: &ReceiverOptions,
    outcome: &mut Outcome,
    progress: &mut (dyn FnMut(u64) + Send),
) -> Result<(), ReceiverError> {
    let rate_hz = input.rate_hz();
    let week = options.time.or_else(|| options.navigation.iter().map(|e| e.toe).next());
    let mut tracker = Tracker {
        options,
        rate_hz,
        searched: if head.shared_noise { 1 } else { head.block.channels() },
        interference: input.interference().cloned(),
        warnings: Vec::new(),
        spacing: (options.interval_s * rate_hz).round().max(1.0) as u64,
        tracks: found
            .par_iter()
            .map(|f| Track::new(f, 0, &head.block, rate_hz, &options.tracking))
            .collect(),
        lost: BTreeMap::new(),
        ended: Vec::new(),
        collector: week
            .map_or_else(NavigationCollector::default, |t| NavigationCollector::new(t.week())),
        ready: BTreeMap::new(),
        jumps: Vec::new(),
        sky_epochs: Vec::new(),
    };
    let Head { mut buffers, .. } = head;
    let (mut chunk, mut next) = (Block::default(), Block::default());
    let (mut next_retry, mut next_search) = (RETRY_S, SEARCH_AGAIN_S);
    loop {
        // While the channels follow what is there, the next chunk is read.
        let (read, ()) =
            rayon::join(|| input.read(&mut next), || tracker.advance(&buffers[0], &chunk));
        let end = buffers[0].end();
        let done_s = end as f64 / rate_hz;
        tracker.decode(done_s);
        tracker.drop_lost();
        if done_s >= next_retry {
            next_retry = done_s + RETRY_S;
            let all = done_s >= next_search;
            if all {
                next_search = done_s + SEARCH_AGAIN_S;
            }
            if !chunk.is_empty() {
                tracker.take_interference(input.interference(), done_s);
                tracker.follow(&buffers, &chunk);
                tracker.search_again(&buffers, &chunk, all)?;
            }
        }
        progress(end);
        read?;
        if next.is_empty() {
            break;
        }
        std::mem::swap(&mut chunk, &mut next);
        for (c, buffer) in buffers.iter_mut().enumerate() {
            buffer.discard_before(end.saturating_sub((CHUNK_S * rate_hz) as u64));
            buffer.push(chunk.channel(c));
        }
    }
    outcome.samples = buffers[0].end();
    tracker.finish(outcome);
    Ok(())
}

impl Tracker<'_> {
    fn advance(&mut self, buffer: &SampleBuffer, chunk: &Block) {
        let spacing = self.spacing;
        self.tracks.par_iter_mut().for_each(|track| {
            track.take(chunk);
            track.advance(buffer, spacing);
        });
    }

    fn decode(&mut self, now_s: f64) {
        for track in &mut self.tracks {
            track.decode(&mut self.collector);
            let sv = track.log.sv;
            let known = self.collector.data().satellites().any(|s| s == sv)
                || self.options.navigation.satellites().any(|s| s == sv);
            if known && track.log.is_dated() {
                self.ready.entry(sv).or_insert(now_s);
            }
        }
    }

    fn drop_lost(&mut self) {
        let (lost, kept): (Vec<Track>, _) = std::mem::take(&mut self.tracks)
            .into_iter()
            .partition(|t| t.channel.lock() == LockState::Lost);
        self.tracks = kept;
        for track in lost {
            let doppler_hz = track.channel.doppler_hz();
            self.lost.insert(track.log.sv, Lost { log: track.log, doppler_hz });
        }
    }

    /// Jammers that came up since are told of.
    fn take_interference(&mut self, now: Option<&Interference>, done_s: f64) {
        let before = self.interference.as_ref().map_or(0, Interference::count);
        if let Some(now) = now.filter(|now| now.count() > before) {
            self.warnings.push(format!("from {done_s:.0} s on {}", removed(now, self.options)));
            self.interference = Some(now.clone());
        }
    }

    /// Turns the beams of an array to where the satellites are in the newest chunk, and notes where that is.
    fn follow(&mut self, buffers: &[SampleBuffer], chunk: &Block) {
        if buffers.len() < 2 {
            return;
        }
        let (beams, rate_hz) = (BeamFormer::new(self.options.beams, chunk), self.rate_hz);
        let follow = |track: &mut Track| track.follow(buffers, &beams, rate_hz);
        let signatures = self.tracks.par_iter_mut().filter_map(follow).collect();
        let mut sky = ArraySky::default();
        sky.add(signatures, rate_hz, manifold(self.interference.as_ref(), self.options).as_ref());
        let sample = chunk.first_sample() + chunk.len() as u64 / 2;
        self.sky_epochs.push(SkyEpoch { sample, sky });
    }

    /// Searches the newest chunk for lost satellites, and for `all` others where asked.
    fn search_again(
        &mut self,
        buffers: &[SampleBuffer],
        chunk: &Block,
        all: bool,
    ) -> Result<(), AcquisitionError> {
        let (start, end) = (chunk.first_sample(), buffers[0].end());
        let mut cells = Vec::new();
        for (&sv, lost) in &self.lost {
            let asked = SearchOptions {
                satellites: vec![sv],
                doppler_hz: (lost.doppler_hz - RETRY_HZ, lost.doppler_hz + RETRY_HZ),
                max_windows: deep_windows(self.searched),
                ..self.options.search.clone()
            };
            cells.extend(self.search_chunk(chunk, &asked)?);
        }
        if all {
            let tracked =
                |sv: &Sv| self.tracks.iter().any(|t| t.log.sv == *sv) || self.lost.contains_key(sv);
            let mut asked = self.options.search.clone();
            asked.satellites.retain(|sv| !tracked(sv));
            if !asked.satellites.is_empty() {
                cells.extend(self.search_chunk(chunk, &asked)?);
            }
        }
        let beams = &BeamFormer::new(self.options.beams, chunk);
        let region = Region { block: chunk, buffers, beams, rate_hz: self.rate_hz, start, end };
        for found in region.refine_all(&cells, &self.options.search) {
            let mut track = Track::new(&found, start, chunk, self.rate_hz, &self.options.tracking);
            track.advance(&buffers[0], self.spacing);
            if let Some(lost) = self.lost.remove(&track.log.sv) {
                if let Some(jump) = track.log.continue_from(&lost.log, self.rate_hz) {
                    self.jumps.push((start, jump));
                }
                self.ended.push(lost.log);
            }
            self.tracks.push(track);
        }
        Ok(())
    }

    fn search_chunk(
        &self,
        chunk: &Block,
        options: &SearchOptions,
    ) -> Result<Vec<Acquisition>, AcquisitionError> {
        let whole_ms = (chunk.len() as f64 / self.rate_hz * 1e3) as usize;
        if whole_ms < options.coherent_ms {
            Ok(Vec::new())
        } else {
            search(chunk, self.rate_hz, options, self.searched, self.interference.as_ref(), &[])
        }
    }

    /// Observations and positions of all instants, with the navigation data of the whole recording.
    fn finish(mut self, outcome: &mut Outcome) {
        outcome.sky_epochs = std::mem::take(&mut self.sky_epochs);
        outcome.warnings.append(&mut self.warnings);
        outcome.warnings.extend(self.slips());
        let mut logs = self.ended;
        logs.extend(self.lost.into_values().map(|l| l.log));
        logs.extend(self.tracks.into_iter().map(|t| t.log));
        outcome.decoded = self.collector.data().clone();
        outcome.navigation.merge(outcome.decoded.clone());
        let dated = logs.iter().filter(|l| l.is_dated()).count();
        let Some(origin) = receive_origin(
            &logs,
            &outcome.navigation,
            self.options.time,
            self.spacing,
            self.rate_hz,
        ) else {
            outcome.reason = match outcome.acquisitions.len() {
                0 => Some(NOTHING_FOUND.to_owned()),
                found => Some(format!(
                    "{found} satellites were tracked, {dated} gave a readable subframe: a fix needs 30 s of signal, or --nav FILE with 6 s"
                )),
            };
            return;
        };
        let epochs_from = |origin| observation_epochs(&logs, origin, self.spacing, self.rate_hz);
        let solve = |epoch: &ObservationEpoch| {
            solve_epoch(epoch, &outcome.navigation, &self.options.positioning)
        };
        // The first solution tells the receiver's clock; times are then right to 0.1 us.
        let first = epochs_from(origin).iter().find_map(|e| solve(e).ok()?.clock_bias_s);
        let origin = first.map_or(origin, |bias_s| round_time(origin - bias_s));
        let epochs = epochs_from(origin);
        let solved: Vec<_> = epochs.par_iter().map(solve).collect();
        let error = solved.iter().rev().find_map(|s| s.as_ref().err()).map(ToString::to_string);
        outcome.fixes = solved.into_iter().filter_map(Result::ok).collect();
        outcome.epochs = epochs;
        if outcome.fixes.is_empty() {
            outcome.reason =
                Some(error.unwrap_or_else(|| "no instant has four dated satellites".to_owned()));
        } else {
            let mut ready: Vec<f64> = self.ready.into_values().collect();
            ready.sort_by(f64::total_cmp);
            outcome.first_fix_s = ready.get(3).copied();
        }
    }

    /// Jumps of three or more satellites that agree: samples are missing.
    fn slips(&self) -> Option<String> {
        let mut jumps: Vec<f64> = self.jumps.iter().map(|j| j.1).collect();
        jumps.sort_by(f64::total_cmp);
        let median = *jumps.get(jumps.len() / 2)?;
        let agreeing = jumps.iter().filter(|j| (*j - median).abs() < SLIP_AGREEMENT_S).count();
        let before = self.jumps.first()?.0 as f64 / self.rate_hz;
        (agreeing >= 3 && median.abs() > SLIP_AGREEMENT_S).then(|| {
            format!(
                "samples are missing or double: before {before:.1} s the code phases of {agreeing} satellites jumped by {:+.1} us",
                median * 1e6
            )
        })
    }
}

/// Receive time of sample 0, from the earliest instant that is dated: the satellites' time and a guess
/// of the flight time. The week comes from the navigation data, or from `time`.
fn receive_origin(
    logs: &[TrackLog],
    navigation: &NavigationData,
    time: Option<GpsTime>,
    spacing: u64,
    rate_hz: f64,
) -> Option<GpsTime> {
    let week = time.or_else(|| navigation.iter().map(|e| e.toe).next())?;
    let (instant, tow) = logs
        .iter()
        .filter_map(TrackLog::first_dated)
        .max_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)))?;
    let received = week.nearest_with_tow(tow.rem_euclid(604_800.0)) + FLIGHT_S;
    Some(received - (instant * spacing) as f64 / rate_hz)
}

/// To the 0.1 us that RINEX prints.
fn round_time(t: GpsTime) -> GpsTime {
    let (_, fraction) = t.parts();
    t + ((fraction * 1e7).round() / 1e7 - fraction)
}
