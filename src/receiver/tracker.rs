//! All satellites in track from the first sample to the last: reacquisition, messages, and positions as soon as
//! possible.

use super::clock::ReceiverClock;
use super::event::{Event, Notice};
use super::find::{BeamFormer, Channels, Found, Region, search};
use super::head::{Head, HeadFound, deep_windows};
use super::resolve::{Tracks, receive_origin, round_time};
use super::sky::manifold;
use super::track::Track;
use super::{CHUNK_S, Emit, ReceiverError, ReceiverOptions};
use crate::acquisition::{Acquisition, AcquisitionError, SearchOptions};
use crate::array::sky::interference::Interference;
use crate::array::sky::jammers;
use crate::array::{ArraySky, Manifold, SkyEpoch};
use crate::capture::Block;
use crate::correlator::{Depth, SampleBuffer};
use crate::gnss::constants::SPEED_OF_LIGHT;
use crate::gnss::message::{NavigationCollector, Update};
use crate::gnss::navigation_data::UtcParameters;
use crate::gnss::observation::{CodeRange, ObservationEpoch};
use crate::gnss::{NavigationData, Sv, Transmission};
use crate::position::{Sequence, candidates};
use crate::tracking::{LockState, Smoother, TrackLog, observation_epoch, observation_epochs};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Interval at which beams are steered to their satellites, and lost satellites are searched, s.
const RETRY_S: f64 = 1.0;
/// Interval at which all satellites not in track are searched, s.
const SEARCH_AGAIN_S: f64 = 30.0;

/// Doppler interval around the last known one in which a lost satellite is searched, Hz.
const RETRY_HZ: f64 = 500.0;

/// Tracks whose symbols move alike where samples are missing, and satellites that decide how many.
const MANY: usize = 3;
const NEEDED: usize = 5;
/// Time after which a satellite whose dates alone do not fit its symbols is dated anew, s: by then the symbols of all
/// would have moved.
const ALONE_S: f64 = 1.5;
/// Time after the last agreement, s, in which the code loops follow the satellites that have moved on.
const SETTLING_S: f64 = 1.2;
/// Time after the last agreement, s, in which a loss explains a disagreement: then hand-over words have dated all anew.
const FORGIVEN_S: f64 = 15.0;
/// Largest loss that is looked for, ms, in steps of a symbol of LNAV, which the ranges have to decide.
const MOST_LOST_MS: i64 = 3000;
const SYMBOL_MS: i64 = 20;
/// Difference of costs from which a loss is decided at two instants in a row: three standard deviations each.
const DECIDED: f64 = 9.0;

/// Share of the code loops' mean correction that becomes common to all in a chunk: all of it in some seconds.
const CODE_OFFSET_GAIN: f64 = 0.05;

/// Jumps of code phases that differ by less than this count as one loss of samples, s.
const SLIP_AGREEMENT_S: f64 = 1.5e-6;

/// A satellite whose track ended.
struct Lost {
    log: TrackLog,
    doppler_hz: f64,
}

/// All tracks, past and present.
pub(super) struct Tracker {
    rate_hz: f64,
    /// Channels that a search sums.
    searched: usize,
    /// Jammers that are removed.
    interference: Option<Interference>,
    /// The newest samples in buffers of correlators, by channel.
    buffers: Vec<SampleBuffer>,
    chunk: Block,
    clock: ReceiverClock,
    tracks: Vec<Track>,
    lost: BTreeMap<Transmission, Lost>,
    /// Logs of tracks that ended.
    ended: Vec<TrackLog>,
    collector: NavigationCollector,
    /// Navigation data known beforehand, and decoded.
    navigation: NavigationData,
    /// When each satellite first had transmission time and ephemeris, s.
    ready: BTreeMap<Sv, f64>,
    /// Jumps of code phases at reacquisition: sample, jump in s.
    jumps: Vec<(u64, f64)>,
    /// The scale of the errors, from the epochs so far.
    sequence: Sequence,
    /// Smooths the pseudoranges that positions are solved from.
    smoother: Option<Smoother>,
    /// The last instant that was examined, and the last at which all satellites agreed.
    examined: Option<u64>,
    agreed: Option<u64>,
    /// The loss that the last instant spoke for, ms.
    suspected: Option<i64>,
    /// By which fraction codes run faster than their carriers say.
    code_offset: f64,
    /// The Doppler interval in which satellites are searched.
    doppler_hz: (f64, f64),
    next_retry_s: f64,
    next_search_s: f64,
    /// Whether nothing tells the week but the signals, modulo 1024.
    assumed_week: bool,
}

