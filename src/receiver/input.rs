//! The stream as the receiver sees it: jammers removed, impulses suppressed, conditioned; and its start held.

use super::find::search;
use super::spatial::SpatialFilter;
use super::{ReceiverError, ReceiverOptions};
use crate::acquisition::SearchOptions;
use crate::array::sky::interference::Interference;
use crate::capture::{Block, SampleSource, SourceError, StreamInfo};
use crate::correlator::SampleBuffer;
use crate::front_end::{Conditioner, ImpulseReport, ImpulseSuppressor};
use num_complex::Complex64;

/// Most samples that a head holds: of one channel, and of all together.
const HEAD_SAMPLES: f64 = 8e6;
const HEAD_SAMPLES_OF_ALL: f64 = 24e6;

/// Samples processed at a time, s.
pub(super) const CHUNK_S: f64 = 0.1;

/// Signal by which it is judged whether what the elements have in common is a jammer, s.
const JUDGED_S: f64 = 0.025;

/// Satellites below this C/N0 do not count for that, dB-Hz: noise that the elements share makes some.
const SOUND_DBHZ: f64 = 30.0;

/// The start of a stream: what acquisition sees.
pub(super) struct Head {
    pub(super) block: Block,
    /// The same samples as the correlators read them, by channel.
    pub(super) buffers: Vec<SampleBuffer>,
    /// Whether the stream ends with it.
    pub(super) is_all: bool,
    /// Whether the elements share their noise, so that only one of them can be searched.
    pub(super) shared_noise: bool,
}

impl Head {
    /// Keeps the first `samples` of each channel.
    pub(super) fn truncate(&mut self, samples: usize) {
        self.block.truncate(samples.max(1));
    }
}

/// What is done to each block, in this order.
#[derive(Clone)]
struct Stages {
    real: bool,
    spatial: Option<SpatialFilter>,
    suppressor: ImpulseSuppressor,
    conditioner: Conditioner,
    calibration: Option<Vec<Complex64>>,
}

impl Stages {
    /// Treats the next block: `raw` is changed on the way to `block`.
    fn treat(&mut self, raw: &mut Block, block: &mut Block) {
        // Real samples hold each wave twice, with opposite phases: jammers are removed from them when they
        // are complex.
        if let Some(spatial) = self.spatial.as_mut().filter(|_| !self.real) {
            spatial.process(raw);
        }
        self.suppressor.process(raw);
        if self.conditioner.is_identity() {
            std::mem::swap(raw, block);
        } else {
            self.conditioner.process(raw, block);
        }
        if let Some(spatial) = self.spatial.as_mut().filter(|_| self.real) {
            spatial.process(block);
        }
        if let Some(weights) = &self.calibration {
            block.weight_channels(weights);
        }
    }
}

/// The source behind its conditioning.
pub(super) struct Input<'a> {
    pub(super) source: &'a mut dyn SampleSource,
    stages: Stages,
    raw: Block,
}

impl<'a> Input<'a> {
    pub(super) fn new(
        source: &'a mut dyn SampleSource,
        options: &ReceiverOptions,
    ) -> Result<Self, ReceiverError> {
        let info = source.info();
        let channels = info.channels;
        if let Some(array) = options.array.as_ref().filter(|a| a.len() != channels) {
            return Err(ReceiverError::Array { elements: array.len(), channels });
        }
        let stages = Stages {
            real: info.real,
            spatial: (channels > 1).then(SpatialFilter::default),
            suppressor: ImpulseSuppressor::new(options.suppression, info),
            conditioner: Conditioner::new(info, options.decimation),
            calibration: options.array.as_ref().and_then(|a| a.calibration.clone()),
        };
        Ok(Self { source, stages, raw: Block::default() })
    }

    /// Jammers that were removed, where there were any.
    pub(super) fn interference(&self) -> Option<&Interference> {
        self.stages.spatial.as_ref()?.interference()
    }

    /// What was found of impulses so far.
    pub(super) fn noise(&self) -> Option<ImpulseReport> {
        self.stages.suppressor.report()
    }

    pub(super) fn info(&self) -> &StreamInfo {
        self.stages.conditioner.info()
    }

    pub(super) fn rate_hz(&self) -> f64 {
        self.info().rate_hz
    }

    /// Puts the next chunk into `block`; one without samples at the end.
    pub(super) fn read(&mut self, block: &mut Block) -> Result<(), SourceError> {
        let want = self.chunk();
        self.source.read(&mut self.raw, want)?;
        self.stages.treat(&mut self.raw, block);
        Ok(())
    }

    fn chunk(&self) -> usize {
        (CHUNK_S * self.source.info().rate_hz).ceil() as usize
    }

    /// The first `seconds`. Where the elements have something strong in common that looks like a jammer, but
    /// one element alone shows more satellites (by `asked`) than all do without it, it was their common
    /// noise, and stays.
    pub(super) fn head(
        &mut self,
        seconds: f64,
        asked: &SearchOptions,
    ) -> Result<Head, ReceiverError> {
        let channels = self.info().channels;
        let most = HEAD_SAMPLES.min(HEAD_SAMPLES_OF_ALL / channels as f64);
        let want = (seconds * self.rate_hz()).min(most) as usize;
        let fresh = Stages { spatial: None, ..self.stages.clone() };
        let (mut raws, mut blocks, mut len, mut is_all) = (Vec::new(), Vec::new(), 0, false);
        while len < want {
            let (mut raw, mut block) = (Block::default(), Block::default());
            if self.source.read(&mut raw, self.chunk())? == 0 {
                is_all = true;
                break;
            }
            if channels > 1 {
                raws.push(raw.clone());
            }
            self.stages.treat(&mut raw, &mut block);
            len += block.len();
            blocks.push(block);
        }
        is_all |= self.info().samples == Some(len as u64);
        let mut shared_noise = false;
        if self.interference().is_some() {
            let mut plain = fresh;
            let treated = |raw: &mut Block| {
                let mut block = Block::default();
                plain.treat(raw, &mut block);
                block
            };
            let untouched: Vec<Block> = raws.iter_mut().map(treated).collect();
            let seen = |blocks: &[Block], most: usize| {
                let mut start = Block::joined(&blocks[..1]);
                start.truncate((JUDGED_S * self.rate_hz()) as usize);
                let found =
                    search(&start, self.rate_hz(), asked, most, None, &[]).unwrap_or_default();
                found.iter().filter(|a| a.cn0_dbhz > SOUND_DBHZ).count()
            };
            shared_noise = seen(&untouched, 1) > seen(&blocks, channels);
            if shared_noise {
                (blocks, self.stages) = (untouched, plain);
            }
        }
        let mut buffers = vec![SampleBuffer::default(); channels];
        for block in &blocks {
            for (c, buffer) in buffers.iter_mut().enumerate() {
                buffer.push(block.channel(c));
            }
        }
        Ok(Head { block: Block::joined(&blocks), buffers, is_all, shared_noise })
    }
}
