//! The scenario as a source of samples.

use super::kernel::{TABLE, mix_add, spread};
use super::noise::NoiseSource;
use super::sky::Emitter;
use super::{FrontEnd, Scenario, ScenarioError, StandardFrontEnd};
use crate::capture::{Block, SampleSource, SourceError, StreamInfo};
use crate::gnss::antenna::ArrayDescription;
use crate::gnss::constants::{
    CA_CHIP_RATE, CA_CODE_LENGTH, CA_CODE_PERIOD, L1_WAVELENGTH, SPEED_OF_LIGHT,
};
use crate::gnss::lnav::LnavError;
use crate::gnss::{GpsTime, Sv};
use num_complex::{Complex32, Complex64};

/// Segments of constant code and carrier rate in a frame, at whose ends lie the pseudorange knots.
const SEGMENTS: usize = 8;

/// A source that makes the samples of a [`Scenario`]: any blocks give the same samples.
///
/// The stream is made in frames of 8 segments; a segment is the power of two of samples that lasts at
/// most 1 ms. Each frame is a function of its index, and the front end runs over the frames in order,
/// beginning one frame before the first sample so that its filter has a past.
pub struct ScenarioSource {
    info: StreamInfo,
    scenario: Scenario,
    emitters: Vec<Emitter>,
    noise: Vec<NoiseSource>,
    front_end: Box<dyn FrontEnd>,
    segment: usize,
    next_frame: i64,
    antenna: Antenna,
    ready: Vec<Vec<Complex32>>,
    taken: usize,
    left: u64,
}

/// Scratch of one segment at one antenna element.
struct Antenna {
    chips: Vec<f32>,
    signed: Box<[f32; TABLE]>,
    re: Vec<f32>,
    im: Vec<f32>,
}

impl ScenarioSource {
    /// The source of a scenario with the standard front end.
    ///
    /// # Errors
    /// When orbits cannot be read, are of another time, or show no satellite.
    pub fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        Self::build(scenario, |power| {
            Box::new(StandardFrontEnd::new(&scenario.front_end, 1, power))
        })
    }

    /// The source of a scenario with another front end, which takes the place of the standard one
    /// (whose rate and IF settings still describe the stream).
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_front_end(
        scenario: &Scenario,
        front_end: Box<dyn FrontEnd>,
    ) -> Result<Self, ScenarioError> {
        Self::build(scenario, |_| front_end)
    }

    fn build(
        scenario: &Scenario,
        front_end: impl FnOnce(f64) -> Box<dyn FrontEnd>,
    ) -> Result<Self, ScenarioError> {
        let rate = scenario.front_end.rate_hz;
        let segment = 1usize << (rate * CA_CODE_PERIOD).log2().floor() as u32;
        let frame = SEGMENTS * segment;
        let emitters = scenario.emitters(frame as f64 / rate)?;
        let channels = 1;
        let noise_power =
            if scenario.noise.enabled { scenario.noise.background_variance } else { 0.0 };
        let amplitude = |e: &Emitter| {
            let cn0 = scenario.signal.cn0_dbhz(e.sv, e.range.view().elevation, 0.0);
            amplitude(scenario, cn0)
        };
        let signal_power: f64 = emitters.iter().map(|e| amplitude(e).powi(2)).sum();
        let front_end = front_end(noise_power + signal_power);
        let samples = (scenario.duration_s * rate).round() as u64;
        let skip = frame + front_end.delay();
        let law = scenario.noise.law();
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
            emitters,
            noise: (0..channels).map(|c| NoiseSource::new(law, scenario.seed, c)).collect(),
            front_end,
            segment,
            next_frame: -1,
            antenna: Antenna {
                chips: vec![0.0; segment],
                signed: Box::new([0.0; TABLE]),
                re: vec![0.0; segment],
                im: vec![0.0; segment],
            },
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
        self.emitters.iter().map(|e| e.sv)
    }

    /// The words of the subframe that a satellite starts to send `index` x 6 s after the GPS epoch, if it is
    /// simulated.
    ///
    /// # Errors
    /// When a value of its ephemeris does not fit.
    pub fn subframe(&self, sv: Sv, index: i64) -> Option<Result<[u32; 10], LnavError>> {
        self.emitters.iter().find(|e| e.sv == sv).map(|e| e.message.subframe(index))
    }

    pub(super) fn emitters(&self) -> &[Emitter] {
        &self.emitters
    }

    fn skip(&mut self, mut samples: usize) -> Result<(), (Sv, LnavError)> {
        while samples > 0 {
            let run = self.available()?.min(samples);
            self.taken += run;
            samples -= run;
        }
        Ok(())
    }

    /// Samples ready to be taken; makes the next frame when there are none.
    fn available(&mut self) -> Result<usize, (Sv, LnavError)> {
        if self.taken == self.ready[0].len() {
            for channel in 0..self.ready.len() {
                self.make_frame(channel)?;
                self.front_end.process(channel, &mut self.ready[channel]);
            }
            self.next_frame += 1;
            self.taken = 0;
        }
        Ok(self.ready[0].len() - self.taken)
    }

    /// Makes the antenna samples of the next frame for one channel.
    fn make_frame(&mut self, channel: usize) -> Result<(), (Sv, LnavError)> {
        let Self { emitters, antenna, noise, scenario, .. } = self;
        let frame = self.segment * SEGMENTS;
        let segment_s = self.segment as f64 / self.info.rate_hz;
        let start = self.next_frame as f64 * frame as f64 / self.info.rate_hz;
        emitters.iter_mut().for_each(|e| e.range.move_to(self.next_frame));
        let level = (scenario.noise.background_variance).sqrt() as f32;
        for (k, out) in self.ready[channel].chunks_exact_mut(self.segment).enumerate() {
            antenna.re.fill(0.0);
            antenna.im.fill(0.0);
            if scenario.noise.enabled {
                let first = (self.next_frame + 1) as u64 * frame as u64 + (k * self.segment) as u64;
                noise[channel].add(first, &mut antenna.re, &mut antenna.im);
                if level != 1.0 {
                    antenna.re.iter_mut().chain(&mut antenna.im).for_each(|x| *x *= level);
                }
            }
            let elapsed = start + k as f64 * segment_s;
            for emitter in emitters.iter_mut() {
                let elevation = emitter.range.view().elevation;
                let cn0 = scenario.signal.cn0_dbhz(emitter.sv, elevation, elapsed);
                // A satellite that has set is silent.
                let amplitude = if elevation < 0.0 { 0.0 } else { amplitude(scenario, cn0) };
                antenna
                    .add(emitter, scenario.start, elapsed, segment_s, k, amplitude)
                    .map_err(|e| (emitter.sv, e))?;
            }
            for ((out, &re), &im) in out.iter_mut().zip(&antenna.re).zip(&antenna.im) {
                *out = Complex32::new(re, im);
            }
        }
        Ok(())
    }
}

