//! The start of a stream, searched and refined.

use super::find::{BeamFormer, Found, Region, search};
use super::input::Head;
use super::sky::see;
use super::survey::survey;
use super::{Outcome, ReceiverError, ReceiverOptions};
use crate::acquisition::{
    Acquisition, AcquisitionError, Refined, SearchOptions, Slip, find_slip, is_mirrored,
};
use crate::array::ArraySky;
use crate::array::sky::interference::Interference;

/// With fewer satellites than this a deeper search follows.
const ENOUGH_SATELLITES: usize = 8;

/// Signal that a mirrored spectrum is looked for in, s.
const MIRROR_S: f64 = 0.1;
const MIRRORED: &str = "the spectrum is mirrored: code drifts and Dopplers disagree in sign; read it with --conjugate (or without, if it was given)";

/// Searches the head, deeper where little is found, and refines over its first `refine` samples.
pub(super) fn acquire_head(
    head: &Head,
    rate_hz: f64,
    options: &ReceiverOptions,
    refine: u64,
    interference: Option<&Interference>,
    outcome: &mut Outcome,
) -> Result<Vec<Found>, ReceiverError> {
    let whole_ms = (head.block.len() as f64 / rate_hz * 1e3 + 1e-6).floor() as usize;
    let mut asked = options.search.clone();
    asked.coherent_ms = asked.coherent_ms.min(whole_ms).max(1);
    let mut surveyed = None;
    let searched = if head.shared_noise { 1 } else { head.block.channels() };
    if searched > 1 {
        let survey = survey(&head.block, rate_hz, interference, options)?;
        asked.satellites.retain(|t| survey.cells.iter().all(|c| c.transmission != *t));
        surveyed = Some(survey);
    }
    let known: Vec<Acquisition> = surveyed.iter().flat_map(|s| s.cells.clone()).collect();
    let search_rest = |asked: &SearchOptions| -> Result<Vec<Acquisition>, AcquisitionError> {
        if asked.satellites.is_empty() {
            return Ok(known.clone());
        }
        search(&head.block, rate_hz, asked, searched, interference, &known)
    };
    let mut cells = search_rest(&asked)?;
    let deep = asked.max_windows.max(deep_windows(searched));
    let deeper = deep > asked.max_windows && whole_ms > asked.coherent_ms * asked.max_windows;
    if cells.len() < ENOUGH_SATELLITES && deeper {
        asked.max_windows = deep;
        cells = search_rest(&asked)?;
    }
    let beams = &BeamFormer::new(options.beams, &head.block);
    let (block, buffers) = (&head.block, &head.buffers[..]);
    let region = |end: u64| Region { block, buffers, beams, rate_hz, start: 0, end };
    // In 0.1 s even the code of a mirrored satellite stays within a chip of where it is expected.
    let short = refine.min((MIRROR_S * rate_hz) as u64);
    let mut found = region(short).refine_all(&cells, &asked);
    let refined: Vec<Refined> = found.iter().map(|f| f.refined).collect();
    if is_mirrored(&refined) {
        outcome.warnings.push(MIRRORED.to_owned());
    } else {
        let mut end = refine;
        if let Some(slip) = find_slip(head.block.channel(0), rate_hz, &cells) {
            outcome.warnings.push(slip_warning(&slip, rate_hz));
            end = end.min(slip.after);
        }
        found = region(end).refine_all(&cells, &asked);
    }
    outcome.acquisitions = found.iter().map(|f| f.refined).collect();
    if head.block.channels() > 1 {
        let mut sky = ArraySky::default();
        if let Some(survey) = surveyed {
            outcome.warnings.extend(survey.warnings);
            sky = survey.sky;
        }
        outcome.sky = Some(see(sky, &found, rate_hz, interference, options));
    }
    Ok(found)
}

/// Windows of a deeper search: 16 of one channel, and with more channels half as many looks each.
pub(super) fn deep_windows(channels: usize) -> usize {
    if channels == 1 { 16 } else { (32 / channels).max(2) }
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
