//! The pipeline: the stages of the house in their order, from a source of samples to positions.

use crate::acquisition::{
    Acquisition, AcquisitionError, Refined, Refiner, SearchOptions, SearchPlan, Slip, find_slip,
    is_mirrored, remove_shadows,
};
use crate::capture::{Block, SampleSource, SourceError, StreamInfo};
use crate::correlator::{CodeTable, SampleBuffer};
use crate::front_end::Conditioner;
use crate::gnss::{GpsTime, NavigationData, Sv};
use crate::navigation::{FrameDecoder, NavigationCollector, Update};
use crate::observables::{ObservationEpoch, TrackLog, observation_epochs, snapshot_epoch};
use crate::positioning::{Fix, SnapshotOptions, solve_epoch, solve_snapshot};
use crate::tracking::{Bit, Channel, Epoch, LockState, TrackStart, TrackingOptions};
use num_complex::Complex32;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Signal that the first search and its refinement see, s, and at most so many samples.
const HEAD_S: f64 = 1.0;
const HEAD_SAMPLES: f64 = 8e6;

/// Signal that a refinement uses where tracking follows, s.
const REFINE_S: f64 = 0.5;

/// Samples processed at a time, s.
const CHUNK_S: f64 = 0.1;

/// Recordings shorter than this are snapshots: they hold no subframe.
const SHORTEST_TRACK_S: f64 = 6.0;

/// With fewer satellites than this a deeper search follows, of this many windows.
const ENOUGH_SATELLITES: usize = 8;
const DEEP_WINDOWS: usize = 16;

/// A detection is confirmed when the refinement, over more signal, finds no less than this much of it, dB:
/// noise that passed the search's threshold falls by the ratio of the two lengths.
const CONFIRMED_DB: f64 = 6.0;

/// How often lost satellites are searched again, and all that are not tracked, s.
const RETRY_S: f64 = 1.0;
const SEARCH_AGAIN_S: f64 = 30.0;

/// Doppler interval around the last known one in which a lost satellite is searched, Hz.
const RETRY_HZ: f64 = 500.0;

/// Receive time of the first guess: flight time of the nearest satellite, s.
const FLIGHT_S: f64 = 0.068;

/// Instants of a second at which a jump of all code phases counts as one slip of the samples.
const SLIP_AGREEMENT_S: f64 = 1.5e-6;

/// What a run is to do.
#[derive(Clone, Debug)]
pub struct ReceiverOptions {
    /// The first search.
    pub search: SearchOptions,
    /// The loops.
    pub tracking: TrackingOptions,
    /// The position solutions.
    pub positioning: SnapshotOptions,
    /// Navigation data known beforehand.
    pub navigation: NavigationData,
    /// GPS time of the first sample, as well as it is known.
    pub time: Option<GpsTime>,
    /// Time between fixes, s.
    pub interval_s: f64,
    /// Integer factor by which the rate is lowered before anything else.
    pub decimation: usize,
}

/// Why a run ended early.
#[derive(Debug, thiserror::Error)]
pub enum ReceiverError {
    /// The source failed.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The search is impossible.
    #[error(transparent)]
    Acquisition(#[from] AcquisitionError),
}

/// What a run found.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Satellites found at the start, refined over it, strongest first.
    pub acquisitions: Vec<Refined>,
    /// Measurements at the common instants, in order of time.
    pub epochs: Vec<ObservationEpoch>,
    /// Positions, in order of time.
    pub fixes: Vec<Fix>,
    /// Navigation data, known and decoded.
    pub navigation: NavigationData,
    /// Navigation data that came from the signals alone.
    pub decoded: NavigationData,
    /// Signal from the first sample on that the first fix needed, s.
    pub first_fix_s: Option<f64>,
    /// Samples read of each channel.
    pub samples: u64,
    /// What a person should know.
    pub warnings: Vec<String>,
    /// Why there is no fix, where there is none.
    pub reason: Option<String>,
}

/// The start of a stream: what acquisition sees.
struct Head {
    samples: Vec<Complex32>,
    buffer: SampleBuffer,
    /// Whether the stream ends with it.
    is_all: bool,
}

/// Acquisition alone: the satellites in the first `seconds` of a source, refined over all of them.
pub fn acquire(
    source: &mut dyn SampleSource,
    options: &ReceiverOptions,
    seconds: f64,
) -> Result<Outcome, ReceiverError> {
    let mut input = Input::new(source, options.decimation);
    let mut head = input.head(seconds)?;
    let wanted = (seconds * input.rate_hz()).round() as usize;
    head.samples.truncate(wanted.max(1));
    let mut outcome = Outcome { samples: head.samples.len() as u64, ..Outcome::default() };
    acquire_head(&head, input.rate_hz(), options, outcome.samples, &mut outcome)?;
    outcome.warnings.splice(0..0, input.source.warnings());
    Ok(outcome)
}

