//! Treatment of each block of samples before acquisition and tracking.

use super::spatial::SpatialFilter;
use super::{ReceiverError, ReceiverOptions};
use crate::array::sky::interference::Interference;
use crate::capture::{Block, StreamInfo};
use crate::correlator::Depth;
use crate::front_end::{
    Conditioner, Excisor, ImpulseReport, ImpulseSuppressor, Interferer, Suppression,
};
use num_complex::Complex64;

/// Removal of jammers, by an array or by excision, suppression of impulses, conversion to baseband with decimation, calibration; in this order.
#[derive(Clone)]
pub(super) struct Stages {
    real: bool,
    spatial: Option<SpatialFilter>,
    /// Of one antenna.
    excisor: Option<Excisor>,
    suppressor: ImpulseSuppressor,
    conditioner: Conditioner,
    calibration: Option<Vec<Complex64>>,
    /// Whether interference would be seen: else samples may hold more than noise.
    sees: bool,
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
            excisor: (channels == 1 && options.suppression == Suppression::Auto)
                .then(|| Excisor::new(info)),
            suppressor: ImpulseSuppressor::new(options.suppression, info),
            conditioner: Conditioner::new(info, options.decimation),
            calibration: options.array.as_ref().and_then(|a| a.calibration.clone()),
            sees: options.suppression == Suppression::Auto,
        })
    }

    /// The same without the removal of jammers.
    pub(super) fn without_spatial(&self) -> Self {
        Self { spatial: None, ..self.clone() }
    }

    /// Treats the next block, which is the `last`, or not: `raw` is changed on the way to `block`. Where interference is
    /// excised some samples wait for those after them.
    pub(super) fn treat(&mut self, raw: &mut Block, block: &mut Block, last: bool) {
        // Real samples hold each wave twice, with opposite phases: jammers are removed from them when they
        // are complex.
        if let Some(spatial) = self.spatial.as_mut().filter(|_| !self.real) {
            spatial.process(raw);
        }
        if !self.excisor.as_mut().is_some_and(|excisor| excisor.process(raw, last)) {
            self.suppressor.process(raw);
        }
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

    /// How the last block treated is to be held: where it was found to be noise alone, bytes do.
    pub(super) fn depth(&self) -> Depth {
        let is_noise = self.suppressor.is_quiet()
            && self.excisor.as_ref().is_none_or(Excisor::is_quiet)
            && self.interference().is_none();
        if self.sees && is_noise { Depth::Bytes } else { Depth::Words }
    }

    /// Jammers that were removed, where there were any.
    pub(super) fn interference(&self) -> Option<&Interference> {
        self.spatial.as_ref()?.interference()
    }

    /// Impulsive noise found so far.
    pub(super) fn noise(&self) -> Option<ImpulseReport> {
        self.suppressor.report().or_else(|| self.excisor.as_ref()?.impulses())
    }

    /// Interference of one antenna found so far, strongest first.
    pub(super) fn interferers(&self) -> Vec<Interferer> {
        self.excisor.as_ref().map_or(Vec::new(), Excisor::interferers)
    }

    /// Whether samples wait for those after them.
    pub(super) fn holds(&self) -> bool {
        self.excisor.as_ref().is_some_and(Excisor::holds)
    }

    /// The stream behind the stages.
    pub(super) fn info(&self) -> &StreamInfo {
        self.conditioner.info()
    }

    pub(super) fn rate_hz(&self) -> f64 {
        self.info().rate_hz
    }
}
