//! The front-end model: from the antenna's complex envelope to the numbers of the ADC.

use super::fir::{LowPass, low_pass_taps};
use super::quantiser::Quantiser;
use super::values;
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Samples that are conditioned together: the AGC's gain is constant over them.
const CHUNK: usize = 256;

/// A replaceable front end: from antenna samples to ADC samples.
pub trait FrontEnd: Send {
    /// Delay of the output against the input, samples; the source removes it.
    fn delay(&self) -> usize {
        0
    }

    /// Turns the next antenna samples of a channel, in place, into what its ADC gives. The calls of one
    /// channel follow each other without gap; lengths are multiples of 256 and the same for all.
    fn process(&mut self, channel: usize, samples: &mut [Complex32]);

    /// Does that for all channels; a front end with independent channels may do it in
    /// parallel.
    fn process_all(&mut self, channels: &mut [Vec<Complex32>]) {
        channels.iter_mut().enumerate().for_each(|(c, samples)| self.process(c, samples));
    }
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
    /// Quadrature error of Q against I, degrees.
    #[serde(default, deserialize_with = "values::finite")]
    pub iq_phase_deg: f64,
    /// Time constant of the AGC, s, that holds the total power; absent: a fixed gain for the power
    /// of background noise and signals.
    #[serde(default, deserialize_with = "values::some_positive")]
    pub agc_time_constant_s: Option<f64>,
    /// Offset of I and Q over the rms of one of them.
    #[serde(default)]
    pub dc_offset: [f64; 2],
    /// Quantiser bits of I or Q: 1, 2, 3, 4, 8 or 16; absent: none, single-precision samples.
    #[serde(default, deserialize_with = "values::bits")]
    pub bits: Option<u32>,
    /// The rms of I or Q at the quantiser, in its steps; absent: the best for Gaussian input.
    #[serde(default, deserialize_with = "values::some_positive")]
    pub rms_steps: Option<f64>,
}

impl FrontEndSettings {
    /// Which values are inconsistent, if any.
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
        if !self.dc_offset.iter().all(|v| v.abs() <= 100.0) {
            return Some("dc_offset must be two multiples of the rms, each -100 to 100".into());
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

    /// Sample type that holds the output without loss: `cs8`, `cs16`, `cf32`, or `rs8`, `rs16`, `rf32`.
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
    stages: Stages,
    channels: Vec<ChannelState>,
}

/// Common to all channels.
struct Stages {
    nco: Option<Nco>,
    real: bool,
    imbalance: Option<[f32; 2]>,
    agc_gain: f64,
    dc_offset: [f32; 2],
    quantiser: Option<Quantiser>,
}

/// State of a channel between blocks.
#[derive(Clone)]
struct ChannelState {
    filter: Option<LowPass>,
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
        let agc_gain = settings
            .agc_time_constant_s
            .map_or(0.0, |tau| 1.0 - (-(CHUNK as f64) / (settings.rate_hz * tau)).exp());
        let filter = taps.map(LowPass::new);
        let channel = ChannelState { filter, sample: 0, power: power * noise_gain };
        let stages = Stages {
            nco,
            real: settings.real,
            imbalance: (imbalance != [0.0, 1.0]).then_some(imbalance),
            agc_gain,
            dc_offset: settings.dc_offset.map(|v| v as f32),
            quantiser: settings.bits.map(|bits| Quantiser::new(bits, settings.rms_steps)),
        };
        Self { stages, channels: vec![channel; channels] }
    }
}

impl FrontEnd for StandardFrontEnd {
    fn delay(&self) -> usize {
        self.channels.first().and_then(|c| c.filter.as_ref()).map_or(0, LowPass::delay)
    }

    fn process(&mut self, channel: usize, samples: &mut [Complex32]) {
        self.stages.process(&mut self.channels[channel], samples);
    }

    fn process_all(&mut self, channels: &mut [Vec<Complex32>]) {
        if let ([state], [samples]) = (&mut self.channels[..], &mut *channels) {
            return self.stages.process(state, samples);
        }
        let pairs = self.channels.par_iter_mut().zip(channels.par_iter_mut());
        pairs.for_each(|(state, samples)| self.stages.process(state, samples));
    }
}

