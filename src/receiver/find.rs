//! Finding satellites in a stretch of samples: searched over all channels, then refined on a beam each.

use super::CHUNK_S;
use super::spatial::head_covariance;
use crate::acquisition::{
    Acquisition, AcquisitionError, Refined, Refiner, SearchOptions, SearchPlan, masking, subtract,
};
use crate::array::code_periods::despread;
use crate::array::sky::interference::Interference;
use crate::array::{Beam, BeamKind, CMat, Manifold, Signature};
use crate::capture::Block;
use crate::correlator::{CodeTable, SampleBuffer};
use num_complex::Complex32;
use rayon::prelude::*;

/// A detection is confirmed when the refinement, over more signal, finds no less than this much of it, dB:
/// noise that passed the search's threshold falls by the ratio of the two lengths. A refinement over less than
/// four times the signal of the search decides nothing.
const CONFIRMED_DB: f64 = 6.0;
const CONFIRMING: f64 = 4.0;

/// Channels that a search sums at most, unless it is a deep one; the other elements come in with the beams.
const SEARCHED_CHANNELS: usize = 8;
/// Beams of a search, times the elements of a line, or the root of those of a plane each way.
const FAN: f64 = 2.0;

/// The channels that a search uses.
#[derive(Clone, Copy)]
pub(super) struct Channels<'a> {
    /// At most so many.
    pub(super) most: usize,
    /// Where jammers were removed.
    pub(super) interference: Option<&'a Interference>,
    /// The array's geometry.
    pub(super) manifold: Option<&'a Manifold>,
}

impl<'a> Channels<'a> {
    /// Some of the channels; with one of them, one of several that have common noise.
    pub(super) fn new(
        channels: usize,
        interference: Option<&'a Interference>,
        manifold: Option<&'a Manifold>,
    ) -> Self {
        Self { most: channels.min(SEARCHED_CHANNELS), interference, manifold }
    }
}

/// A satellite found.
#[derive(Clone, Debug)]
pub(super) struct Found {
    pub(super) refined: Refined,
    /// Its signature and the beam to it, with an array.
    pub(super) spatial: Option<(Signature, Beam)>,
}

/// Makes beams to signatures measured in a block.
pub(super) struct BeamFormer {
    /// Covariance of the samples, for beams that use it.
    covariance: Option<CMat>,
}

impl BeamFormer {
    pub(super) fn new(kind: BeamKind, block: &Block) -> Self {
        let looks = kind == BeamKind::Mvdr && block.channels() > 1;
        Self { covariance: looks.then(|| head_covariance(block)) }
    }

    pub(super) fn beam(&self, signature: &Signature) -> Beam {
        match &self.covariance {
            None => Beam::conventional(&signature.response),
            Some(covariance) => Beam::mvdr(&signature.response, covariance),
        }
    }
}

/// Samples `start..end` (stream indices), held twice: as they are, and in the buffers of correlators.
pub(super) struct Region<'a> {
    pub(super) block: &'a Block,
    pub(super) buffers: &'a [SampleBuffer],
    pub(super) beams: &'a BeamFormer,
    pub(super) rate_hz: f64,
    pub(super) start: u64,
    pub(super) end: u64,
    /// By which fraction codes run faster than their carriers say.
    pub(super) code_offset: f64,
}

/// Satellites in a block. Where jammers were removed the noise of the channels is correlated, and beams of independent
/// noise replace them. Where all elements of an array of known geometry are used, beams of their correlations decide
/// too. Cross-correlations of satellites `known` beforehand are not returned.
pub(super) fn search(
    block: &Block,
    rate_hz: f64,
    options: &SearchOptions,
    used: Channels<'_>,
    known: &[Acquisition],
) -> Result<Vec<Acquisition>, AcquisitionError> {
    let count = block.channels().min(used.most).max(1);
    let spread = |k: usize| k * block.channels() / count;
    let beams = used.interference.map_or(Vec::new(), Interference::free_beams);
    let formed: Vec<Vec<Complex32>> = beams
        .par_iter()
        .take(count)
        .map(|beam| {
            let mut samples = Vec::new();
            beam.form(block, &mut samples);
            samples
        })
        .collect();
    let channels: Vec<&[Complex32]> = match formed.is_empty() {
        true => (0..count).map(|k| block.channel(spread(k))).collect(),
        false => formed.iter().map(Vec::as_slice).collect(),
    };
    let fan: Vec<_> = match used.manifold {
        Some(manifold) if formed.is_empty() && count == manifold.elements() && count > 1 => {
            let along =
                if manifold.dimensions() < 2 { count as f64 } else { (count as f64).sqrt() };
            let points = manifold.grid((FAN * along).ceil() as usize);
            points.iter().map(|p| manifold.response(*p)).collect()
        }
        _ => Vec::new(),
    };
    let (mut found, mut refused, groups) = (Vec::new(), Vec::new(), options.by_code());
    for group in &groups {
        let plan = SearchPlan::new(rate_hz, group.clone())?.with_beams(&fan);
        match plan.search_channels(&channels, known) {
            Ok(more) => found.extend(more),
            Err(error) => refused.push(error),
        }
    }
    // What is too short for some codes may do for others.
    if refused.len() == groups.len()
        && let Some(error) = refused.pop()
    {
        return Err(error);
    }
    found.sort_by(|a, b| b.cn0_dbhz.total_cmp(&a.cn0_dbhz));
    Ok(found)
}

