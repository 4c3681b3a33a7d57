//! The front-end model: what lies between the antenna's complex envelope and the numbers of the ADC.

use super::fir::{LowPass, low_pass_taps};
use super::quantiser::Quantiser;
use super::values;
use num_complex::{Complex32, Complex64};
use serde::{Deserialize, Serialize};

/// Samples that are conditioned together: the AGC's gain is constant over them.
const CHUNK: usize = 256;

/// A front end that an experimenter can swap: from antenna samples to ADC samples.
pub trait FrontEnd: Send {
    /// Samples by which the output lags the input; the source takes them out again.
    fn delay(&self) -> usize;

    /// Turns the next antenna samples of a channel, in place, into what its ADC gives. The calls of one
    /// channel follow each other without gap; lengths are multiples of 256 and the same for all.
    fn process(&mut self, channel: usize, samples: &mut [Complex32]);
}

/// Settings of the [`StandardFrontEnd`], in the order in which they act.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrontEndSettings {
    /// Complex samples per second (real ones, when `real`), Hz.
    #[serde(deserialize_with = "values::rate")]
    pub rate_hz: f64,
    /// Two-sided bandwidth between the -6 dB points, Hz; absent: that of the samples.
    #[serde(default, deserialize_with = "values::some_positive")]
    pub bandwidth_hz: Option<f64>,
    /// Intermediate frequency: where the L1 carrier comes to lie, Hz.
    #[serde(default, deserialize_with = "values::finite")]
    pub if_hz: f64,
    /// Error of a local oscillator that is not tied to the sampling clock, Hz: added to the IF.
    /// (The error of a common oscillator is the receiver's `clock_drift_ppm`.)
    #[serde(default, deserialize_with = "values::finite")]
    pub lo_offset_hz: f64,
    /// Whether the ADC gives real samples (the carrier must then lie at an IF within the band).
    #[serde(default)]
    pub real: bool,
    /// Gain of Q over I, dB.
    #[serde(default, deserialize_with = "values::finite")]
    pub iq_gain_db: f64,
    /// Deviation of Q from quadrature to I, degrees.
    #[serde(default, deserialize_with = "values::finite")]
    pub iq_phase_deg: f64,
    /// Time constant of the AGC, s, that holds the total power; absent: a fixed gain for the power
    /// of background noise and signals.
    #[serde(default, deserialize_with = "values::some_positive")]
    pub agc_time_constant_s: Option<f64>,
    /// Offset of I and Q as a share of a rail's rms.
    #[serde(default)]
    pub dc_offset: [f64; 2],
    /// Quantiser bits of a rail: 1, 2, 3, 4, 8 or 16; absent: none, single-precision samples.
    #[serde(default, deserialize_with = "values::bits")]
    pub bits: Option<u32>,
    /// The rms of one rail at the quantiser, in its steps; absent: the best for Gaussian input.
    #[serde(default, deserialize_with = "values::some_positive")]
    pub rms_steps: Option<f64>,
}

impl FrontEndSettings {
    /// What does not fit together, if anything.
    pub fn conflict(&self) -> Option<String> {
        let rate = self.rate_hz;
        let carrier = self.if_hz + self.lo_offset_hz;
        let bandwidth = self.bandwidth_hz.unwrap_or(rate);
        if bandwidth > rate {
            return Some(format!("bandwidth_hz {bandwidth} exceeds rate_hz {rate}"));
        }
        if carrier.abs() >= rate / 2.0 {
            return Some(format!("if_hz {carrier} lies outside the samples' +-{} Hz", rate / 2.0));
        }
        let fits = carrier.abs() > bandwidth / 2.0 && carrier.abs() + bandwidth / 2.0 < rate / 2.0;
        (self.real && !fits).then(|| {
            format!(
                "real samples hold a band from 0 to {} Hz, and {bandwidth} Hz around if_hz {carrier} do \
                 not fit into it: set bandwidth_hz and if_hz",
                rate / 2.0
            )
        })
    }

    /// Sample type that holds the output without loss: `cs8`, `cs16`, `cf32`, or their real kin.
    pub fn format(&self) -> &'static str {
        match (self.bits, self.real) {
            (None, false) => "cf32",
            (None, true) => "rf32",
            (Some(16), false) => "cs16",
            (Some(16), true) => "rs16",
            (_, false) => "cs8",
            (_, true) => "rs8",
        }
    }
}

/// The standard front end: low-pass, mixer, (real part,) IQ imbalance, gain, offset, quantiser.
pub struct StandardFrontEnd {
    filters: Vec<Option<LowPass>>,
    nco: Option<Nco>,
    real: bool,
    imbalance: Option<[f32; 2]>,
    agc_share: f64,
    channels: Vec<ChannelState>,
    dc_offset: [f32; 2],
    quantiser: Option<Quantiser>,
}