impl Antenna {
    /// Adds segment `k` of a satellite, which starts `elapsed` seconds after the first sample.
    fn add(
        &mut self,
        emitter: &mut Emitter,
        start: GpsTime,
        elapsed: f64,
        segment_s: f64,
        k: usize,
        amplitude: f64,
    ) -> Result<(), LnavError> {
        let len = self.chips.len() as f64;
        let range = |k: usize| emitter.range.at(k as f64 / SEGMENTS as f64);
        let (begin, end) = (range(k), range(k + 1));

        // Code: satellite time of transmission, in whole code periods since the GPS epoch and chips.
        let (seconds, fraction) = (start + (elapsed - begin.code_m / SPEED_OF_LIGHT)).parts();
        let periods = fraction / CA_CODE_PERIOD;
        let period = seconds * 1000 + periods.floor() as i64;
        let chip = periods.fract() * CA_CODE_LENGTH as f64;
        let flown = (end.code_m - begin.code_m) / SPEED_OF_LIGHT;
        let chip_step = (segment_s - flown) * CA_CHIP_RATE / len;
        let first = emitter.message.sign(period)?;
        let second = emitter.message.sign(period + 1)?;
        if first == second {
            spread(&emitter.chips, chip, chip_step, &mut self.chips);
        } else {
            // A bit edge: the second period, and what is beyond, with the other sign.
            self.signed.copy_from_slice(&emitter.chips[..]);
            self.signed[CA_CODE_LENGTH..].iter_mut().for_each(|c| *c = -*c);
            spread(&self.signed, chip, chip_step, &mut self.chips);
        }

        // Carrier: minus the range in cycles.
        let phase = emitter.phase - begin.carrier_m / L1_WAVELENGTH;
        let cycles = (begin.carrier_m - end.carrier_m) / L1_WAVELENGTH / len;
        let turn = std::f64::consts::TAU * phase.rem_euclid(1.0);
        let phasor = Complex64::from_polar(amplitude * f64::from(first), turn);
        mix_add(&self.chips, phasor, cycles, &mut self.re, &mut self.im);
        Ok(())
    }
}

/// Amplitude of a signal of `cn0` dB-Hz beside background noise of the scenario's variance, white over
/// the sampling rate: A^2 = C/N0 x variance / rate.
fn amplitude(scenario: &Scenario, cn0: f64) -> f64 {
    let density = scenario.noise.background_variance / scenario.front_end.rate_hz;
    (10f64.powf(cn0 / 10.0) * density).sqrt()
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
