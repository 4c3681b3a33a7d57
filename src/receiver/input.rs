//! The stream as the receiver sees it: conditioned, and its start held.

use super::spatial::SpatialFilter;
use super::{ReceiverError, ReceiverOptions};
use crate::array::interference::Interference;
use crate::capture::{Block, SampleSource, SourceError, StreamInfo};
use crate::correlator::SampleBuffer;
use crate::front_end::{Conditioner, ImpulseReport, ImpulseSuppressor};
use num_complex::Complex64;

/// Most samples that a head holds: of one channel, and of all together.
const HEAD_SAMPLES: f64 = 8e6;
const HEAD_SAMPLES_OF_ALL: f64 = 24e6;

/// Samples processed at a time, s.
pub(super) const CHUNK_S: f64 = 0.1;

/// The start of a stream: what acquisition sees.
pub(super) struct Head {
    pub(super) block: Block,
    /// The same samples as the correlators read them, by channel.
    pub(super) buffers: Vec<SampleBuffer>,
    /// Whether the stream ends with it.
    pub(super) is_all: bool,
}

impl Head {
    /// Keeps the first `samples` of each channel.
    pub(super) fn truncate(&mut self, samples: usize) {
        self.block.truncate(samples.max(1));
    }
}

/// The source behind its conditioning.
pub(super) struct Input<'a> {
    pub(super) source: &'a mut dyn SampleSource,
    spatial: SpatialFilter,
    suppressor: ImpulseSuppressor,
    conditioner: Conditioner,
    calibration: Option<Vec<Complex64>>,
    raw: Block,
}

impl<'a> Input<'a> {
    pub(super) fn new(
        source: &'a mut dyn SampleSource,
        options: &ReceiverOptions,
    ) -> Result<Self, ReceiverError> {
        let channels = source.info().channels;
        if let Some(array) = options.array.as_ref().filter(|a| a.len() != channels) {
            return Err(ReceiverError::Array { elements: array.len(), channels });
        }
        let suppressor = ImpulseSuppressor::new(options.suppression, source.info());
        let conditioner = Conditioner::new(source.info(), options.decimation);
        let calibration = options.array.as_ref().and_then(|a| a.calibration.clone());
        let spatial = SpatialFilter::default();
        Ok(Self { source, spatial, suppressor, conditioner, calibration, raw: Block::default() })
    }

    /// Jammers that were removed, where there were any.
    pub(super) fn interference(&self) -> Option<&Interference> {
        self.spatial.interference()
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
            self.spatial.process(block);
            self.suppressor.process(block);
        } else {
            self.source.read(&mut self.raw, want)?;
            // Real samples hold each wave twice, with opposite phases: jammers are removed from them when
            // they are complex.
            if !self.source.info().real {
                self.spatial.process(&mut self.raw);
            }
            self.suppressor.process(&mut self.raw);
            self.conditioner.process(&self.raw, block);
            if self.source.info().real {
                self.spatial.process(block);
            }
        }
        if let Some(weights) = &self.calibration {
            block.weight_channels(weights);
        }
        Ok(())
    }

    pub(super) fn head(&mut self, seconds: f64) -> Result<Head, SourceError> {
        let channels = self.info().channels;
        let most = HEAD_SAMPLES.min(HEAD_SAMPLES_OF_ALL / channels as f64);
        let want = (seconds * self.rate_hz()).min(most) as usize;
        let mut buffers = vec![SampleBuffer::default(); channels];
        let (mut blocks, mut len, mut is_all) = (Vec::new(), 0, false);
        while len < want {
            let mut block = Block::default();
            self.read(&mut block)?;
            if block.is_empty() {
                is_all = true;
                break;
            }
            for (c, buffer) in buffers.iter_mut().enumerate() {
                buffer.push(block.channel(c));
            }
            len += block.len();
            blocks.push(block);
        }
        is_all |= self.info().samples == Some(len as u64);
        Ok(Head { block: Block::joined(&blocks), buffers, is_all })
    }
}
