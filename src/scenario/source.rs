//! The scenario as a source of samples.

use super::element::Element;
use super::emission::{Emission, SEGMENTS, amplitude};
use super::jammer::{Interference, JammerSettings};
use super::sent::{MessageError, Sent};
use super::sky::Emitter;
use super::{FrontEnd, Scenario, ScenarioError, StandardFrontEnd};
use crate::capture::{Block, SampleSource, SourceError, StreamInfo};
use crate::gnss::antenna::{AntennaArray, ArrayDescription};
use crate::gnss::message::lnav::LnavError;
use crate::gnss::{Sv, signal};
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;

/// Samples of a [`Scenario`], independent of block lengths and of the number of threads.
///
/// The stream is made in frames of 8 segments; a segment is the power of two of samples that lasts at
/// most one period of the shortest code. Each frame is a function of its index, and the front end runs over the
/// frames in order,
/// beginning one frame before the first sample to fill its filter. The satellites' signals are
/// generated once, and added to the elements of an array in parallel.
pub struct ScenarioSource {
    info: StreamInfo,
    scenario: Scenario,
    array: Option<AntennaArray>,
    emitters: Vec<Emitter>,
    emissions: Vec<Emission>,
    jamming: Vec<Interference>,
    elements: Vec<Element>,
    front_end: Box<dyn FrontEnd>,
    /// Samples in a segment.
    segment: usize,
    /// Segments generated at a time.
    batch: usize,
    next_frame: i64,
    ready: Vec<Vec<Complex32>>,
    taken: usize,
    left: u64,
}

