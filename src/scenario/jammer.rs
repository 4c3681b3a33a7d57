//! Jammers: a tone, a chirp or noise from one direction.

use super::direction::Direction;
use super::kernel::{add_weighted, mix_add};
use super::noise::{GaussianMixture, NoiseSource};
use super::values;
use nalgebra::{Unit, Vector3};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::ops::Range;

/// Noise streams of jammers come after those of the elements.
const FIRST_STREAM: usize = 1 << 20;

/// Knots of narrow noise before the first sample.
const BEFORE: f64 = 1e6;

/// What a jammer sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JammerKind {
    /// A tone.
    Cw,
    /// A frequency that rises over `sweep_hz` in `period_s` and jumps back; the phase does not jump.
    Chirp,
    /// Noise: white over the sampling rate, or of `width_hz` about `frequency_hz`.
    Noise,
}

/// A jammer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JammerSettings {
    /// Waveform.
    pub kind: JammerKind,
    /// Its power over that of the background noise at an ideal element, dB.
    #[serde(deserialize_with = "values::power")]
    pub power_db: f64,
    /// Direction of arrival.
    pub direction: Direction,
    /// Frequency, of a chirp its centre, as an offset from L1 in the receiver's samples, Hz.
    #[serde(default, deserialize_with = "values::finite")]
    pub frequency_hz: f64,
    /// Range of a chirp, Hz.
    #[serde(default, deserialize_with = "values::finite")]
    pub sweep_hz: f64,
    /// Time of one rise of a chirp, s.
    #[serde(default = "millisecond", deserialize_with = "values::positive")]
    pub period_s: f64,
    /// Noise bandwidth of noise, Hz; absent: white.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "values::some_positive"
    )]
    pub width_hz: Option<f64>,
    /// Fraction of each period in which it sends, above 0: pulses where below 1. Its power is that of a pulse.
    #[serde(default = "always", deserialize_with = "values::fraction")]
    pub duty: f64,
    /// When it begins, s after the first sample.
    #[serde(default, deserialize_with = "values::finite")]
    pub start_s: f64,
    /// When it ends, s; absent: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop_s: Option<f64>,
}

fn always() -> f64 {
    1.0
}

fn millisecond() -> f64 {
    1e-3
}

impl JammerSettings {
    /// Phase at `t` seconds, cycles: the integral of the frequency f + sweep (x - 1/2) with
    /// x = t / period modulo 1, which is f t + sweep period (x^2 - x) / 2.
    fn phase(&self, t: f64) -> f64 {
        let x = (t / self.period_s).rem_euclid(1.0);
        (self.frequency_hz * t).fract() + self.sweep_hz * self.period_s * (x * x - x) / 2.0
    }

    /// Which values are inconsistent, if any.
    pub(super) fn conflict(&self, rate_hz: f64) -> Option<String> {
        let reach = self.frequency_hz.abs() + self.sweep_hz.abs() / 2.0;
        if self.kind != JammerKind::Noise && reach >= rate_hz / 2.0 {
            let half = rate_hz / 2.0;
            return Some(format!(
                "frequencies up to {reach} Hz lie outside the samples' +-{half} Hz"
            ));
        }
        let stop = self.stop_s?;
        (stop.is_nan() || stop <= self.start_s)
            .then(|| format!("stop_s {stop} must come after start_s {}", self.start_s))
    }
}

/// The contribution of a jammer to the elements over a batch of samples.
pub(super) struct Interference {
    jammer: JammerSettings,
    /// Direction (east, north, up).
    pub towards: Unit<Vector3<f64>>,
    rate_hz: f64,
    noise: NoiseSource,
    weights: Vec<Complex64>,
    re: Vec<f32>,
    im: Vec<f32>,
    ones: Vec<f32>,
    is_silent: bool,
}

impl Interference {
    /// The jammer at elements whose response to its direction `towards` is `response`, over background noise of the
    /// `variance`; its noise is the stream `k` of the jammers.
    pub fn new(
        jammer: &JammerSettings,
        towards: Unit<Vector3<f64>>,
        response: &[Complex64],
        (variance, rate_hz): (f64, f64),
        (seed, k): (u64, usize),
    ) -> Self {
        let white = GaussianMixture { probability: 0.0, ratio: 1.0 };
        let amplitude = (variance * 10f64.powf(jammer.power_db / 10.0)).sqrt();
        Self {
            jammer: jammer.clone(),
            towards,
            rate_hz,
            noise: NoiseSource::new(white, seed, FIRST_STREAM + k),
            weights: response.iter().map(|a| a * amplitude).collect(),
            re: Vec::new(),
            im: Vec::new(),
            ones: Vec::new(),
            is_silent: true,
        }
    }

