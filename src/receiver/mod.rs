//! The receiver: samples stream in, block by block, and events stream out: satellites, messages, observations,
//! positions. A file is a stream whose events go into a [`Recorder`].

mod chunks;
mod clock;
mod event;
mod find;
mod head;
mod judge;
mod record;
mod recorder;
mod resolve;
mod sky;
mod snapshot;
mod spatial;
mod stages;
mod survey;
mod track;
mod tracker;

pub use event::{Event, NoFix, Notice};
pub use record::Record;
pub use recorder::Recorder;
pub use resolve::Tracks;
pub use snapshot::SnapshotHead;

use crate::acquisition::{AcquisitionError, SearchOptions};
use crate::array::sky::interference::Interference;
use crate::array::{ArraySky, BeamKind, LookOptions, SkyEpoch};
use crate::capture::{Block, SampleSource, SourceError, StreamInfo};
use crate::front_end::{ImpulseReport, Interferer, Suppression};
use crate::gnss::antenna::ArrayDescription;
use crate::gnss::{GpsTime, NavigationData};
use crate::position::PositioningOptions;
use crate::tracking::{Smoothing, TrackingOptions};
use chunks::Chunks;
use find::{BeamFormer, Region};
use head::{Gathering, Head, acquire_head};
use sky::see;
use stages::Stages;
use survey::survey;
use tracker::Tracker;

/// Signal that the first search and its refinement use, s.
const HEAD_S: f64 = 1.0;

/// Signal that a refinement uses, s: a Doppler that changes by 10 Hz/s turns the carrier by no more than
/// 0.3 rad from its mean over it.
const REFINE_S: f64 = 0.2;

/// Samples processed at a time, s.
const CHUNK_S: f64 = 0.1;

/// Recordings shorter than this are snapshots: they hold no subframe.
const SHORTEST_TRACK_S: f64 = 6.0;

/// Options of a run.
#[derive(Clone, Debug)]
pub struct ReceiverOptions {
    /// The first search.
    pub search: SearchOptions,
    /// The loops.
    pub tracking: TrackingOptions,
    /// Window of the carrier smoothing of pseudoranges, s: positions are solved from smoothed ones, observations are told
    /// as measured. None without.
    pub smoothing_s: Option<f64>,
    /// The position solutions.
    pub positioning: PositioningOptions,
    /// Navigation data known beforehand.
    pub navigation: NavigationData,
    /// Approximate GPS time of the first sample; without it a snapshot's time is searched for wherever the
    /// navigation data are valid.
    pub time: Option<GpsTime>,
    /// Time between fixes, s.
    pub interval_s: f64,
    /// The antenna array whose elements the channels are, where it is known: directions need it, acquisition and
    /// tracking do not.
    pub array: Option<ArrayDescription>,
    /// How an array looks for sources.
    pub look: LookOptions,
    /// Whether satellites are also searched where a look at an array shows no source.
    pub searches_rest: bool,
    /// How an array's beams to the satellites are made.
    pub beams: BeamKind,
    /// Suppression of impulsive noise, the first stage; [`Suppression::Auto`] also excises other interference from the
    /// samples of one antenna.
    pub suppression: Suppression,
    /// Integer factor by which the rate is lowered after that.
    pub decimation: usize,
    /// Time for which measurements are kept, s, also in what [`Receiver::finish`] gives.
    pub history_s: f64,
}

impl Default for ReceiverOptions {
    /// A cold start with the defaults of all stages and a fix each second.
    fn default() -> Self {
        Self {
            search: SearchOptions::default(),
            tracking: TrackingOptions::default(),
            smoothing_s: Some(Smoothing::WINDOW_S),
            positioning: PositioningOptions::default(),
            navigation: NavigationData::default(),
            time: None,
            interval_s: 1.0,
            array: None,
            look: LookOptions::default(),
            searches_rest: true,
            beams: BeamKind::default(),
            suppression: Suppression::default(),
            decimation: 1,
            history_s: 86_400.0,
        }
    }
}

