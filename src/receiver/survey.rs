//! Sources at the start of a stream, and the satellites found in them: the first stage of acquisition of an array.

use super::ReceiverOptions;
use super::event::Notice;
use crate::acquisition::search::searched_signal;
use crate::acquisition::{Acquisition, AcquisitionError};
use crate::array::code_periods::periods::CodePeriods;
use crate::array::code_periods::{CodePeriodOptions, search_periods};
use crate::array::sky::interference::Interference;
use crate::array::{ArraySky, JaneError, LookCodes, Manifold, look};
use crate::capture::Block;
use crate::gnss::signal::of as signal_of;
use crate::gnss::{Constellation, Sv, Transmission};
use num_complex::Complex32;

/// Systems that send C/A codes: what a source without one of the codes asked for may be.
const CA_CODES: [Constellation; 3] = [Constellation::Gps, Constellation::Qzss, Constellation::Sbas];
/// Time that is coherent in a look: of one navigation bit, s.
const BLOCK_S: f64 = 0.02;
/// Code periods that a look needs.
const MIN_PERIODS: usize = 10;
/// A look over as long as this, s, follows where the first shows few satellites.
pub(super) const LONG_S: f64 = 0.2;
const FEW_SATELLITES: usize = 8;
/// Maximum number of rows, elements x periods, of a look: its memory.
const MOST_ROWS: usize = 6400;
/// Up to so many elements their code periods are decomposed too, which needs fewer elements than a look; the maximum
/// number of rows there, whose time grows with their cube.
const FEW_ELEMENTS: usize = 4;
const MOST_DECOMPOSED: usize = 100;

/// Results of the survey: sources before despreading, satellites, and notices.
#[derive(Default)]
pub(super) struct Survey {
    pub(super) sky: ArraySky,
    pub(super) cells: Vec<Acquisition>,
    pub(super) notices: Vec<Notice>,
    /// Whether the look was a long one and left no source without a code: a deep search would find only satellites
    /// between its threshold and the look's.
    pub(super) is_complete: bool,
}

/// Surveys the start of a stream, at most so many seconds: sources by their code periods, with directions where the
/// geometry is known, and the codes in them.
pub(super) fn survey(
    block: &Block,
    rate_hz: f64,
    longest_s: f64,
    interference: Option<&Interference>,
    options: &ReceiverOptions,
) -> Result<Survey, AcquisitionError> {
    let elements = block.channels();
    // Sources are told by code periods of one length, those of the first satellites that were asked for.
    let Some(asked) = options.search.by_code().into_iter().next() else {
        return Err(AcquisitionError::Options("no satellite is requested"));
    };
    let signal = searched_signal(&asked.satellites, rate_hz)?;
    let coherent = (BLOCK_S / signal.period_s()).round().max(1.0) as usize;
    let channels: Vec<&[Complex32]> = (0..elements).map(|c| block.channel(c)).collect();
    let periods = |count: usize| {
        let samples = ((count + 1) as f64 * signal.period_s() * rate_hz) as usize;
        let first: Vec<&[Complex32]> =
            channels.iter().map(|c| &c[..c.len().min(samples)]).collect();
        CodePeriods::new(&first, rate_hz, signal, count)
    };
    let mut survey = Survey::default();
    let manifold = options.array.as_ref().filter(|_| elements > 1);
    let mut manifold = manifold.map(|array| Manifold::new(array.in_enu()));
    if manifold.as_ref().is_some_and(|m| m.dimensions() == 0) {
        survey.notices.push(Notice::NoDirections(JaneError::NoDirections.to_string()));
        manifold = None;
    }
    let satellites = &asked.satellites;
    let alike = |t: &Transmission| {
        (t.signal.chips, t.signal.chip_rate_hz) == (signal.chips, signal.chip_rate_hz)
    };
    let others: Vec<Transmission> = CA_CODES
        .into_iter()
        .flat_map(Sv::all)
        .map(signal_of)
        .filter(|t| alike(t) && !satellites.contains(t))
        .collect();
    let codes = LookCodes {
        satellites,
        others: &others,
        doppler_hz: options.search.doppler_hz,
        false_alarm: options.search.false_alarm,
    };
    let look_at = |count: usize| {
        let data = periods(count);
        let block = coherent.min(data.periods);
        look(data, block, manifold.as_ref(), interference, &codes, &options.look)
    };
    let whole = (block.len() as f64 / (signal.period_s() * rate_hz)) as usize;
    if whole < MIN_PERIODS {
        return Ok(survey);
    }
    let longest = (longest_s / signal.period_s()) as usize;
    let long = longest.min(MOST_ROWS / elements).min(whole) / coherent * coherent;
    let looked = look_at(coherent).and_then(|looked| {
        let is_few = looked.found.len() < FEW_SATELLITES && long > coherent;
        if is_few { look_at(long) } else { Ok(looked) }
    });
    let mut looked = match looked {
        Ok(looked) => looked,
        Err(error) => {
            survey.notices.push(Notice::NoDirections(error.to_string()));
            return Ok(survey);
        }
    };
    survey.cells = looked.found.iter().map(|f| f.acquisition).collect();
    if elements <= FEW_ELEMENTS && options.searches_rest {
        let (low, high) = options.search.doppler_hz;
        let is_left = |t: &_| survey.cells.iter().all(|c| c.transmission != *t);
        let most = MOST_DECOMPOSED / elements;
        let asked = CodePeriodOptions {
            satellites: asked.satellites.iter().copied().filter(is_left).collect(),
            max_doppler_hz: low.abs().max(high.abs()),
            ..CodePeriodOptions::new(elements, most)
        };
        let more =
            search_periods(looked.rest, interference.map_or(0, Interference::count), &asked)?;
        survey.cells.extend(more.found.iter().map(|f| f.acquisition));
        looked.picture.transforms.0 += more.transforms;
    }
    let is_named = looked.picture.sources.iter().all(|s| s.sv.is_some());
    survey.is_complete = looked.picture.periods as f64 * signal.period_s() >= LONG_S && is_named;
    survey.sky.picture = Some(looked.picture);
    Ok(survey)
}
