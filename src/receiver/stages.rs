//! Treatment of each block of samples before acquisition and tracking.

use super::spatial::SpatialFilter;
use super::{ReceiverError, ReceiverOptions};
use crate::array::sky::interference::Interference;
use crate::capture::{Block, StreamInfo};
use crate::front_end::{Conditioner, ImpulseReport, ImpulseSuppressor};
use num_complex::Complex64;

/// Removal of jammers, suppression of impulses, conversion to baseband with decimation, calibration; in this order.
#[derive(Clone)]
pub(super) struct Stages {
    real: bool,
    spatial: Option<SpatialFilter>,
    suppressor: ImpulseSuppressor,
    conditioner: Conditioner,
    calibration: Option<Vec<Complex64>>,
}

impl Stages {
    pub(super) fn new(info: &StreamInfo, options: &ReceiverOptions) -> Result<Self, ReceiverError> {
        let channels = info.channels;
        if let Some(array) = options.array.as_ref().filter(|a| a.len() != channels) {
            return Err(ReceiverError::Array { elements: array.len(), channels });
        }
        Ok(Self {
            real: info.real,
            spatial: (channels > 1).then(SpatialFilter::default),
            suppressor: ImpulseSuppressor::new(options.suppression, info),
            conditioner: Conditioner::new(info, options.decimation),
            calibration: options.array.as_ref().and_then(|a| a.calibration.clone()),
        })
    }

    /// The same without the removal of jammers.
    pub(super) fn without_spatial(&self) -> Self {
        Self { spatial: None, ..self.clone() }
    }

    /// Treats the next block: `raw` is changed on the way to `block`.
    pub(super) fn treat(&mut self, raw: &mut Block, block: &mut Block) {
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

    /// Jammers that were removed, where there were any.
    pub(super) fn interference(&self) -> Option<&Interference> {
        self.spatial.as_ref()?.interference()
    }

    /// Impulsive noise found so far.
    pub(super) fn noise(&self) -> Option<ImpulseReport> {
        self.suppressor.report()
    }

    /// The stream behind the stages.
    pub(super) fn info(&self) -> &StreamInfo {
        self.conditioner.info()
    }

    pub(super) fn rate_hz(&self) -> f64 {
        self.info().rate_hz
    }
}