/// The whole receiver. `progress` is told the samples done after each chunk.
pub fn process(
    source: &mut dyn SampleSource,
    options: &ReceiverOptions,
    progress: &mut (dyn FnMut(u64) + Send),
) -> Result<Outcome, ReceiverError> {
    let mut input = Input::new(source, options.decimation);
    let rate_hz = input.rate_hz();
    let head = input.head(HEAD_S)?;
    let mut outcome = Outcome { navigation: options.navigation.clone(), ..Outcome::default() };
    let length = head.samples.len() as u64;
    let refine = if head.is_all { length } else { length.min((REFINE_S * rate_hz) as u64) };
    acquire_head(&head, rate_hz, options, refine, &mut outcome)?;
    let is_snapshot = head.is_all
        || input.info().samples.is_some_and(|n| (n as f64) < SHORTEST_TRACK_S * rate_hz);
    if is_snapshot {
        outcome.samples = length;
        solve_head(refine, rate_hz, options, &mut outcome);
    } else {
        track_all(&mut input, head, options, &mut outcome, progress)?;
    }
    outcome.warnings.splice(0..0, input.source.warnings());
    Ok(outcome)
}

/// The source behind its conditioning.
struct Input<'a> {
    source: &'a mut dyn SampleSource,
    conditioner: Conditioner,
    raw: Block,
}

impl<'a> Input<'a> {
    fn new(source: &'a mut dyn SampleSource, decimation: usize) -> Self {
        let conditioner = Conditioner::new(source.info(), decimation);
        Self { source, conditioner, raw: Block::default() }
    }

    fn info(&self) -> &StreamInfo {
        self.conditioner.info()
    }

    fn rate_hz(&self) -> f64 {
        self.info().rate_hz
    }

    /// Puts the next chunk into `block`; one without samples at the end.
    fn read(&mut self, block: &mut Block) -> Result<(), SourceError> {
        let want = (CHUNK_S * self.source.info().rate_hz).ceil() as usize;
        if self.conditioner.is_identity() {
            self.source.read(block, want)?;
        } else {
            self.source.read(&mut self.raw, want)?;
            self.conditioner.process(&self.raw, block);
        }
        Ok(())
    }

    fn head(&mut self, seconds: f64) -> Result<Head, SourceError> {
        let want = (seconds * self.rate_hz()).min(HEAD_SAMPLES) as usize;
        let mut head = Head { samples: Vec::new(), buffer: SampleBuffer::default(), is_all: false };
        let mut block = Block::default();
        while head.samples.len() < want {
            self.read(&mut block)?;
            if block.is_empty() {
                head.is_all = true;
                break;
            }
            head.samples.extend_from_slice(block.channel(0));
            head.buffer.push(block.channel(0));
        }
        head.is_all |= self.info().samples == Some(head.samples.len() as u64);
        Ok(head)
    }
}

/// Searches the head, deeper where little is found, and refines over its first `refine` samples.
fn acquire_head(
    head: &Head,
    rate_hz: f64,
    options: &ReceiverOptions,
    refine: u64,
    outcome: &mut Outcome,
) -> Result<(), ReceiverError> {
    let whole_ms = (head.samples.len() as f64 / rate_hz * 1e3 + 1e-6).floor() as usize;
    let mut search = options.search.clone();
    search.coherent_ms = search.coherent_ms.min(whole_ms).max(1);
    let mut found = search_head(&head.samples, rate_hz, &search)?;
    let deep = search.max_windows.max(DEEP_WINDOWS);
    let deeper = deep > search.max_windows && whole_ms > search.coherent_ms * search.max_windows;
    if found.len() < ENOUGH_SATELLITES && deeper {
        search.max_windows = deep;
        found = search_head(&head.samples, rate_hz, &search)?;
    }
    let mut end = refine;
    if let Some(slip) = find_slip(&head.samples[..refine as usize], rate_hz, &found) {
        outcome.warnings.push(slip_warning(&slip, rate_hz));
        end = slip.after;
    }
    outcome.acquisitions = refine_all(&head.buffer, rate_hz, 0, end, &found, search.coherent_ms);
    if is_mirrored(&outcome.acquisitions) {
        outcome.warnings.push(
            "the spectrum is mirrored: code drifts and Dopplers disagree in sign; read it with --conjugate \
             (or without, if it was given)"
                .to_owned(),
        );
    }
    Ok(())
}