    /// The jammer.
    pub fn jammer(&self) -> &JammerSettings {
        &self.jammer
    }

    /// Makes the next `len` samples, of unit power; the first is sample `first` of the stream and
    /// `drawn` of the noise.
    pub fn prepare(&mut self, first: i64, drawn: u64, len: usize) {
        let at =
            |seconds: f64| ((seconds * self.rate_hz).ceil() as i64 - first).clamp(0, len as i64);
        let stop = self.jammer.stop_s.map_or(len as i64, at);
        let active = at(self.jammer.start_s) as usize..stop as usize;
        self.is_silent = active.is_empty();
        if self.is_silent {
            return;
        }
        for rail in [&mut self.re, &mut self.im] {
            rail.clear();
            rail.resize(len, 0.0);
        }
        let rate_hz = self.rate_hz;
        let time = |k: usize| (first + k as i64) as f64 / rate_hz;
        match self.jammer.kind {
            JammerKind::Cw => {
                self.ones.resize(len, 1.0);
                let phasor = Complex64::cis(TAU * self.jammer.phase(time(0)));
                let cycles = self.jammer.frequency_hz / self.rate_hz;
                mix_add(&self.ones, phasor, cycles, &mut self.re, &mut self.im);
            }
            JammerKind::Chirp => {
                for (k, (re, im)) in self.re.iter_mut().zip(&mut self.im).enumerate() {
                    let turn = Complex64::cis(TAU * self.jammer.phase(time(k)));
                    (*re, *im) = (turn.re as f32, turn.im as f32);
                }
            }
            JammerKind::Noise => match self.jammer.width_hz {
                None => self.noise.add(drawn, &mut self.re, &mut self.im),
                Some(width_hz) => self.narrow_noise(width_hz, first),
            },
        }
        if self.jammer.duty < 1.0 {
            for (k, (re, im)) in self.re.iter_mut().zip(&mut self.im).enumerate() {
                if (time(k) / self.jammer.period_s).rem_euclid(1.0) >= self.jammer.duty {
                    (*re, *im) = (0.0, 0.0);
                }
            }
        }
        for rail in [&mut self.re, &mut self.im] {
            rail[..active.start].fill(0.0);
            rail[active.end..].fill(0.0);
        }
    }

    /// Noise of a Gaussian spectrum: a Gaussian of standard deviation `s` at each of the knots, 0.8 `s` apart, at which
    /// the variance ripples by less than a per cent. Its noise bandwidth is 1 / (2 sqrt(pi) s).
    fn narrow_noise(&mut self, width_hz: f64, first: i64) {
        /// Knots within four standard deviations.
        const REACH: usize = 5;
        let len = self.re.len();
        let sigma_s = 0.5 / std::f64::consts::PI.sqrt() / width_hz;
        let knot_s = 0.8 * sigma_s;
        let norm = (std::f64::consts::PI.sqrt() * sigma_s / knot_s).sqrt();
        let at = |k: usize| (first + k as i64) as f64 / self.rate_hz / knot_s + BEFORE;
        let start = at(0).floor() as u64 - REACH as u64;
        let knots = (at(len).floor() as u64 - start) as usize + REACH + 2;
        let (mut re, mut im) = (vec![0.0; knots], vec![0.0; knots]);
        self.noise.add(start, &mut re, &mut im);
        let frequency_hz = self.jammer.frequency_hz;
        for k in 0..len {
            let place = at(k) - start as f64;
            let nearest = place.floor() as usize;
            let mut z = Complex64::ZERO;
            for knot in nearest - REACH..=nearest + REACH + 1 {
                let u = (place - knot as f64) * 0.8;
                z += Complex64::new(re[knot].into(), im[knot].into()) * (-0.5 * u * u).exp();
            }
            let turns = (frequency_hz * (first + k as i64) as f64 / self.rate_hz).fract();
            z *= Complex64::cis(TAU * turns) / norm;
            (self.re[k], self.im[k]) = (z.re as f32, z.im as f32);
        }
    }

    /// Adds the samples in `range` of those prepared to (`re`, `im`) of a channel.
    pub fn add(&self, channel: usize, range: Range<usize>, re: &mut [f32], im: &mut [f32]) {
        if !self.is_silent {
            let (from_re, from_im) = (&self.re[range.clone()], &self.im[range]);
            add_weighted(from_re, from_im, self.weights[channel], re, im);
        }
    }
}