impl Stages {
    fn process(&self, state: &mut ChannelState, samples: &mut [Complex32]) {
        if let Some(filter) = &mut state.filter {
            filter.process(samples);
        }
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
            if self.quantiser.is_some() || self.agc_gain > 0.0 {
                if self.agc_gain > 0.0 {
                    let sum: f64 = chunk.iter().map(|x| f64::from(x.norm_sqr())).sum();
                    state.power += self.agc_gain * (sum / chunk.len() as f64 - state.power);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(rest: &str) -> FrontEndSettings {
        toml::from_str(&format!("rate_hz = 1e6\n{rest}")).expect("valid settings")
    }

    /// Amplitude of a tone of `cycles` per sample in the front end's output for an input of ones.
    fn tone(settings: &FrontEndSettings, cycles: f64) -> Complex64 {
        let mut samples = vec![Complex32::ONE; 4096];
        StandardFrontEnd::new(settings, 1, 1.0).process(0, &mut samples);
        let turned = |(k, x): (usize, &Complex32)| {
            let turn = Complex64::cis(-std::f64::consts::TAU * cycles * k as f64);
            Complex64::new(x.re.into(), x.im.into()) * turn
        };
        samples.iter().enumerate().map(turned).sum::<Complex64>() / 4096.0
    }

    #[test]
    fn carrier_image_and_offset_lie_where_the_settings_put_them() {
        // 1/8 of the rate: whole turns in 4096 samples, so tones are orthogonal.
        let shifted = settings("if_hz = 1e5\nlo_offset_hz = 2.5e4");
        assert!((tone(&shifted, 0.125) - 1.0).norm() < 1e-5);
        assert!(tone(&shifted, -0.125).norm() < 1e-5);
        let offset = settings("if_hz = 1.25e5\ndc_offset = [0.25, -0.5]");
        assert!((tone(&offset, 0.0) - Complex64::new(0.25, -0.5)).norm() < 1e-5);
        // Image of Q' = g (Q cos p + I sin p): |1 - g e^jp| / 2, the carrier |1 + g e^-jp| / 2.
        let skewed = settings("if_hz = 1.25e5\niq_gain_db = 1.0\niq_phase_deg = 3.0");
        let g = Complex64::from_polar(10f64.powf(0.05), 3f64.to_radians());
        assert!((tone(&skewed, -0.125).norm() - (1.0 - g).norm() / 2.0).abs() < 1e-5);
        assert!((tone(&skewed, 0.125).norm() - (1.0 + g).norm() / 2.0).abs() < 1e-5);
        // Real samples: the power is kept, half of it at minus the IF.
        let real = settings("if_hz = 1.25e5\nbandwidth_hz = 2e5\nreal = true");
        assert_eq!(real.conflict(), None);
        let (plus, minus) = (tone(&real, 0.125).norm_sqr(), tone(&real, -0.125).norm_sqr());
        // The filter's past is zero: the first 64 of 4096 samples rise from it.
        assert!((plus - 0.5).abs() < 0.02 && (minus - 0.5).abs() < 0.02, "{plus} {minus}");
    }

    #[test]
    fn the_agc_returns_to_the_quantisers_best_level_after_a_jump() {
        let settings = settings("agc_time_constant_s = 1e-3\nbits = 8\nrms_steps = 20.0");
        let mut front_end = StandardFrontEnd::new(&settings, 1, 1.0);
        let mut rms = |level: f32, len: usize| {
            let mut samples = vec![Complex32::new(level, -level); len];
            front_end.process(0, &mut samples);
            samples.last().map(|x| (x.norm_sqr() / 2.0).sqrt())
        };
        let unit = std::f32::consts::FRAC_1_SQRT_2;
        assert_eq!(rms(unit, 256), Some(20.0));
        // Ten times the level clips at once (less than a time constant), and is settled after ten.
        assert!(rms(10.0 * unit, 256) > Some(25.0));
        assert_eq!(rms(10.0 * unit, 10_240), Some(20.0));
    }
}