fn search_head(
    samples: &[Complex32],
    rate_hz: f64,
    options: &SearchOptions,
) -> Result<Vec<Acquisition>, AcquisitionError> {
    let plan = SearchPlan::new(rate_hz, options.clone())?;
    let mut found = plan.search(samples)?;
    remove_shadows(&mut found, options.coherent_ms, plan.windows(samples.len()));
    Ok(found)
}

fn refine_all(
    buffer: &SampleBuffer,
    rate_hz: f64,
    start: u64,
    end: u64,
    found: &[Acquisition],
    coherent_ms: usize,
) -> Vec<Refined> {
    let refiner = Refiner::new(buffer, rate_hz, start, end);
    let span_hz = 1e3 / coherent_ms as f64;
    let refine = |a: &Acquisition| {
        let refined = refiner.refine(a, &CodeTable::new(a.sv, rate_hz), span_hz);
        let refined = refined.unwrap_or_else(|| Refined::unrefined(a, rate_hz, coherent_ms));
        (refined.acquisition.cn0_dbhz > a.cn0_dbhz - CONFIRMED_DB).then_some(refined)
    };
    let mut refined: Vec<Refined> = found.par_iter().filter_map(refine).collect();
    refined.sort_by(|a, b| b.acquisition.cn0_dbhz.total_cmp(&a.acquisition.cn0_dbhz));
    refined
}

fn slip_warning(slip: &Slip, rate_hz: f64) -> String {
    format!(
        "samples are missing or double: between {:.1} and {:.1} ms the code phases of all satellites jump by {:+.1} us ({:+.0} samples)",
        slip.after as f64 / rate_hz * 1e3,
        slip.before as f64 / rate_hz * 1e3,
        slip.jump_s * 1e6,
        slip.jump_s * rate_hz
    )
}

/// The fix of a snapshot.
fn solve_head(samples: u64, rate_hz: f64, options: &ReceiverOptions, outcome: &mut Outcome) {
    let found = outcome.acquisitions.len();
    let reason = match options.time {
        _ if found == 0 => nothing_found(),
        _ if options.navigation.is_empty() => Some(format!(
            "{found} satellites, but the recording is too short for their navigation message: give --nav FILE and --time T (good to a minute) for a snapshot fix"
        )),
        None => Some(format!(
            "{found} satellites, but when was it? give --time T (good to a minute) for a snapshot fix"
        )),
        Some(time) => {
            let epoch = snapshot_epoch(&outcome.acquisitions, time, samples, rate_hz);
            let solved = solve_snapshot(&epoch, &options.navigation, &options.positioning);
            outcome.epochs.push(epoch);
            match solved {
                Ok(fix) => {
                    outcome.first_fix_s = Some(samples as f64 / rate_hz);
                    outcome.fixes.push(fix);
                    None
                }
                Err(error) => Some(error.to_string()),
            }
        }
    };
    outcome.reason = reason;
}

fn nothing_found() -> Option<String> {
    Some("no satellite was found".to_owned())
}

/// One satellite being followed.
struct Track {
    channel: Channel,
    decoder: FrameDecoder,
    log: TrackLog,
    epochs: Vec<Epoch>,
    bits: Vec<Bit>,
}

impl Track {
    fn new(start: &TrackStart, rate_hz: f64, options: &TrackingOptions) -> Self {
        Self {
            channel: Channel::new(start, rate_hz, options.clone()),
            decoder: FrameDecoder::new(),
            log: TrackLog::new(start.acquisition.sv),
            epochs: Vec::new(),
            bits: Vec::new(),
        }
    }