/// The observations of an epoch if all were sent so much later.
fn dated_later(epoch: &ObservationEpoch, later_ms: i64) -> ObservationEpoch {
    let mut epoch = epoch.clone();
    for observation in &mut epoch.observations {
        if let Some(CodeRange::Pseudorange(range_m)) = &mut observation.range {
            *range_m -= later_ms as f64 * 1e-3 * SPEED_OF_LIGHT;
        }
    }
    epoch
}

impl Tracker {
    /// Tracks what was found in the head, from its first sample on.
    pub(super) fn new(
        head: Head,
        shown: &HeadFound,
        interference: Option<&Interference>,
        rate_hz: f64,
        options: &ReceiverOptions,
        emit: &mut Emit,
    ) -> Self {
        let week = options.time.or_else(|| options.navigation.iter().map(|e| e.toe).next());
        let code_offset = shown.code_offset;
        let new =
            |f: &Found| Track::new(f, 0, &head.block, rate_hz, code_offset, &options.tracking);
        let tracks: Vec<Track> = shown.found.par_iter().map(new).collect();
        for track in &tracks {
            emit(Event::Lock { sv: track.sv(), sample: 0, state: LockState::PullingIn });
        }
        Self {
            rate_hz,
            searched: if head.common_noise { 1 } else { head.block.channels() },
            interference: interference.cloned(),
            buffers: head.buffers,
            chunk: Block::default(),
            clock: ReceiverClock::new(rate_hz, options.interval_s),
            tracks,
            lost: BTreeMap::new(),
            ended: Vec::new(),
            collector: week
                .map_or_else(NavigationCollector::default, |t| NavigationCollector::new(t.week())),
            navigation: options.navigation.clone(),
            ready: BTreeMap::new(),
            jumps: Vec::new(),
            sequence: Sequence::default(),
            smoother: options.smoothing().map(Smoother::new),
            assumed_week: week.is_none(),
            examined: None,
            agreed: None,
            suspected: None,
            code_offset,
            doppler_hz: shown.doppler_hz,
            next_retry_s: RETRY_S,
            next_search_s: SEARCH_AGAIN_S,
        }
    }

    /// Samples taken so far.
    pub(super) fn samples(&self) -> u64 {
        self.buffers[0].end()
    }

    /// Tracks all satellites through the samples held.
    pub(super) fn advance(&mut self) {
        let end = self.samples();
        self.clock.advance(self.buffers[0].first_sample(), end);
        let (buffer, chunk, instants) = (&self.buffers[0], &self.chunk, self.clock.instants());
        self.tracks.par_iter_mut().for_each(|track| {
            track.take(chunk);
            track.advance(buffer, instants);
        });
        self.steer_codes();
    }

    /// What the code loops correct alike is no motion of a satellite: it goes to all, and to tracks that start, so that no
    /// loop lags behind.
    fn steer_codes(&mut self) {
        let locked = self.tracks.iter().filter_map(Track::code_correction);
        let (sum, count) = locked.fold((0.0, 0), |(sum, count), c| (sum + c, count + 1));
        if count >= 4 {
            self.code_offset += CODE_OFFSET_GAIN * sum / f64::from(count);
            let offset = self.code_offset;
            self.tracks.iter_mut().for_each(|track| track.set_code_offset(offset));
        }
    }

