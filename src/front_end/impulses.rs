//! Suppression of impulsive noise: its distribution is estimated from the samples, and a map chosen for it.
//!
//! Satellites lie 15 to 25 dB under the noise of a sample, so the effect of a memoryless map on them is that
//! on a weak signal: see [`Map`]. The map works on the samples as the converter gives them, since a filter
//! would smear the impulses.

use super::efficacy::{Effect, Map};
use super::mixture::{BINS, Mixture, PowerHistogram, bin, middle};
use super::scale_mixture::{Measured, ScaleMixture};
use crate::capture::{Block, StreamInfo};
use multiversion::multiversion;
use num_complex::Complex32;
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// Samples taken from a block for a first test, and the number of segments that they are taken from.
const FIRST_SAMPLES: usize = 1024;
const SEGMENTS: usize = 16;
/// Minimum number of distinct powers (bins of a sixteenth of an octave) in the first test; fewer mean a
/// coarse converter: one and two bits a rail show at most 3, three bits 9, and four bits of real samples 8.
const MIN_POWERS: usize = 16;
/// Minimum number of samples for an estimate; for shorter blocks the last estimate holds.
const MIN_SAMPLES: f64 = 1000.0;
/// One sample in so many, in runs, is looked at first; all are, where these have so many standard deviations of their own:
/// an excess of six of all is 2.1 of these.
const SHARE: usize = 8;
const SHARE_RUN: usize = 256;
const MIN_EXCESS_OF_SHARE: f64 = 1.0;
/// Noise is taken as Gaussian unless its excess passes so many standard deviations: six, since the fourth
/// moment of some thousand samples has a long tail, ...
const MIN_EXCESS: f64 = 6.0;
/// ... and a map gains more than this, dB. (An excess of c in E\[p^2\] gains 2 c^2: six standard deviations
/// of 10^4 samples make 0.03 dB, of 10^5 a tenth of that.)
const MIN_GAIN_DB: f64 = 0.1;

/// Treatment of impulses. Thresholds are in standard deviations of the background.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Suppression {
    /// The locally optimum map where the noise is not Gaussian; nothing where it is, nor to the samples of a
    /// coarse converter.
    #[default]
    Auto,
    /// No suppression.
    Off,
    /// The locally optimum map of the mixture estimated.
    Optimal,
    /// Blanking: samples above the threshold become zero.
    Blank(f64),
    /// Clipping: samples above the threshold keep their phase, and its magnitude.
    Clip(f64),
    /// Hard limiting: samples keep their phase alone.
    Sign,
}

impl Suppression {
    /// The map; `None` without suppression.
    fn map(self) -> Option<Map> {
        match self {
            Self::Off => None,
            Self::Auto | Self::Optimal => Some(Map::Optimal),
            Self::Blank(threshold) => Some(Map::Blank(threshold)),
            Self::Clip(threshold) => Some(Map::Clip(threshold)),
            Self::Sign => Some(Map::Sign),
        }
    }
}

impl fmt::Display for Suppression {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Auto => write!(f, "auto"),
            Self::Off => write!(f, "off"),
            Self::Optimal => write!(f, "optimal"),
            Self::Blank(threshold) => write!(f, "blank:{threshold}"),
            Self::Clip(threshold) => write!(f, "clip:{threshold}"),
            Self::Sign => write!(f, "sign"),
        }
    }
}

impl FromStr for Suppression {
    type Err = String;

    /// `auto`, `off`, `optimal`, `blank` (2.5), `clip` (1), `blank:2`, `clip:1.5`, `sign`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (name, threshold) = text.split_once(':').unwrap_or((text, ""));
        let threshold = |otherwise: f64| {
            match threshold {
            "" => Ok(otherwise),
            text => text.parse().ok().filter(|t| (0.1..=100.0).contains(t)).ok_or(format!(
                "'{text}' is no threshold: it must be 0.1 to 100 standard deviations of the background"
            )),
        }
        };
        match name {
            "blank" => Ok(Self::Blank(threshold(2.5)?)),
            "clip" => Ok(Self::Clip(threshold(1.0)?)),
            "auto" if name == text => Ok(Self::Auto),
            "off" if name == text => Ok(Self::Off),
            "optimal" if name == text => Ok(Self::Optimal),
            "sign" if name == text => Ok(Self::Sign),
            _ => Err(format!(
                "'{text}' is none of auto, off, optimal, blank, clip, sign (blank:2.5 sets a threshold)"
            )),
        }
    }
}

/// Impulsive noise found in a stream, and its suppression.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImpulseReport {
    /// The suppression in effect.
    pub suppression: String,
    /// Fraction of the samples, of all channels, that were mapped; the rest was judged Gaussian, or coarse.
    pub treated: f64,
    /// Mean probability of an impulse in them.
    #[serde(rename = "impulse_share")]
    pub impulse_probability: f64,
    /// Variance of impulses over that of the background (geometric mean).
    pub variance_ratio: f64,
    /// Loss of C/N0 without suppression against the background of the two-component mixture alone, dB.
    pub untreated_loss_db: f64,
    /// The same with suppression; negative where the background itself has heavy tails, of which the map makes use.
    pub loss_db: f64,
}

