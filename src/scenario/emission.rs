//! The signal of one satellite over a batch of segments: generated once, added to every channel.

use super::Scenario;
use super::kernel::mix_add;
use super::sent::MessageError;
use super::sky::{Component, Emitter};
use crate::gnss::antenna::{AntennaArray, direction};
use crate::gnss::constants::SPEED_OF_LIGHT;
use nalgebra::{Unit, Vector3};
use num_complex::Complex64;
use std::ops::Range;

/// Segments of constant code and carrier rate in a frame, at whose ends lie the pseudorange knots.
pub(super) const SEGMENTS: usize = 8;

/// The signal of one satellite over a batch of segments.
pub(super) struct Emission {
    chips: Vec<f32>,
    segments: Vec<Segment>,
    /// Of one component of several.
    of_one: Vec<f32>,
}

/// What is constant over a segment.
#[derive(Clone, Default)]
struct Segment {
    /// Amplitude, sign and phase at the first sample.
    phasor: Complex64,
    /// Carrier cycles per sample.
    cycles: f64,
    /// Response of each element.
    response: Vec<Complex64>,
}

impl Emission {
    /// Room for `batch` segments of `len` samples.
    pub fn new(batch: usize, len: usize) -> Self {
        Self {
            chips: vec![0.0; batch * len],
            segments: vec![Segment::default(); batch],
            of_one: vec![0.0; len],
        }
    }

    /// Makes the `segments` of the frame that starts `start` seconds after the first sample.
    pub fn prepare(
        &mut self,
        emitter: &mut Emitter,
        scenario: &Scenario,
        array: Option<&AntennaArray>,
        start: f64,
        segments: Range<usize>,
    ) -> Result<(), MessageError> {
        let len = self.chips.len() / self.segments.len();
        let segment_s = len as f64 / scenario.front_end.rate_hz;
        let elevation = emitter.range.view().elevation;
        let signal = emitter.transmission.signal;
        let (period_s, code) = (signal.period_s(), signal.chips);
        let periods_per_s = (1.0 / period_s).round() as i64;
        let wavelength_m = emitter.transmission.wavelength_m();
        let averaged = signal.is_commensurate(scenario.front_end.rate_hz);
        for ((k, chips), segment) in
            segments.zip(self.chips.chunks_exact_mut(len)).zip(&mut self.segments)
        {
            let elapsed = start + k as f64 * segment_s;
            let cn0 = scenario.signal.cn0_dbhz(emitter.transmission.sv, elevation, elapsed);
            // A satellite below the horizon sends nothing.
            let amplitude = if elevation < 0.0 { 0.0 } else { amplitude(scenario, cn0) };
            let range = |k: usize| emitter.range.at(k as f64 / SEGMENTS as f64);
            let (begin, end) = (range(k), range(k + 1));

            // Code: satellite time of transmission, in whole code periods since the GPS epoch and chips.
            let sent = scenario.start + (elapsed - begin.code_m / SPEED_OF_LIGHT);
            let (seconds, fraction) = sent.parts();
            let periods = fraction / period_s;
            let period = seconds * periods_per_s + periods.floor() as i64;
            let at = periods.fract();
            let flown = (end.code_m - begin.code_m) / SPEED_OF_LIGHT;
            let chip_step = (segment_s - flown) * signal.chip_rate_hz / len as f64;
            let mut first = 1.0;
            let phase_step = chip_step / code as f64;
            match &mut emitter.components[..] {
                [only] => first = only.spread(period, (at, phase_step), averaged, chips)?,
                all => {
                    chips.fill(0.0);
                    for component in all {
                        let sign = component.spread(
                            period,
                            (at, phase_step),
                            averaged,
                            &mut self.of_one,
                        )?;
                        let weight = sign * component.weight;
                        chips.iter_mut().zip(&self.of_one).for_each(|(sum, c)| *sum += weight * c);
                    }
                }
            }

            // Carrier: minus the range in cycles.
            let phase = emitter.phase - begin.carrier_m / wavelength_m;
            let turn = std::f64::consts::TAU * phase.rem_euclid(1.0);
            segment.phasor = Complex64::from_polar(amplitude * f64::from(first), turn);
            segment.cycles = (begin.carrier_m - end.carrier_m) / wavelength_m / len as f64;
            if let Some(array) = array {
                let middle = (k as f64 + 0.5) / SEGMENTS as f64;
                segment.response = array.response(&arrival(emitter, elapsed, middle));
            }
        }
        Ok(())
    }

    /// Adds segment `k` of the batch to (`re`, `im`) of a channel.
    pub fn add(&self, channel: usize, k: usize, re: &mut [f32], im: &mut [f32]) {
        let (segment, len) = (&self.segments[k], re.len());
        let response = segment.response.get(channel).copied().unwrap_or(Complex64::ONE);
        let chips = &self.chips[k * len..(k + 1) * len];
        mix_add(chips, segment.phasor * response, segment.cycles, re, im);
    }
}

impl Component {
    /// Writes the samples of a segment that starts at the fraction `at` of code period `period` and advances by `step`
    /// of one a sample, but for the sign of that period, which it gives.
    fn spread(
        &mut self,
        period: i64,
        (at, step): (f64, f64),
        averaged: bool,
        chips: &mut [f32],
    ) -> Result<f32, MessageError> {
        let (first, second) = (self.sent.sign(period)?, self.sent.sign(period + 1)?);
        let table = if first == second {
            &self.table
        } else {
            // A symbol edge: the second period, and what is beyond, with the other sign.
            self.signed.set_signed(&self.table, self.entries);
            &self.signed
        };
        let (start, step) = (at * self.entries as f64, step * self.entries as f64);
        match averaged {
            true => table.spread_averaged(start, step, chips),
            false => table.spread(start, step, chips),
        }
        Ok(first)
    }
}

/// Direction from which a signal arrives, (east, north, up), `elapsed` after the start, at the fraction `x` of the
/// frame: linear
/// between the frame's ends. A satellite turns by less than 2e-4 rad/s, 2e-7 rad in a segment.
fn arrival(emitter: &Emitter, elapsed: f64, x: f64) -> Unit<Vector3<f64>> {
    if let Some(towards) = emitter.spoofed_from(elapsed) {
        return towards;
    }
    let [begin, end] = [emitter.range.view(), emitter.range.next_view()]
        .map(|v| direction(v.azimuth, v.elevation).into_inner());
    Unit::new_normalize(begin + (end - begin) * x)
}

/// Amplitude of a signal of `cn0` dB-Hz in background noise of the scenario's variance, white over
/// the sampling rate: A^2 = C/N0 x variance / rate.
pub(super) fn amplitude(scenario: &Scenario, cn0: f64) -> f64 {
    let density = scenario.noise.background_variance / scenario.front_end.rate_hz;
    (10f64.powf(cn0 / 10.0) * density).sqrt()
}