    /// To be called when the tracks have reached the end of the samples held: reads messages, drops lost tracks and
    /// searches them again, solves positions. `now`: the jammers that are removed.
    pub(super) fn settle(
        &mut self,
        now: Option<&Interference>,
        options: &ReceiverOptions,
        emit: &mut Emit,
    ) -> Result<(), ReceiverError> {
        let end = self.samples();
        let done_s = end as f64 / self.rate_hz;
        self.decode(done_s, options, emit);
        self.drop_lost(emit);
        if done_s >= self.next_retry_s {
            self.next_retry_s = done_s + RETRY_S;
            let all = done_s >= self.next_search_s;
            if all {
                self.next_search_s = done_s + SEARCH_AGAIN_S;
            }
            if !self.chunk.is_empty() {
                self.take_interference(now, done_s, options, emit);
                self.follow(options, emit);
                self.search_again(all, options, emit)?;
            }
        }
        self.find_loss(options, emit);
        self.solve(options, emit);
        self.forget(options.history_s);
        Ok(())
    }

    /// Takes the next samples, to be held at this depth, and drops those that no track needs.
    pub(super) fn take(&mut self, chunk: &mut Block, depth: Depth) {
        let end = self.samples();
        std::mem::swap(&mut self.chunk, chunk);
        for (c, buffer) in self.buffers.iter_mut().enumerate() {
            buffer.discard_before(end.saturating_sub((CHUNK_S * self.rate_hz) as u64));
            buffer.push_at(self.chunk.channel(c), depth);
        }
    }

    fn decode(&mut self, now_s: f64, options: &ReceiverOptions, emit: &mut Emit) {
        let sample = self.samples();
        let mut news = false;
        for track in &mut self.tracks {
            let sv = track.sv();
            for update in track.decode(&mut self.collector) {
                if update == Update::IonosphereUtc {
                    let NavigationData { utc, galileo, .. } = self.collector.data();
                    utc.iter().chain(&galileo.utc).for_each(UtcParameters::announce);
                }
                news |= matches!(
                    update,
                    Update::Ephemeris(_) | Update::Withdrawn(_) | Update::IonosphereUtc
                );
                emit(Event::Message { sv, sample, update });
            }
            let known = self.collector.data().satellites().any(|s| s == sv)
                || options.navigation.satellites().any(|s| s == sv);
            if known && track.log.is_dated() {
                self.ready.entry(sv).or_insert(now_s);
            }
        }
        if news {
            self.navigation = options.navigation.clone();
            self.navigation.merge(self.collector.data().clone());
        }
    }

    fn drop_lost(&mut self, emit: &mut Emit) {
        let sample = self.samples();
        for track in &mut self.tracks {
            if let Some(state) = track.changed_lock() {
                emit(Event::Lock { sv: track.sv(), sample, state });
            }
        }
        let (lost, kept): (Vec<Track>, _) =
            std::mem::take(&mut self.tracks).into_iter().partition(Track::is_lost);
        self.tracks = kept;
        for track in lost {
            let doppler_hz = track.doppler_hz();
            self.lost.insert(track.log.transmission, Lost { log: track.log, doppler_hz });
        }
    }

    /// Reports new jammers.
    fn take_interference(
        &mut self,
        now: Option<&Interference>,
        from_s: f64,
        options: &ReceiverOptions,
        emit: &mut Emit,
    ) {
        let before = self.interference.as_ref().map_or(0, Interference::count);
        let Some(now) = now.filter(|now| now.count() > before) else { return };
        let manifold = options.array.as_ref().map(|array| Manifold::new(array.in_enu()));
        let jammers = jammers(now, manifold.as_ref());
        emit(Event::Interference { sample: self.samples(), jammers: jammers.clone() });
        emit(Event::Notice(Notice::Interference { from_s, jammers }));
        self.interference = Some(now.clone());
    }

    /// Steers the beams of an array to the satellites in the newest chunk, and reports the directions.
    fn follow(&mut self, options: &ReceiverOptions, emit: &mut Emit) {
        let (buffers, chunk, rate_hz) = (&self.buffers, &self.chunk, self.rate_hz);
        if buffers.len() < 2 {
            return;
        }
        let beams = BeamFormer::new(options.beams, chunk);
        let follow = |track: &mut Track| track.follow(buffers, &beams, rate_hz);
        let signatures = self.tracks.par_iter_mut().filter_map(follow).collect();
        let mut sky = ArraySky::default();
        sky.add(signatures, manifold(self.interference.as_ref(), options).as_ref());
        let sample = chunk.first_sample() + chunk.len() as u64 / 2;
        emit(Event::Sky(SkyEpoch { sample, sky }));
    }