impl ReceiverOptions {
    /// The smoothing of this receiver's pseudoranges, where that is on.
    pub(crate) fn smoothing(&self) -> Option<Smoothing> {
        self.smoothing_s.map(|window_s| Smoothing::of_code_loop(window_s, self.tracking.dll_hz))
    }
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
    /// The array is not that of the capture.
    #[error(
        "the array has {elements} elements, but the capture has {channels} channels: give an array with as many elements as channels"
    )]
    Array {
        /// Elements of the array.
        elements: usize,
        /// Channels of the capture.
        channels: usize,
    },
    /// A block does not fit the stream.
    #[error(
        "a block has {found} channels, but the stream has {channels}: push blocks of one stream"
    )]
    Channels {
        /// Channels of the block.
        found: usize,
        /// Channels of the stream.
        channels: usize,
    },
}

/// Consumer of events.
type Emit<'a> = dyn FnMut(Event) + Send + 'a;

/// How far a run goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Task {
    /// The satellites in the first seconds, refined over all of them.
    Acquire {
        /// Seconds of signal.
        seconds: f64,
    },
    /// Sources in the first seconds without a search: directions without codes, signals by their code periods,
    /// and the satellites among them.
    Look {
        /// Seconds of signal.
        seconds: f64,
    },
    /// Acquisition, tracking to the end, and positions as soon as possible.
    Track,
}

/// A receiver that takes samples block by block and reports [`Event`]s.
///
/// The events and what is left at the end do not depend on how the stream was cut into blocks, nor on the number of
/// threads. Memory does not grow with the stream but for the measurements of the last
/// [`history_s`](ReceiverOptions::history_s), some 0.1 kB for each satellite and instant.
///
/// ```
/// use sdr_rx::capture::{Block, SampleSource};
/// use sdr_rx::receiver::{Event, Receiver, ReceiverOptions, Task};
/// use sdr_rx::scenario::{Scenario, ScenarioSource};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
/// let mut scenario = Scenario::read("signals/static_8sv.toml".as_ref())?;
/// scenario.duration_s = 1.5;
/// let mut source = ScenarioSource::new(&scenario)?;
/// let mut receiver = Receiver::new(source.info(), ReceiverOptions::default(), Task::Track)?;
/// let (mut block, mut satellites) = (Block::default(), 0);
/// let mut count = |event: Event| {
///     if let Event::Found(found) = event {
///         satellites = found.len();
///     }
/// };
/// while source.read(&mut block, 26_000)? > 0 {
///     receiver.push(&mut block, &mut count)?;
/// }
/// receiver.finish(&mut count)?;
/// assert_eq!(satellites, 8);
/// # Ok(())
/// # }
/// ```
pub struct Receiver {
    options: ReceiverOptions,
    task: Task,
    info: StreamInfo,
    stages: Stages,
    chunks: Chunks,
    state: State,
    /// The next chunk, after all stages.
    next: Block,
    snapshot: Option<SnapshotHead>,
    /// Samples of the head, at the receiver's rate.
    head_samples: u64,
    /// Interferers that were reported.
    told: usize,
}

enum State {
    Gathering(Box<Gathering>),
    Tracking(Box<Tracker>),
    Done,
}

/// Results at the end of the stream.
#[derive(Debug)]
pub struct End {
    /// Samples a second at which the receiver worked.
    pub rate_hz: f64,
    /// Samples of each channel that were used, at that rate.
    pub samples: u64,
    /// Impulsive noise, where some was found and suppressed.
    pub noise: Option<ImpulseReport>,
    /// Interference that was excised from the samples of one antenna, strongest first.
    pub interferers: Vec<Interferer>,
    /// What the tracks measured, where there were any.
    pub tracks: Option<Tracks>,
    /// The start of the stream, where a snapshot can be made of it.
    pub snapshot: Option<SnapshotHead>,
}

impl Receiver {
    /// A receiver of a stream.
    ///
    /// # Errors
    /// When the array that the options describe is not that of the stream.
    pub fn new(
        info: &StreamInfo,
        options: ReceiverOptions,
        task: Task,
    ) -> Result<Self, ReceiverError> {
        let stages = Stages::new(info, &options)?;
        let seconds = match task {
            Task::Acquire { seconds } | Task::Look { seconds } => seconds,
            Task::Track => HEAD_S,
        };
        Ok(Self {
            task,
            info: info.clone(),
            chunks: Chunks::new((CHUNK_S * info.rate_hz).ceil() as usize),
            state: State::Gathering(Box::new(Gathering::new(seconds, &stages))),
            stages,
            next: Block::default(),
            snapshot: None,
            head_samples: 0,
            told: 0,
            options,
        })
    }

