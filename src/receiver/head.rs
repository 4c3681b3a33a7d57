//! The start of a stream: read, searched and refined.

use super::{Outcome, ReceiverError, ReceiverOptions};
use crate::acquisition::{
    Acquisition, AcquisitionError, Refined, Refiner, SearchOptions, SearchPlan, Slip, find_slip,
    is_mirrored, remove_shadows,
};
use crate::capture::{Block, SampleSource, SourceError, StreamInfo};
use crate::correlator::{CodeTable, SampleBuffer};
use crate::front_end::{Conditioner, ImpulseReport, ImpulseSuppressor};
use num_complex::Complex32;
use rayon::prelude::*;

/// Most samples that a head holds.
const HEAD_SAMPLES: f64 = 8e6;

/// Samples processed at a time, s.
pub(super) const CHUNK_S: f64 = 0.1;

/// With fewer satellites than this a deeper search follows, of this many windows.
const ENOUGH_SATELLITES: usize = 8;
pub(super) const DEEP_WINDOWS: usize = 16;

/// Signal that a mirrored spectrum is looked for in, s.
const MIRROR_S: f64 = 0.1;
const MIRRORED: &str = "the spectrum is mirrored: code drifts and Dopplers disagree in sign; read it with --conjugate (or without, if it was given)";

/// A detection is confirmed when the refinement, over more signal, finds no less than this much of it, dB:
/// noise that passed the search's threshold falls by the ratio of the two lengths. Less than four times
/// the signal of the search says nothing new.
const CONFIRMED_DB: f64 = 6.0;
const CONFIRMING: f64 = 4.0;

/// The start of a stream: what acquisition sees.
pub(super) struct Head {
    pub(super) samples: Vec<Complex32>,
    pub(super) buffer: SampleBuffer,
    /// Whether the stream ends with it.
    pub(super) is_all: bool,
}

/// The source behind its conditioning.
pub(super) struct Input<'a> {
    pub(super) source: &'a mut dyn SampleSource,
    suppressor: ImpulseSuppressor,
    conditioner: Conditioner,
    raw: Block,
}

impl<'a> Input<'a> {
    pub(super) fn new(source: &'a mut dyn SampleSource, options: &ReceiverOptions) -> Self {
        let suppressor = ImpulseSuppressor::new(options.suppression, source.info());
        let conditioner = Conditioner::new(source.info(), options.decimation);
        Self { source, suppressor, conditioner, raw: Block::default() }
    }

    /// What was found of impulses so far.
    pub(super) fn noise(&self) -> Option<ImpulseReport> {
        self.suppressor.report()
    }

    pub(super) fn info(&self) -> &StreamInfo {
        self.conditioner.info()
    }

    pub(super) fn rate_hz(&self) -> f64 {
        self.info().rate_hz
    }

    /// Puts the next chunk into `block`; one without samples at the end.
    pub(super) fn read(&mut self, block: &mut Block) -> Result<(), SourceError> {
        let want = (CHUNK_S * self.source.info().rate_hz).ceil() as usize;
        if self.conditioner.is_identity() {
            self.source.read(block, want)?;
            self.suppressor.process(block);
        } else {
            self.source.read(&mut self.raw, want)?;
            self.suppressor.process(&mut self.raw);
            self.conditioner.process(&self.raw, block);
        }
        Ok(())
    }

    pub(super) fn head(&mut self, seconds: f64) -> Result<Head, SourceError> {
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
pub(super) fn acquire_head(
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
    // In 0.1 s even the code of a mirrored satellite stays within a chip of where it is expected.
    let short = refine.min((MIRROR_S * rate_hz) as u64);
    let first = refine_all(&head.buffer, rate_hz, 0, short, &found, &search);
    if is_mirrored(&first) {
        outcome.warnings.push(MIRRORED.to_owned());
        outcome.acquisitions = first;
        return Ok(());
    }
    let mut end = refine;
    if let Some(slip) = find_slip(&head.samples, rate_hz, &found) {
        outcome.warnings.push(slip_warning(&slip, rate_hz));
        end = end.min(slip.after);
    }
    outcome.acquisitions = refine_all(&head.buffer, rate_hz, 0, end, &found, &search);
    Ok(())
}

pub(super) fn search_head(
    samples: &[Complex32],
    rate_hz: f64,
    options: &SearchOptions,
) -> Result<Vec<Acquisition>, AcquisitionError> {
    let plan = SearchPlan::new(rate_hz, options.clone())?;
    let mut found = plan.search(samples)?;
    remove_shadows(&mut found, options.coherent_ms, plan.windows(samples.len()));
    Ok(found)
}

pub(super) fn refine_all(
    buffer: &SampleBuffer,
    rate_hz: f64,
    start: u64,
    end: u64,
    found: &[Acquisition],
    search: &SearchOptions,
) -> Vec<Refined> {
    let refiner = Refiner::new(buffer, rate_hz, start, end);
    let span_hz = 1e3 / search.coherent_ms as f64;
    let searched = (search.coherent_ms * search.max_windows) as f64 * 1e-3;
    let confirms = (end - start) as f64 / rate_hz >= CONFIRMING * searched;
    let refine = |a: &Acquisition| {
        let refined = refiner.refine(a, &CodeTable::new(a.sv, rate_hz), span_hz);
        let refined = refined.unwrap_or_else(|| Refined::unrefined(a, rate_hz, search.coherent_ms));
        let is_there = refined.acquisition.cn0_dbhz > a.cn0_dbhz - CONFIRMED_DB;
        (is_there || !confirms).then_some(refined)
    };
    let mut refined: Vec<Refined> = found.par_iter().filter_map(refine).collect();
    refined.sort_by(|a, b| b.acquisition.cn0_dbhz.total_cmp(&a.acquisition.cn0_dbhz));
    refined
}

pub(super) fn slip_warning(slip: &Slip, rate_hz: f64) -> String {
    format!(
        "samples are missing or double: between {:.1} and {:.1} ms the code phases of all satellites jump by {:+.1} us ({:+.0} samples)",
        slip.after as f64 / rate_hz * 1e3,
        slip.before as f64 / rate_hz * 1e3,
        slip.jump_s * 1e6,
        slip.jump_s * rate_hz
    )
}