    /// Searches the newest chunk for lost satellites, and with `all` for all others.
    fn search_again(
        &mut self,
        all: bool,
        options: &ReceiverOptions,
        emit: &mut Emit,
    ) -> Result<(), AcquisitionError> {
        let (start, end) = (self.chunk.first_sample(), self.samples());
        let mut cells = Vec::new();
        for (&transmission, lost) in &self.lost {
            let asked = SearchOptions {
                satellites: vec![transmission],
                doppler_hz: (lost.doppler_hz - RETRY_HZ, lost.doppler_hz + RETRY_HZ),
                max_windows: deep_windows(self.searched),
                ..options.search.clone()
            };
            cells.extend(self.search_chunk(&asked)?);
        }
        if all && options.searches_rest {
            let tracked = |k: &Transmission| {
                self.tracks.iter().any(|t| t.log.transmission == *k) || self.lost.contains_key(k)
            };
            let mut asked = SearchOptions { doppler_hz: self.doppler_hz, ..options.search.clone() };
            asked.satellites.retain(|k| !tracked(k));
            if !asked.satellites.is_empty() {
                cells.extend(self.search_chunk(&asked)?);
            }
        }
        let beams = &BeamFormer::new(options.beams, &self.chunk);
        let (block, buffers, rate_hz) = (&self.chunk, &self.buffers[..], self.rate_hz);
        let code_offset = self.code_offset;
        let region = Region { block, buffers, beams, rate_hz, start, end, code_offset };
        for found in region.refine_all(&cells, &options.search) {
            let mut track =
                Track::new(&found, start, block, rate_hz, code_offset, &options.tracking);
            track.advance(&buffers[0], self.clock.instants());
            emit(Event::Lock { sv: track.sv(), sample: start, state: LockState::PullingIn });
            if let Some(lost) = self.lost.remove(&track.log.transmission) {
                if let Some(jump) = track.log.continue_from(&lost.log, rate_hz, code_offset) {
                    self.jumps.push((start, jump));
                }
                self.ended.push(lost.log);
            }
            self.tracks.push(track);
        }
        Ok(())
    }

    fn search_chunk(&self, options: &SearchOptions) -> Result<Vec<Acquisition>, AcquisitionError> {
        let whole_ms = (self.chunk.len() as f64 / self.rate_hz * 1e3) as usize;
        if whole_ms < options.coherent_ms {
            return Ok(Vec::new());
        }
        let start = self.chunk.first_sample();
        let known: Vec<Acquisition> = self.tracks.iter().map(|t| t.at(start)).collect();
        let used = Channels::new(self.searched, self.interference.as_ref(), None);
        search(&self.chunk, self.rate_hz, options, used, &known)
    }