/// What a channel remembers from block to block.
#[derive(Clone, Copy)]
struct ChannelState {
    sample: u64,
    power: f64,
}

/// A numerically controlled oscillator: a 64-bit phase accumulator, and the turns within a chunk.
struct Nco {
    step: u64,
    turns: Vec<Complex32>,
}

impl StandardFrontEnd {
    /// A front end of `channels` channels for antenna samples of total `power` (variance of the
    /// complex sample: background noise and signals, white over the sampling rate).
    pub fn new(settings: &FrontEndSettings, channels: usize, power: f64) -> Self {
        let taps = settings.bandwidth_hz.map(|b| low_pass_taps(b / settings.rate_hz));
        let noise_gain = taps.as_ref().map_or(1.0, |t| t.iter().map(|h| f64::from(h * h)).sum());
        let cycles = (settings.if_hz + settings.lo_offset_hz) / settings.rate_hz;
        let turn = |k| Complex64::cis(std::f64::consts::TAU * cycles * k as f64);
        let nco = (cycles != 0.0).then(|| Nco {
            step: (cycles.rem_euclid(1.0) * 2f64.powi(64)) as u64,
            turns: (0..CHUNK)
                .map(|k| Complex32::new(turn(k).re as f32, turn(k).im as f32))
                .collect(),
        });
        let (sin, cos) = settings.iq_phase_deg.to_radians().sin_cos();
        let gain = 10f64.powf(settings.iq_gain_db / 20.0);
        let imbalance = [(gain * sin) as f32, (gain * cos) as f32];
        let agc_share = settings
            .agc_time_constant_s
            .map_or(0.0, |tau| 1.0 - (-(CHUNK as f64) / (settings.rate_hz * tau)).exp());
        Self {
            filters: vec![taps.map(LowPass::new); channels],
            nco,
            real: settings.real,
            imbalance: (imbalance != [0.0, 1.0]).then_some(imbalance),
            agc_share,
            channels: vec![ChannelState { sample: 0, power: power * noise_gain }; channels],
            dc_offset: settings.dc_offset.map(|v| v as f32),
            quantiser: settings.bits.map(|bits| Quantiser::new(bits, settings.rms_steps)),
        }
    }
}

impl FrontEnd for StandardFrontEnd {
    fn delay(&self) -> usize {
        self.filters[0].as_ref().map_or(0, LowPass::delay)
    }

    fn process(&mut self, channel: usize, samples: &mut [Complex32]) {
        if let Some(filter) = &mut self.filters[channel] {
            filter.process(samples);
        }
        let state = &mut self.channels[channel];
        for chunk in samples.chunks_mut(CHUNK) {
            if let Some(nco) = &self.nco {
                nco.turn(state.sample, chunk);
            }
            if self.real {
                // Half of the power lies in the real part.
                chunk.iter_mut().for_each(|x| *x = Complex32::new(x.re * 2f32.sqrt(), 0.0));
            }
            if let Some([cross, direct]) = self.imbalance {
                chunk.iter_mut().for_each(|x| x.im = cross * x.re + direct * x.im);
            }
            state.sample += chunk.len() as u64;
            if self.quantiser.is_some() || self.agc_share > 0.0 {
                if self.agc_share > 0.0 {
                    let sum: f64 = chunk.iter().map(|x| f64::from(x.norm_sqr())).sum();
                    state.power += self.agc_share * (sum / chunk.len() as f64 - state.power);
                }
                let rails = if self.real { 1.0 } else { 2.0 };
                let gain = (rails / state.power).sqrt() as f32;
                chunk.iter_mut().for_each(|x| *x *= gain);
            }
            if self.dc_offset != [0.0; 2] {
                let offset = Complex32::new(self.dc_offset[0], self.dc_offset[1]);
                chunk.iter_mut().for_each(|x| *x += offset);
            }
            if let Some(quantiser) = &self.quantiser {
                quantiser.apply(bytemuck::cast_slice_mut(chunk));
                if self.real {
                    chunk.iter_mut().for_each(|x| x.im = 0.0);
                }
            }
        }
    }
}

impl Nco {
    /// Turns samples `first`, `first` + 1, ... (at most a chunk) by the oscillator's phase.
    fn turn(&self, first: u64, samples: &mut [Complex32]) {
        let phase = self.step.wrapping_mul(first) as f64 / 2f64.powi(64);
        let anchor = Complex64::cis(std::f64::consts::TAU * phase);
        let anchor = Complex32::new(anchor.re as f32, anchor.im as f32);
        samples.iter_mut().zip(&self.turns).for_each(|(x, turn)| *x *= anchor * turn);
    }
}
