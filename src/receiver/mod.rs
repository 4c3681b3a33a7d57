//! The pipeline: the stages of the house in their order, from a source of samples to positions.

mod find;
mod head;
mod input;
mod sky;
mod spatial;
mod survey;
mod tracker;

use crate::acquisition::snapshot_epoch;
use crate::acquisition::{AcquisitionError, Refined, SearchOptions};
use crate::array::{ArraySky, BeamKind, LookOptions, SkyEpoch};
use crate::capture::{SampleSource, SourceError};
use crate::front_end::{ImpulseReport, Suppression};
use crate::gnss::antenna::ArrayDescription;
use crate::gnss::observation::ObservationEpoch;
use crate::gnss::{GpsTime, NavigationData};
use crate::position::{Fix, PositioningError, PositioningOptions, TimeSearch, solve_snapshot};
use crate::tracking::TrackingOptions;
use find::{BeamFormer, Region};
use head::acquire_head;
use input::Input;
use sky::{judge_sky, see};
use survey::survey;
use tracker::track_all;

/// Signal that the first search and its refinement see, s.
const HEAD_S: f64 = 1.0;

/// Signal that a refinement uses, s: a Doppler that changes by 10 Hz/s turns the carrier by no more than
/// 0.3 rad from its mean over it.
const REFINE_S: f64 = 0.2;

/// Recordings shorter than this are snapshots: they hold no subframe.
const SHORTEST_TRACK_S: f64 = 6.0;

/// The reason for no fix where the search found nothing.
const NOTHING_FOUND: &str = "no satellite was found";

/// What a run is to do.
#[derive(Clone, Debug)]
pub struct ReceiverOptions {
    /// The first search.
    pub search: SearchOptions,
    /// The loops.
    pub tracking: TrackingOptions,
    /// The position solutions.
    pub positioning: PositioningOptions,
    /// Navigation data known beforehand.
    pub navigation: NavigationData,
    /// GPS time of the first sample, as well as it is known; without it a snapshot's time is searched for
    /// wherever the navigation data reach.
    pub time: Option<GpsTime>,
    /// Time between fixes, s.
    pub interval_s: f64,
    /// The antenna array whose elements the channels are, where it is known: directions need it, finding and
    /// tracking do not.
    pub array: Option<ArrayDescription>,
    /// How an array looks for sources.
    pub look: LookOptions,
    /// How an array's beams to the satellites are made.
    pub beams: BeamKind,
    /// What is done about impulsive noise, before anything else.
    pub suppression: Suppression,
    /// Integer factor by which the rate is lowered then.
    pub decimation: usize,
}

