//! Sources at the start of a stream: directions without codes, and signals by their code periods.

use super::CHUNK_S;
use super::ReceiverOptions;
use super::event::Notice;
use crate::acquisition::{Acquisition, AcquisitionError};
use crate::array::code_periods::{CodePeriodOptions, search_code_periods};
use crate::array::sky::interference::Interference;
use crate::array::{ArraySky, BlindCount, LookError, Manifold, look};
use crate::capture::Block;
use num_complex::Complex32;

/// Code periods in the decomposition: of an array, and of one antenna.
const PERIODS: usize = 20;
const PERIODS_OF_ONE: usize = 100;
/// Maximum number of rows, elements x periods, of the decomposition: its time grows with their cube.
const MOST_ROWS: usize = 512;

/// Results of the survey: sources before despreading, satellites, and notices.
pub(super) struct Survey {
    pub(super) sky: ArraySky,
    pub(super) cells: Vec<Acquisition>,
    pub(super) notices: Vec<Notice>,
}

/// Surveys the start of a stream: directions without codes where the geometry is known, and signals by their code
/// periods always.
pub(super) fn survey(
    block: &Block,
    rate_hz: f64,
    interference: Option<&Interference>,
    options: &ReceiverOptions,
) -> Result<Survey, AcquisitionError> {
    let elements = block.channels();
    let first = |seconds: f64| -> Vec<&[Complex32]> {
        let len = block.len().min((seconds * rate_hz) as usize);
        (0..elements).map(|c| &block.channel(c)[..len]).collect()
    };
    let mut survey = Survey { sky: ArraySky::default(), cells: Vec::new(), notices: Vec::new() };
    if let Some(array) = options.array.as_ref().filter(|_| elements > 1) {
        let manifold = Manifold::new(array.in_enu());
        match look(&first(CHUNK_S), &manifold, interference, &options.look) {
            Ok(picture) => survey.sky.picture = Some(picture),
            // Elements at one position, or samples of zeros: the rest of the receiver does without directions.
            Err(error @ (LookError::Jane(_) | LookError::NoNoise | LookError::Sparse(_))) => {
                survey.notices.push(Notice::NoDirections(error.to_string()));
            }
        }
    }
    let periods =
        if elements == 1 { PERIODS_OF_ONE } else { PERIODS.min(MOST_ROWS / elements).max(1) };
    let (low, high) = options.search.doppler_hz;
    let asked = CodePeriodOptions {
        satellites: options.search.satellites.clone(),
        max_doppler_hz: low.abs().max(high.abs()),
        ..CodePeriodOptions::new(elements, periods)
    };
    let nulled = interference.map_or(0, Interference::count);
    let found = search_code_periods(&first(1e-3 * (periods + 1) as f64), rate_hz, nulled, &asked)?;
    if let Some(picture) = &mut survey.sky.picture
        && found.svd.division.rank.max(found.found.len()) + nulled >= elements
    {
        picture.crowded = true;
        picture.sources.clear();
    }
    survey.cells = found.found.iter().map(|f| f.acquisition).collect();
    survey.sky.blind = Some(BlindCount {
        periods,
        signals: found.svd.division.rank,
        satellites: survey.cells.iter().map(Acquisition::sv).collect(),
        transforms: found.transforms,
        full_search_transforms: found.full_search_transforms,
    });
    Ok(survey)
}