    /// Samples of a block that is taken without a copy.
    pub fn chunk(&self) -> usize {
        self.chunks.size()
    }

    /// Samples of each channel taken so far, at the rate of the stream.
    pub fn samples(&self) -> u64 {
        self.chunks.position()
    }

    /// Whether more samples would change nothing.
    pub fn is_done(&self) -> bool {
        matches!(self.state, State::Done)
    }

    /// The options.
    pub fn options(&self) -> &ReceiverOptions {
        &self.options
    }

    /// Takes the next samples of the stream, of any number, and reports events, up to 0.2 s of signal later. The
    /// block may be exchanged for another. Cost: satellites are followed in parallel, one pass over the
    /// samples each, beside the conditioning of the next chunk.
    ///
    /// # Errors
    /// When the block has not the channels of the stream, or the search is impossible.
    pub fn push(&mut self, block: &mut Block, emit: &mut Emit) -> Result<(), ReceiverError> {
        let (found, channels) = (block.channels(), self.info.channels);
        if found != channels && !block.is_empty() {
            return Err(ReceiverError::Channels { found, channels });
        }
        let mut used = 0;
        let len = block.len();
        while used < len && !self.is_done() {
            if self.chunks.take(block, &mut used) {
                self.take_chunk(false, emit)?;
            }
        }
        Ok(())
    }

    /// Ends the stream: reports the last events, and gives the measurements of the whole stream.
    ///
    /// # Errors
    /// When the search of a stream that ends with its start is impossible.
    pub fn finish(mut self, emit: &mut Emit) -> Result<End, ReceiverError> {
        if self.chunks.rest() || self.stages.holds() {
            self.take_chunk(true, emit)?;
        }
        if matches!(self.state, State::Gathering(_)) {
            self.begin(true, emit)?;
        }
        let mut end = End {
            rate_hz: self.stages.rate_hz(),
            samples: self.head_samples,
            noise: self.stages.noise(),
            interferers: self.stages.interferers(),
            tracks: None,
            snapshot: self.snapshot,
        };
        if let State::Tracking(mut tracker) = self.state {
            tracker.advance();
            tracker.settle(self.stages.interference(), &self.options, emit)?;
            end.tracks = Some(tracker.finish(emit));
        }
        Ok(end)
    }

    /// Takes the chunk that has been gathered, the `last` of the stream or not.
    fn take_chunk(&mut self, last: bool, emit: &mut Emit) -> Result<(), ReceiverError> {
        let (stages, next) = (&mut self.stages, &mut self.next);
        let raw = self.chunks.chunk();
        match &mut self.state {
            State::Gathering(gathering) => {
                if gathering.take(raw, stages, last) {
                    let ends = self.info.samples == Some(self.chunks.position());
                    self.begin(ends, emit)?;
                }
            }
            State::Tracking(tracker) => {
                // While the channels track, the next chunk is conditioned.
                rayon::join(|| stages.treat(raw, next, last), || tracker.advance());
                tracker.settle(stages.interference(), &self.options, emit)?;
                if !next.is_empty() {
                    tracker.take(next, stages.depth());
                }
            }
            State::Done => (),
        }
        let interferers = self.stages.interferers();
        if interferers.len() > self.told {
            self.told = interferers.len();
            let from_s = self.chunks.position() as f64 / self.info.rate_hz - CHUNK_S;
            let from_s = from_s.max(0.0);
            emit(Event::Notice(Notice::Excised { from_s, interferers }));
        }
        Ok(())
    }