    /// Whether samples were lost or doubled since all satellites last agreed: if so, all is dated anew from there on.
    ///
    /// The symbols of all tracks then start elsewhere by the same part of a symbol, and all transmission times are off
    /// by the same time: the satellites are placed where they were that time ago, which the ranges do not fit.
    fn find_loss(&mut self, options: &ReceiverOptions, emit: &mut Emit) {
        let end = self.samples();
        let misfits: Vec<Option<i64>> = self.tracks.iter().map(Track::misfit).collect();
        let known: Vec<i64> = misfits.iter().flatten().copied().collect();
        let count = |m: i64| known.iter().filter(|&&other| other == m).count();
        let moved = known.iter().copied().filter(|&m| m != 0);
        let common = moved
            .max_by_key(|&m| count(m))
            .filter(|&m| count(m) >= MANY && 2 * count(m) > known.len());
        for (track, misfit) in self.tracks.iter_mut().zip(&misfits) {
            match misfit.filter(|&m| m != 0) {
                None => track.misfit_since = None,
                Some(misfit) => {
                    let since = *track.misfit_since.get_or_insert(end);
                    // Of one satellite alone: its dates came from a wrong edge.
                    if common.is_none() && (end - since) as f64 > ALONE_S * self.rate_hz {
                        track.log.redate(-misfit);
                        track.misfit_since = None;
                    }
                }
            }
        }
        let (Some(origin), rate_hz) = (self.clock.origin(), self.rate_hz) else { return };
        let reached = self.tracks.iter().map(|t| t.log.reached()).fold(end as f64, f64::min);
        let passed = self.clock.instants().iter().rev().find(|&&s| (s as f64) < reached);
        let Some(&sample) = passed.filter(|&&s| self.examined.is_none_or(|examined| s > examined))
        else {
            return;
        };
        self.examined = Some(sample);
        let logs = self.tracks.iter().map(|t| &t.log);
        let Some(epoch) = observation_epoch(logs, sample, origin, rate_hz) else { return };
        let (navigation, positioning) = (&self.navigation, &options.positioning);
        let cost = |later_ms: i64| {
            let epoch = dated_later(&epoch, later_ms);
            let candidates = candidates(&epoch, navigation, positioning, &mut |_| ()).ok()?;
            Some((candidates.cost()?, candidates.agree()))
        };
        let now = cost(0);
        if common.is_none() && now.is_some_and(|(_, agree)| agree) {
            (self.agreed, self.suspected) = (Some(sample), None);
            return;
        }
        let recent = self.agreed.filter(|&at| (sample - at) as f64 <= FORGIVEN_S * rate_hz);
        let (Some(agreed), true) = (recent, epoch.observations.len() >= NEEDED) else {
            return;
        };
        let steps = (-MOST_LOST_MS / SYMBOL_MS..=MOST_LOST_MS / SYMBOL_MS)
            .map(|k| k * SYMBOL_MS - common.unwrap_or(0));
        let mut fits: Vec<(f64, bool, i64)> =
            steps.filter_map(|ms| cost(ms).map(|(cost, agree)| (cost, agree, ms))).collect();
        fits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (Some(&(best, true, lost_ms)), second) = (fits.first(), fits.get(1)) else { return };
        let decided = DECIDED * self.sequence.scale();
        if lost_ms == 0 || second.is_some_and(|second| second.0 - best < decided) {
            return;
        }
        // The code loops may still be on their way: two instants must say the same.
        if self.suspected.replace(lost_ms) != Some(lost_ms) {
            return;
        }
        let (after_s, lost_s) = (agreed as f64 / rate_hz, lost_ms as f64 * 1e-3);
        let settled = agreed + (SETTLING_S * rate_hz) as u64;
        emit(Event::Notice(Notice::Lost { after_s, lost_s }));
        for (track, misfit) in self.tracks.iter_mut().zip(misfits) {
            // One that has read a hand-over word since is dated already.
            if common.is_none() || misfit == common {
                let interval_s = track.log.transmission.timing().interval_s;
                let periods = (lost_s / interval_s).round() as i64;
                track.log.redate_after(agreed, periods);
            }
        }
        let logs = self.tracks.iter_mut().map(|track| &mut track.log);
        let logs = logs.chain(self.lost.values_mut().map(|lost| &mut lost.log));
        logs.chain(&mut self.ended).for_each(|log| log.forget_between(agreed, settled));
        (self.agreed, self.suspected) = (Some(sample), None);
    }