    /// Follows the satellite through all samples held.
    fn advance(&mut self, buffer: &SampleBuffer, spacing: u64) {
        self.epochs.clear();
        self.channel.process(buffer, &mut self.epochs, &mut self.bits);
        self.log.extend(&self.channel, &self.epochs, spacing);
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
}

fn track_all(
    input: &mut Input,
    head: Head,
    options: &ReceiverOptions,
    outcome: &mut Outcome,
    progress: &mut (dyn FnMut(u64) + Send),
) -> Result<(), ReceiverError> {
    let rate_hz = input.rate_hz();
    let week = options.time.or_else(|| options.navigation.iter().map(|e| e.toe).next());
    let mut tracker = Tracker {
        options,
        rate_hz,
        spacing: (options.interval_s * rate_hz).round().max(1.0) as u64,
        tracks: outcome
            .acquisitions
            .iter()
            .map(|r| Track::new(&TrackStart::from_refined(r, 0), rate_hz, &options.tracking))
            .collect(),
        lost: BTreeMap::new(),
        ended: Vec::new(),
        collector: week
            .map_or_else(NavigationCollector::default, |t| NavigationCollector::new(t.week())),
        ready: BTreeMap::new(),
        jumps: Vec::new(),
    };
    let Head { mut buffer, .. } = head;
    let (mut chunk, mut next) = (Block::default(), Block::default());
    let (mut next_retry, mut next_search) = (RETRY_S, SEARCH_AGAIN_S);
    loop {
        // While the channels follow what is there, the next chunk is read.
        let (read, ()) = rayon::join(|| input.read(&mut next), || tracker.advance(&buffer));
        let done_s = buffer.end() as f64 / rate_hz;
        tracker.decode(done_s);
        tracker.drop_lost();
        if done_s >= next_retry {
            next_retry = done_s + RETRY_S;
            let all = done_s >= next_search;
            if all {
                next_search = done_s + SEARCH_AGAIN_S;
            }
            if !chunk.is_empty() {
                tracker.search_again(&buffer, chunk.channel(0), all)?;
            }
        }
        progress(buffer.end());
        read?;
        if next.is_empty() {
            break;
        }
        std::mem::swap(&mut chunk, &mut next);
        buffer.discard_before(buffer.end().saturating_sub((CHUNK_S * rate_hz) as u64));
        buffer.push(chunk.channel(0));
    }
    outcome.samples = buffer.end();
    tracker.finish(outcome);
    Ok(())
}

impl Tracker<'_> {
    fn advance(&mut self, buffer: &SampleBuffer) {
        let spacing = self.spacing;
        self.tracks.par_iter_mut().for_each(|track| track.advance(buffer, spacing));
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

    /// Searches the newest chunk for lost satellites, and for `all` others where asked.
    fn search_again(
        &mut self,
        buffer: &SampleBuffer,
        chunk: &[Complex32],
        all: bool,
    ) -> Result<(), AcquisitionError> {
        let start = buffer.end() - chunk.len() as u64;
        let mut found = Vec::new();
        for (&sv, lost) in &self.lost {
            let search = SearchOptions {
                satellites: vec![sv],
                doppler_hz: (lost.doppler_hz - RETRY_HZ, lost.doppler_hz + RETRY_HZ),
                max_windows: DEEP_WINDOWS,
                ..self.options.search.clone()
            };
            found.extend(self.search_chunk(chunk, &search)?);
        }
        if all {
            let tracked =
                |sv: &Sv| self.tracks.iter().any(|t| t.log.sv == *sv) || self.lost.contains_key(sv);
            let mut search = self.options.search.clone();
            search.satellites.retain(|sv| !tracked(sv));
            if !search.satellites.is_empty() {
                found.extend(self.search_chunk(chunk, &search)?);
            }
        }
        let coherent_ms = self.options.search.coherent_ms;
        for refined in refine_all(buffer, self.rate_hz, start, buffer.end(), &found, coherent_ms) {
            let start = TrackStart::from_refined(&refined, start);
            let mut track = Track::new(&start, self.rate_hz, &self.options.tracking);
            track.advance(buffer, self.spacing);
            if let Some(lost) = self.lost.remove(&track.log.sv) {
                if let Some(jump) = track.log.continue_from(&lost.log, self.rate_hz) {
                    self.jumps.push((start.sample, jump));
                }
                self.ended.push(lost.log);
            }
            self.tracks.push(track);
        }
        Ok(())
    }

    fn search_chunk(
        &self,
        chunk: &[Complex32],
        options: &SearchOptions,
    ) -> Result<Vec<Acquisition>, AcquisitionError> {
        let whole_ms = (chunk.len() as f64 / self.rate_hz * 1e3) as usize;
        if whole_ms < options.coherent_ms {
            Ok(Vec::new())
        } else {
            search_head(chunk, self.rate_hz, options)
        }
    }

    /// Observations and positions of all instants, with the navigation data of the whole recording.
    fn finish(self, outcome: &mut Outcome) {
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
                0 => nothing_found(),
                found => Some(format!(
                    "{found} satellites were tracked, {dated} gave a readable subframe: a fix needs 30 s of signal, or --nav FILE with 6 s"
                )),
            };
            return;
        };
        let epochs_from = |origin| observation_epochs(&logs, origin, self.spacing, self.rate_hz);
        let solve = |epoch: &ObservationEpoch| {
            solve_epoch(epoch, &outcome.navigation, &self.options.positioning.positioning)
        };
        // The first solution tells the receiver's clock; times are then right to 0.1 us.
        let first = epochs_from(origin).iter().find_map(|e| solve(e).ok());
        let origin = first.map_or(origin, |fix| round_time(origin - fix.clock_bias_s));
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
                -median * 1e6
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