impl ScenarioSource {
    /// The source of a scenario with the standard front end.
    ///
    /// # Errors
    /// When orbits cannot be read, are of another time, or no satellite is in view.
    pub fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        Self::build(scenario, |channels, power| {
            Box::new(StandardFrontEnd::new(&scenario.front_end, channels, power))
        })
    }

    /// The source of a scenario with another front end, in place of the standard one
    /// (whose rate and IF settings still describe the stream).
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_front_end(
        scenario: &Scenario,
        front_end: Box<dyn FrontEnd>,
    ) -> Result<Self, ScenarioError> {
        Self::build(scenario, |_, _| front_end)
    }

    fn build(
        scenario: &Scenario,
        front_end: impl FnOnce(usize, f64) -> Box<dyn FrontEnd>,
    ) -> Result<Self, ScenarioError> {
        let rate = scenario.front_end.rate_hz;
        let segment = 1usize << (rate * shortest_period_s()).log2().floor() as u32;
        let frame = SEGMENTS * segment;
        let emitters = scenario.emitters(frame as f64 / rate, segment as f64 / rate)?;
        let array = scenario.array.as_ref().map(ArrayDescription::real_in_enu);
        let channels = array.as_ref().map_or(1, AntennaArray::len);
        let jammer = |(k, jammer): (usize, &JammerSettings)| {
            let towards = jammer.direction.towards(scenario.array.as_ref())?;
            let response = array.as_ref().map_or(vec![Complex64::ONE], |a| a.response(&towards));
            let levels = (scenario.noise.background_variance, rate);
            Ok(Interference::new(jammer, towards, &response, levels, (scenario.seed, k)))
        };
        let jamming: Result<Vec<_>, String> =
            scenario.jammers.iter().enumerate().map(jammer).collect();
        let jamming = jamming.map_err(ScenarioError::Direction)?;
        let signal_power = |e: &Emitter| {
            let cn0 = scenario.signal.cn0_dbhz(e.transmission.sv, e.range.view().elevation, 0.0);
            amplitude(scenario, cn0).powi(2)
        };
        let signals: f64 = emitters.iter().map(signal_power).sum();
        let ratio = |j: &Interference| 10f64.powf(j.jammer().power_db / 10.0);
        let jammers: f64 = jamming.iter().map(ratio).sum();
        let background = if scenario.noise.enabled { 1.0 } else { 0.0 };
        let power = (background + jammers) * scenario.noise.background_variance + signals;
        let front_end = front_end(channels, power);
        // The chips of a single antenna stay in the nearest cache; many elements share a whole frame.
        let batch = if channels == 1 { 1 } else { SEGMENTS };
        let samples = (scenario.duration_s * rate).round() as u64;
        let skip = frame + front_end.delay();
        let mut source = Self {
            info: StreamInfo {
                rate_hz: rate,
                if_hz: scenario.front_end.if_hz,
                channels,
                real: scenario.front_end.real,
                samples: Some(samples),
                start_time: Some(scenario.start),
                format: scenario.front_end.format().to_owned(),
                array: scenario.array.as_ref().map(ArrayDescription::without_errors),
            },
            scenario: scenario.clone(),
            array,
            emissions: emitters.iter().map(|_| Emission::new(batch, segment)).collect(),
            emitters,
            jamming,
            elements: (0..channels).map(|c| Element::new(scenario, c, segment)).collect(),
            front_end,
            segment,
            batch,
            next_frame: -1,
            ready: vec![vec![Complex32::ZERO; frame]; channels],
            taken: frame,
            left: samples,
        };
        source.skip(skip).map_err(|(sv, source)| ScenarioError::Message { sv, source })?;
        Ok(source)
    }

    /// The scenario.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The satellites simulated.
    pub fn satellites(&self) -> impl Iterator<Item = Sv> {
        self.emitters.iter().map(|e| e.transmission.sv)
    }

    /// The words of the subframe that a satellite starts to send `index` x 6 s after the GPS epoch, if it is
    /// simulated and sends LNAV.
    ///
    /// # Errors
    /// When a value of its ephemeris does not fit.
    pub fn subframe(&self, sv: Sv, index: i64) -> Option<Result<[u32; 10], LnavError>> {
        let of_satellite = self.emitters.iter().filter(|e| e.transmission.sv == sv);
        let sent = of_satellite.flat_map(|e| &e.components).map(|component| &component.sent);
        let lnav = |sent: &Sent| match sent {
            Sent::Lnav(message) => Some(message.subframe(index)),
            _ => None,
        };
        sent.filter_map(lnav).next()
    }

    pub(super) fn emitters(&self) -> &[Emitter] {
        &self.emitters
    }

    pub(super) fn jamming(&self) -> &[Interference] {
        &self.jamming
    }

    fn skip(&mut self, mut samples: usize) -> Result<(), (Sv, MessageError)> {
        while samples > 0 {
            let run = self.available()?.min(samples);
            self.taken += run;
            samples -= run;
        }
        Ok(())
    }

    /// Samples not yet read; generates the next frame when there are none.
    fn available(&mut self) -> Result<usize, (Sv, MessageError)> {
        if self.taken == self.ready[0].len() {
            self.make_frame()?;
            self.front_end.process_all(&mut self.ready);
            self.next_frame += 1;
            self.taken = 0;
        }
        Ok(self.ready[0].len() - self.taken)
    }

    /// Makes the antenna samples of the next frame.
    fn make_frame(&mut self) -> Result<(), (Sv, MessageError)> {
        let Self { emitters, emissions, jamming, elements, ready, scenario, array, .. } = self;
        let frame = SEGMENTS * self.segment;
        let start = self.next_frame as f64 * frame as f64 / self.info.rate_hz;
        emitters.iter_mut().for_each(|e| e.range.move_to(self.next_frame));
        for first in (0..SEGMENTS).step_by(self.batch) {
            let segments = first..first + self.batch;
            let samples = first * self.segment..(first + self.batch) * self.segment;
            let drawn = (self.next_frame + 1) as u64 * frame as u64 + samples.start as u64;
            let index = self.next_frame * frame as i64 + samples.start as i64;
            let prepare = |(emitter, emission): (&mut Emitter, &mut Emission)| {
                emission
                    .prepare(emitter, scenario, array.as_ref(), start, segments.clone())
                    .map_err(|e| (emitter.transmission.sv, e))
            };
            jamming.iter_mut().for_each(|j| j.prepare(index, drawn, samples.len()));
            if let ([element], [ready]) = (&mut elements[..], &mut ready[..]) {
                emitters.iter_mut().zip(&mut *emissions).try_for_each(prepare)?;
                element.make(drawn, emissions, jamming, &mut ready[samples]);
                continue;
            }
            emitters.par_iter_mut().zip(emissions.par_iter_mut()).try_for_each(prepare)?;
            elements.par_iter_mut().zip(ready.par_iter_mut()).for_each(|(element, ready)| {
                element.make(drawn, emissions, jamming, &mut ready[samples.clone()]);
            });
        }
        Ok(())
    }
}

/// Period of the shortest code of all signals, s.
fn shortest_period_s() -> f64 {
    signal::ALL.iter().map(|signal| signal.period_s()).fold(f64::INFINITY, f64::min)
}

impl SampleSource for ScenarioSource {
    fn info(&self) -> &StreamInfo {
        &self.info
    }

    fn read(&mut self, block: &mut Block, samples: usize) -> Result<usize, SourceError> {
        let len = self.left.min(samples as u64) as usize;
        let first = self.info.samples.unwrap_or(0) - self.left;
        block.reset(self.ready.len(), len, first);
        let mut done = 0;
        while done < len {
            let run = self
                .available()
                .map_err(|(sv, source)| ScenarioError::Message { sv, source })?
                .min(len - done);
            for (out, ready) in block.channels_mut().zip(&self.ready) {
                out[done..done + run].copy_from_slice(&ready[self.taken..self.taken + run]);
            }
            self.taken += run;
            done += run;
        }
        self.left -= len as u64;
        Ok(len)
    }
}