impl Default for ReceiverOptions {
    /// A cold start: the defaults of all stages, nothing known, a fix each second.
    fn default() -> Self {
        Self {
            search: SearchOptions::default(),
            tracking: TrackingOptions::default(),
            positioning: PositioningOptions::default(),
            navigation: NavigationData::default(),
            time: None,
            interval_s: 1.0,
            array: None,
            look: LookOptions::default(),
            beams: BeamKind::default(),
            suppression: Suppression::default(),
            decimation: 1,
        }
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
    /// The satellites as an array sees them; absent with one channel.
    pub sky: Option<ArraySky>,
    /// The same while they are tracked, about once a second.
    pub sky_epochs: Vec<SkyEpoch>,
    /// Impulsive noise, where some was found and suppressed.
    pub noise: Option<ImpulseReport>,
    /// What a person should know.
    pub warnings: Vec<String>,
    /// Why there is no fix, where there is none.
    pub reason: Option<String>,
}

/// Acquisition alone: the satellites in the first `seconds` of a source, refined over all of them.
pub fn acquire(
    source: &mut dyn SampleSource,
    options: &ReceiverOptions,
    seconds: f64,
) -> Result<Outcome, ReceiverError> {
    let mut input = Input::new(source, options)?;
    let mut head = input.head(seconds, &options.search)?;
    let wanted = (seconds * input.rate_hz()).round() as usize;
    head.truncate(wanted);
    let mut outcome = Outcome { samples: head.block.len() as u64, ..Outcome::default() };
    acquire_head(
        &head,
        input.rate_hz(),
        options,
        outcome.samples,
        input.interference(),
        &mut outcome,
    )?;
    outcome.noise = input.noise();
    judge_sky(&mut outcome, input.rate_hz(), options);
    outcome.warnings.splice(0..0, input.source.warnings());
    Ok(outcome)
}

/// The sky as the samples of the first `seconds` show it without a search: sources and directions, signals in
/// the code periods, and the satellites that they turn out to be.
pub fn look(
    source: &mut dyn SampleSource,
    options: &ReceiverOptions,
    seconds: f64,
) -> Result<Outcome, ReceiverError> {
    let mut input = Input::new(source, options)?;
    let mut head = input.head(seconds, &options.search)?;
    let rate_hz = input.rate_hz();
    head.truncate((seconds * rate_hz).round() as usize);
    let end = head.block.len() as u64;
    let mut outcome = Outcome { samples: end, ..Outcome::default() };
    if head.shared_noise {
        acquire_head(&head, rate_hz, options, end, None, &mut outcome)?;
    } else {
        let survey = survey(&head.block, rate_hz, input.interference(), options)?;
        let beams = &BeamFormer::new(options.beams, &head.block);
        let (block, buffers) = (&head.block, &head.buffers[..]);
        let region = Region { block, buffers, beams, rate_hz, start: 0, end };
        let found = region.refine_all(&survey.cells, &options.search);
        outcome.acquisitions = found.iter().map(|f| f.refined).collect();
        outcome.warnings = survey.warnings;
        outcome.sky = Some(see(survey.sky, &found, rate_hz, input.interference(), options));
    }
    outcome.noise = input.noise();
    judge_sky(&mut outcome, input.rate_hz(), options);
    outcome.warnings.splice(0..0, input.source.warnings());
    Ok(outcome)
}

/// The whole receiver. `progress` is told the samples done after each chunk.
pub fn process(
    source: &mut dyn SampleSource,
    options: &ReceiverOptions,
    progress: &mut (dyn FnMut(u64) + Send),
) -> Result<Outcome, ReceiverError> {
    let mut input = Input::new(source, options)?;
    let rate_hz = input.rate_hz();
    let head = input.head(HEAD_S, &options.search)?;
    let mut outcome = Outcome { navigation: options.navigation.clone(), ..Outcome::default() };
    let length = head.block.len() as u64;
    let refine = length.min((REFINE_S * rate_hz) as u64);
    let found = acquire_head(&head, rate_hz, options, refine, input.interference(), &mut outcome)?;
    let is_snapshot = head.is_all
        || input.info().samples.is_some_and(|n| (n as f64) < SHORTEST_TRACK_S * rate_hz);
    if is_snapshot {
        outcome.samples = length;
        solve_head(refine, rate_hz, options, &mut outcome);
    } else {
        track_all(&mut input, head, found, options, &mut outcome, progress)?;
        if outcome.fixes.is_empty() && !options.navigation.is_empty() {
            // No message could be read, but the start of the recording is a snapshot all the same.
            solve_head(refine, rate_hz, options, &mut outcome);
        }
    }
    outcome.noise = input.noise();
    judge_sky(&mut outcome, input.rate_hz(), options);
    outcome.warnings.splice(0..0, input.source.warnings());
    Ok(outcome)
}

/// The fix of a snapshot.
fn solve_head(samples: u64, rate_hz: f64, options: &ReceiverOptions, outcome: &mut Outcome) {
    let found = outcome.acquisitions.len();
    let reason = match found {
        0 => Some(NOTHING_FOUND.to_owned()),
        _ if options.navigation.is_empty() => Some(format!(
            "{found} satellites, but the recording is too short for their navigation message: give --nav FILE, and --time T if it is known to some hours or better, for a snapshot fix"
        )),
        _ => {
            // Without a time any instant serves as the origin of the search.
            let origin = options.navigation.iter().next().map(|e| e.toe);
            let time = options.time.or(origin).unwrap_or(GpsTime::from_week_tow(0, 0.0));
            let mut epoch = snapshot_epoch(&outcome.acquisitions, time, samples, rate_hz);
            let mut positioning = options.positioning;
            if options.time.is_none() {
                positioning.time_uncertainty_s = f64::INFINITY;
            }
            let solved = solve_snapshot(&epoch, &options.navigation, &positioning);
            if let (None, Ok(fix)) = (options.time, &solved) {
                epoch.receive_time = fix.time;
            }
            if options.time.is_some() || solved.is_ok() {
                outcome.epochs.push(epoch);
            }
            match solved {
                Ok(fix) => {
                    // Without a time the clock has no reading that could be off.
                    let clock_bias_s = options.time.map_or(Some(0.0), |_| fix.clock_bias_s);
                    outcome.warnings.extend(fix.time_search.and_then(|s| left_out(&s)));
                    outcome.first_fix_s = Some(samples as f64 / rate_hz);
                    outcome.fixes.push(Fix { clock_bias_s, ..fix });
                    None
                }
                Err(error @ PositioningError::Unexplained { .. }) => Some(format!(
                    "{error}; a greater --time-uncertainty, such as 5h, searches further"
                )),
                Err(error @ PositioningError::TimeNotFound { .. }) => Some(format!(
                    "{error}; --time narrows the search, --troposphere none suits signals simulated without one"
                )),
                Err(error) => Some(error.to_string()),
            }
        }
    };
    outcome.reason = reason;
}

/// What to say of the part of a window of time that was not searched.
fn left_out(search: &TimeSearch) -> Option<String> {
    let hours = search.left_out_s / 3600.0;
    (hours.is_finite() && hours > 1.0 / 60.0).then(|| {
        format!(
            "{hours:.1} h of the time allowed were not searched, as too few ephemerides are in force then"
        )
    })
}