/// Estimates the noise of each channel, block by block, and maps its samples.
///
/// Signals keep their level (the map's gain for weak signals is 1), so that neither the channels of an array
/// nor mapped and unmapped blocks differ in gain. Cost for each sample: the histogram reads one in eight,
/// or all where these hint at impulses; the map reads it once more, looks up one weight, and writes it. Of coarse samples only one in hundreds is read.
/// Nothing is allocated once the number of channels is known.
#[derive(Clone, Debug)]
pub struct ImpulseSuppressor {
    suppression: Suppression,
    real: bool,
    channels: Vec<Channel>,
}

#[derive(Clone, Debug)]
struct Channel {
    /// Power of two that scales samples to about 1.
    scale: f32,
    /// The noise of scaled samples, where a map is in effect.
    noise: Option<Mixture>,
    /// The finer fit of the locally optimum map, of the same scale.
    fit: Option<ScaleMixture>,
    /// Losses against the background alone without and with the map, dB.
    losses_db: [f64; 2],
    /// Weight by bin of scaled power.
    weights: Box<[f32; BINS]>,
    powers: PowerHistogram,
    sums: Sums,
}

/// Sums over the samples seen.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    seen: f64,
    treated: f64,
    probability: f64,
    log_ratio: f64,
    /// Losses against the background alone, dB: without and with the map.
    untreated_db: f64,
    treated_db: f64,
}

impl ImpulseSuppressor {
    /// A suppressor of a stream's samples.
    pub fn new(suppression: Suppression, info: &StreamInfo) -> Self {
        let channel = Channel {
            scale: 1.0,
            noise: None,
            fit: None,
            losses_db: [0.0; 2],
            weights: Box::new([1.0; BINS]),
            powers: PowerHistogram::default(),
            sums: Sums::default(),
        };
        Self { suppression, real: info.real, channels: vec![channel; info.channels] }
    }

    /// Estimates the noise of each channel of a block, and maps its samples. Channels beyond the stream's are
    /// unchanged.
    pub fn process(&mut self, block: &mut Block) {
        let Self { suppression, real, channels } = self;
        if let Some(map) = suppression.map() {
            block.par_channels_mut().zip(channels).for_each(|(samples, channel)| {
                channel.estimate(map, *suppression != Suppression::Auto, *real, samples);
                channel.apply(samples);
            });
        }
    }

    /// Estimates the noise of a channel from these samples; the estimate holds until the next. Returns the
    /// distribution where a map is in effect.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn estimate(&mut self, channel: usize, samples: &[Complex32]) -> Option<Mixture> {
        let map = self.suppression.map()?;
        let state = &mut self.channels[channel];
        state.estimate(map, self.suppression != Suppression::Auto, self.real, samples);
        state.noise.map(|noise| noise.scaled(f64::from(state.scale).powi(-2)))
    }

    /// Maps samples of a channel by its last estimate.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn apply(&mut self, channel: usize, samples: &mut [Complex32]) {
        self.channels[channel].apply(samples);
    }

    /// Counts samples as mapped by the last estimate, which the caller's own weights stand for.
    pub(super) fn count(&mut self, channel: usize, samples: usize) {
        self.channels[channel].count(samples);
    }

    /// The weights that [`Self::apply`] would multiply samples by: all 1 where no map is in effect.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn weights(&self, channel: usize, samples: &[Complex32], out: &mut [f32]) {
        let Channel { scale, noise, weights, .. } = &self.channels[channel];
        if noise.is_some() {
            let weight = |z: &Complex32| weights[bin((z * *scale).norm_sqr())];
            out.iter_mut().zip(samples).for_each(|(w, z)| *w = weight(z));
        } else {
            out.fill(1.0);
        }
    }

    /// Whether the last block of each channel was judged Gaussian, or coarse.
    pub fn is_quiet(&self) -> bool {
        self.channels.iter().all(|channel| channel.noise.is_none())
    }

    /// The report on the stream so far; `None` where nothing was mapped.
    pub fn report(&self) -> Option<ImpulseReport> {
        let total = |f: fn(&Sums) -> f64| self.channels.iter().map(|c| f(&c.sums)).sum::<f64>();
        let treated = total(|s| s.treated);
        if treated == 0.0 {
            return None;
        }
        Some(ImpulseReport {
            suppression: match self.suppression {
                Suppression::Auto => Suppression::Optimal,
                other => other,
            }
            .to_string(),
            treated: treated / total(|s| s.seen),
            impulse_probability: total(|s| s.probability) / treated,
            variance_ratio: (total(|s| s.log_ratio) / treated).exp(),
            untreated_loss_db: total(|s| s.untreated_db) / treated,
            loss_db: total(|s| s.treated_db) / treated,
        })
    }
}