    /// Solves the instants that all tracks have passed; before the first fix only the newest of them. Each fix
    /// sets the clock.
    fn solve(&mut self, options: &ReceiverOptions, emit: &mut Emit) {
        let (rate_hz, end) = (self.rate_hz, self.samples());
        let reached = self.tracks.iter().map(|t| t.log.reached()).fold(f64::INFINITY, f64::min);
        let mut instants = self.clock.complete(reached.min(end as f64));
        let lost = self.lost.values().map(|l| &l.log);
        let tracked = self.tracks.iter().map(|t| &t.log);
        let logs: Vec<&TrackLog> = self.ended.iter().chain(lost).chain(tracked).collect();
        let navigation = &self.navigation;
        let epoch_at =
            |sample, origin| observation_epoch(logs.iter().copied(), sample, origin, rate_hz);
        let sequence = &mut self.sequence;
        let mut solve = |epoch: &ObservationEpoch| {
            sequence.judge(candidates(epoch, navigation, &options.positioning, &mut |_| ())?)
        };
        if self.clock.origin().is_none() {
            let Some(newest) = self.clock.newest_complete().filter(|_| self.ready.len() >= 4)
            else {
                return;
            };
            // The first solution gives the receiver's clock; times are then correct to 0.1 us.
            let origin = receive_origin(&logs, navigation, options.time, rate_hz);
            let mut bias_at = |o| solve(&epoch_at(newest, o)?).ok()?.clock_bias_s;
            let Some((origin, bias_s)) = origin.and_then(|o| Some((o, bias_at(o)?))) else {
                return;
            };
            let origin = round_time(origin - bias_s);
            self.clock.set_origin(origin);
            if let Some(smoother) = &mut self.smoother {
                let before = observation_epochs(logs.iter().copied(), origin, rate_hz);
                let before = before.iter().filter(|epoch| epoch.sample < newest as f64);
                before.for_each(|epoch| drop(smoother.smooth(epoch)));
            }
            instants = vec![newest];
        }
        let Some(origin) = self.clock.origin() else { return };
        for sample in instants {
            let Some(epoch) = epoch_at(sample, origin) else { continue };
            let smoothed = self.smoother.as_mut().map(|smoother| smoother.smooth(&epoch));
            let solved = solve(smoothed.as_ref().unwrap_or(&epoch));
            emit(Event::Observed(epoch));
            match solved {
                Ok(fix) => {
                    self.clock.steer(&fix, end);
                    emit(Event::Fix(Box::new(fix)));
                }
                Err(error) => emit(Event::NoFix { sample: sample as f64, error }),
            }
        }
    }

    /// Drops measurements older than so many seconds.
    fn forget(&mut self, history_s: f64) {
        let oldest = self.samples() as f64 - history_s * self.rate_hz;
        if oldest > 0.0 {
            let oldest = oldest as u64;
            self.ended.retain_mut(|log| log.discard_before(oldest));
            for lost in self.lost.values_mut() {
                lost.log.discard_before(oldest);
            }
            for track in &mut self.tracks {
                track.log.discard_before(oldest);
            }
            self.jumps.retain(|(sample, _)| *sample >= oldest);
        }
    }

    /// The measurements, when the stream has ended.
    pub(super) fn finish(self, emit: &mut Emit) -> Tracks {
        if let Some(jump) = self.jump() {
            emit(Event::Notice(jump));
        }
        if let (true, Some(first)) = (self.assumed_week, self.collector.data().iter().next()) {
            emit(Event::Notice(Notice::AssumedWeek(first.toe)));
        }
        let samples = self.samples();
        let mut logs = self.ended;
        logs.extend(self.lost.into_values().map(|l| l.log));
        logs.extend(self.tracks.into_iter().map(|t| t.log));
        let mut ready: Vec<f64> = self.ready.into_values().collect();
        ready.sort_by(f64::total_cmp);
        let of = |sv| self.collector.sbas(sv).map(move |message| (sv, message.clone()));
        Tracks {
            sbas: self.collector.sbas_satellites().flat_map(of).collect(),
            logs,
            rate_hz: self.rate_hz,
            samples,
            decoded: self.collector.data().clone(),
            ready_s: ready.get(3).copied(),
        }
    }

    /// Equal jumps of three or more satellites: samples are missing.
    fn jump(&self) -> Option<Notice> {
        let mut jumps: Vec<f64> = self.jumps.iter().map(|j| j.1).collect();
        jumps.sort_by(f64::total_cmp);
        let jump_s = *jumps.get(jumps.len() / 2)?;
        let satellites = jumps.iter().filter(|j| (*j - jump_s).abs() < SLIP_AGREEMENT_S).count();
        let before_s = self.jumps.first()?.0 as f64 / self.rate_hz;
        (satellites >= 3 && jump_s.abs() > SLIP_AGREEMENT_S).then_some(Notice::Jump {
            before_s,
            satellites,
            jump_s,
        })
    }
}