impl Region<'_> {
    /// Refines what a search found in these samples; what the refinement does not confirm is dropped. Satellites whose
    /// cross-correlations exceed the noise are subtracted from the samples of the others.
    pub(super) fn refine_all(&self, cells: &[Acquisition], searched: &SearchOptions) -> Vec<Found> {
        let strong = masking(cells, searched.coherent_ms as f64 * 1e-3);
        if strong.is_empty() {
            return self.refine_some(cells, searched);
        }
        let is_strong = |a: &Acquisition| strong.contains(a);
        let weak: Vec<Acquisition> = cells.iter().filter(|a| !is_strong(a)).copied().collect();
        let mut block = self.block.clone();
        let mut channels: Vec<_> = block.channels_mut().collect();
        let span_hz = 1e3 / searched.coherent_ms as f64;
        subtract(&mut channels, self.rate_hz, &strong, span_hz, self.code_offset);
        let buffers: Vec<SampleBuffer> = channels
            .iter()
            .map(|samples| {
                let mut buffer = SampleBuffer::starting_at(self.block.first_sample());
                buffer.push(samples);
                buffer
            })
            .collect();
        let without = Region { block: &block, buffers: &buffers, ..*self };
        let mut found = self.refine_some(&strong, searched);
        found.extend(without.refine_some(&weak, searched));
        found
    }

    /// Strongest first.
    fn refine_some(&self, cells: &[Acquisition], searched: &SearchOptions) -> Vec<Found> {
        let refine = |a: &Acquisition| self.refine(a, searched);
        let mut found: Vec<Found> = cells.par_iter().filter_map(refine).collect();
        let cn0 = |f: &Found| f.refined.acquisition.cn0_dbhz;
        found.sort_by(|a, b| cn0(b).total_cmp(&cn0(a)));
        found
    }

    fn refine(&self, cell: &Acquisition, searched: &SearchOptions) -> Option<Found> {
        let timing = cell.transmission.timing();
        let coherent_s = match timing.is_aligned {
            true => cell.transmission.signal.period_s(),
            false => searched.coherent_ms as f64 * 1e-3,
        };
        let span_hz = 1.0 / coherent_s;
        let searched_s = (searched.coherent_ms * searched.max_windows) as f64 * 1e-3;
        let confirms = (self.end - self.start) as f64 / self.rate_hz >= CONFIRMING * searched_s;
        let table = CodeTable::new(cell.transmission, self.rate_hz);
        let spatial = self.signature(cell, &table);
        let own = spatial.as_ref().map(|s| self.beam_buffer(&s.1));
        let buffer = own.as_ref().unwrap_or(&self.buffers[0]);
        let refined = Refiner::new(buffer, self.rate_hz, self.start, self.end)
            .with_doppler_rate(searched.doppler_rate_hz_s)
            .with_code_offset(self.code_offset)
            .refine(cell, &table, span_hz)
            .unwrap_or_else(|| Refined::unrefined(cell, self.rate_hz, searched.coherent_ms));
        // Once more at the refined code phase and Doppler.
        let spatial =
            spatial.and_then(|first| self.signature(&refined.acquisition, &table).or(Some(first)));
        let is_there = refined.acquisition.cn0_dbhz > cell.cn0_dbhz - CONFIRMED_DB;
        (is_there || !confirms).then_some(Found { refined, spatial })
    }

    /// The signature of a satellite, over at most [`CHUNK_S`], and the beam to it.
    fn signature(&self, cell: &Acquisition, table: &CodeTable) -> Option<(Signature, Beam)> {
        if self.buffers.len() < 2 {
            return None;
        }
        let end = self.end.min(self.start + (CHUNK_S * self.rate_hz) as u64);
        let at = (cell.doppler_hz, cell.code_phase_chips);
        let prompts = despread(self.buffers, self.rate_hz, (self.start, end), at, table);
        let signature = Signature::estimate(&prompts)?;
        let beam = self.beams.beam(&signature);
        Some((signature, beam))
    }

    fn beam_buffer(&self, beam: &Beam) -> SampleBuffer {
        let (mut samples, mut buffer) =
            (Vec::new(), SampleBuffer::starting_at(self.block.first_sample()));
        beam.form(self.block, &mut samples);
        buffer.push(&samples);
        buffer
    }
}