impl Channel {
    /// `forced`: the distribution is estimated even if the noise is Gaussian.
    fn estimate(&mut self, map: Map, forced: bool, real: bool, samples: &[Complex32]) {
        let segments = || samples.chunks(samples.len().div_ceil(SEGMENTS).max(1));
        let first = || segments().flat_map(|segment| segment.iter().take(FIRST_SAMPLES / SEGMENTS));
        let scale = scale(first()).or_else(|| scale(samples.iter()));
        let Some(scale) = scale else { return };
        self.powers.clear();
        first().for_each(|z| self.powers.add((z * scale).norm_sqr()));
        if !forced && samples.len() >= FIRST_SAMPLES && self.powers.distinct() < MIN_POWERS {
            self.noise = None;
            return;
        }
        let is_gaussian = !forced && self.noise.is_none() && {
            self.powers.clear();
            let runs = samples.chunks(SHARE * SHARE_RUN);
            runs.for_each(|run| self.powers.add_samples(&run[..run.len().min(SHARE_RUN)], scale));
            self.powers.total() >= MIN_SAMPLES && self.powers.excess(real) < MIN_EXCESS_OF_SHARE
        };
        if is_gaussian {
            (self.scale, self.fit) = (scale, None);
            return;
        }
        self.powers.clear();
        self.powers.add_samples(samples, scale);
        if self.powers.total() >= MIN_SAMPLES {
            if self.scale != scale {
                self.fit = None;
            }
            self.scale = scale;
            self.noise = distribution(&self.powers, forced, real);
            if let Some(noise) = self.noise {
                self.tabulate(map, &noise);
            }
        }
    }

    /// Tabulates a map of unit gain for weak signals. Powers that are not finite get no weight.
    fn tabulate(&mut self, map: Map, noise: &Mixture) {
        let fit = match map {
            Map::Optimal => ScaleMixture::fit(&self.powers, noise.real, self.fit.as_ref()),
            _ => None,
        };
        if let Some(fit) = &fit {
            let (weights, Measured { information, power }) = fit.weights(&self.powers);
            for (weight, w) in self.weights.iter_mut().zip(weights) {
                *weight = (w / information) as f32;
            }
            let db = |ratio: f64| 10.0 * ratio.log10();
            self.losses_db = [db(power / noise.background), -db(information * noise.background)];
        } else {
            let Effect { signal, .. } = map.effect(noise);
            for (k, weight) in self.weights.iter_mut().enumerate() {
                let power = middle(k);
                *weight = if power.is_finite() {
                    (map.weight(noise, power) / signal) as f32
                } else {
                    0.0
                };
            }
            self.losses_db = [Map::Linear.loss_db(noise), map.loss_db(noise)];
        }
        self.fit = fit;
    }

    fn apply(&mut self, samples: &mut [Complex32]) {
        self.count(samples.len());
        if self.noise.is_some() {
            multiply(samples, self.scale, &self.weights);
        }
    }

    fn count(&mut self, samples: usize) {
        let n = samples as f64;
        self.sums.seen += n;
        if let Some(noise) = &self.noise {
            self.sums.treated += n;
            self.sums.probability += n * noise.probability;
            self.sums.log_ratio += n * (noise.impulse / noise.background).ln();
            self.sums.untreated_db += n * self.losses_db[0];
            self.sums.treated_db += n * self.losses_db[1];
        }
    }
}

/// The distribution of the powers counted, where it is to be mapped.
fn distribution(powers: &PowerHistogram, forced: bool, real: bool) -> Option<Mixture> {
    if powers.excess(real) > MIN_EXCESS {
        let noise = Mixture::fit(powers, real)?;
        let gain_db = Map::Linear.loss_db(&noise) - Map::Optimal.loss_db(&noise);
        if gain_db > MIN_GAIN_DB {
            return Some(noise);
        }
    }
    forced.then(|| Mixture::gaussian(powers.mean(), real))
}

/// The power of two that scales the largest magnitude of I and Q to 1 to 2; `None` of zeros.
fn scale<'a>(samples: impl Iterator<Item = &'a Complex32>) -> Option<f32> {
    let finite = samples.flat_map(|z| [z.re.abs(), z.im.abs()]).filter(|x| x.is_finite());
    let peak = finite.fold(0f32, f32::max);
    (peak > 0.0).then(|| 2f32.powi(-(f64::from(peak).log2().floor().clamp(-126.0, 126.0) as i32)))
}

/// One pass: 8 bytes read and written a sample, and a weight first up in 16 KiB.
#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "x86_64+avx2+fma",
    "aarch64+neon"
))]
fn multiply(samples: &mut [Complex32], scale: f32, weights: &[f32; BINS]) {
    for z in samples {
        let (re, im) = (z.re * scale, z.im * scale);
        let weight = weights[bin(re * re + im * im)];
        // Values that are not finite become zero as well.
        z.re = if weight == 0.0 { 0.0 } else { z.re * weight };
        z.im = if weight == 0.0 { 0.0 } else { z.im * weight };
    }
}

#[cfg(test)]
mod tests;