    /// Searches the head (of a short stream all of it), and starts the task.
    fn begin(&mut self, is_all: bool, emit: &mut Emit) -> Result<(), ReceiverError> {
        let State::Gathering(gathering) = std::mem::replace(&mut self.state, State::Done) else {
            return Ok(());
        };
        let mut head = gathering.finish(&mut self.stages, &self.options.search);
        let (rate_hz, options) = (self.stages.rate_hz(), &self.options);
        let interference = self.stages.interference();
        if let Task::Acquire { seconds } | Task::Look { seconds } = self.task {
            head.truncate((seconds * rate_hz).round() as usize);
        }
        let length = head.block.len() as u64;
        self.head_samples = length;
        let at_start =
            |sky: Option<ArraySky>| sky.map(|sky| Event::Sky(SkyEpoch { sample: 0, sky }));
        match self.task {
            Task::Look { .. } if !head.common_noise => {
                let sky = look_at(&head, rate_hz, interference, options, emit)?;
                at_start(Some(sky)).into_iter().for_each(emit);
            }
            Task::Acquire { .. } | Task::Look { .. } => {
                let shown = acquire_head(&head, rate_hz, options, length, interference, emit)?;
                at_start(shown.sky).into_iter().for_each(emit);
            }
            Task::Track => {
                let samples = length.min((REFINE_S * rate_hz) as u64);
                let shown = acquire_head(&head, rate_hz, options, samples, interference, emit)?;
                at_start(shown.sky.clone()).into_iter().for_each(&mut *emit);
                let known = self.stages.info().samples;
                let is_all =
                    is_all || known.is_some_and(|n| (n as f64) < SHORTEST_TRACK_S * rate_hz);
                self.snapshot = Some(SnapshotHead { samples, rate_hz, is_all });
                if !is_all {
                    let tracker = Tracker::new(head, &shown, interference, rate_hz, options, emit);
                    self.state = State::Tracking(Box::new(tracker));
                }
            }
        }
        Ok(())
    }
}

/// The sources without a search.
fn look_at(
    head: &Head,
    rate_hz: f64,
    interference: Option<&Interference>,
    options: &ReceiverOptions,
    emit: &mut Emit,
) -> Result<ArraySky, ReceiverError> {
    let survey = survey(&head.block, rate_hz, f64::INFINITY, interference, options)?;
    let beams = &BeamFormer::new(options.beams, &head.block);
    let (block, buffers) = (&head.block, &head.buffers[..]);
    let (start, end) = (0, block.len() as u64);
    let region = Region { block, buffers, beams, rate_hz, start, end, code_offset: 0.0 };
    let found = region.refine_all(&survey.cells, &options.search);
    emit(Event::Found(found.iter().map(|f| f.refined).collect()));
    survey.notices.into_iter().for_each(|notice| emit(Event::Notice(notice)));
    Ok(see(survey.sky, &found, interference, options))
}

/// The record of a source, read to its end or as far as the task needs it.
fn run(
    source: &mut dyn SampleSource,
    options: &ReceiverOptions,
    task: Task,
    progress: &mut dyn FnMut(u64),
) -> Result<Record, ReceiverError> {
    let mut receiver = Receiver::new(source.info(), options.clone(), task)?;
    let mut recorder = Recorder::default();
    let mut emit = |event: Event| recorder.take(&event);
    let chunk = receiver.chunk();
    let (mut block, mut next) = (Block::default(), Block::default());
    source.read(&mut block, chunk)?;
    while !block.is_empty() && !receiver.is_done() {
        // While the receiver works, the next chunk is read. (A source that waits for a thread which itself needs
        // rayon's must not be read so: it would wait for itself.)
        let (read, pushed) =
            rayon::join(|| source.read(&mut next, chunk), || receiver.push(&mut block, &mut emit));
        pushed?;
        progress(receiver.samples());
        read?;
        std::mem::swap(&mut block, &mut next);
    }
    let end = receiver.finish(&mut emit)?;
    Ok(recorder.finish(end, options, source.notes()))
}

/// [`Task::Acquire`] on a source.
///
/// # Errors
/// When the source fails, or those of [`Receiver::push`].
pub fn acquire(
    source: &mut dyn SampleSource,
    options: &ReceiverOptions,
    seconds: f64,
) -> Result<Record, ReceiverError> {
    run(source, options, Task::Acquire { seconds }, &mut |_| ())
}

/// [`Task::Look`] on a source.
///
/// # Errors
/// When the source fails, or those of [`Receiver::push`].
pub fn look(
    source: &mut dyn SampleSource,
    options: &ReceiverOptions,
    seconds: f64,
) -> Result<Record, ReceiverError> {
    run(source, options, Task::Look { seconds }, &mut |_| ())
}

/// [`Task::Track`] on a source. `progress` is given the samples done after each chunk.
///
/// # Errors
/// When the source fails, or those of [`Receiver::push`].
pub fn process(
    source: &mut dyn SampleSource,
    options: &ReceiverOptions,
    progress: &mut dyn FnMut(u64),
) -> Result<Record, ReceiverError> {
    run(source, options, Task::Track, progress)
}
