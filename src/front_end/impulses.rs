//! Impulsive noise suppressed: its law estimated from the samples, then the map that suits it.
//!
//! Satellites lie 15 to 25 dB under the noise of a sample, so what a memoryless map does to them is what it
//! does to a weak signal: see [`Map`]. The map works on the samples as the converter gives them, for a
//! filter would smear the impulses.

use super::efficacy::{Effect, Map};
use super::mixture::{BINS, Mixture, PowerHistogram, bin, middle};
use crate::capture::{Block, StreamInfo};
use multiversion::multiversion;
use num_complex::Complex32;
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// Samples that a first look takes from a block, in so many places.
const LOOK: usize = 1024;
const PLACES: usize = 16;
/// Powers (bins of a sixteenth of an octave) that the look must show, or the converter is coarse: one and two
/// bits a rail show at most 3, three bits 9, and four bits of real samples 8.
const LEAST_POWERS: usize = 16;
/// Samples that an estimate needs; of shorter blocks the last estimate holds.
const LEAST_SAMPLES: f64 = 1000.0;
/// Noise is Gaussian unless its excess passes so many standard deviations: six, for the fourth moment of some
/// thousand samples has a long tail, ...
const LEAST_EXCESS: f64 = 6.0;
/// ... and a map gains more than this, dB. (An excess of c in E\[p^2\] gains 2 c^2: six deviations of 10^4
/// samples make 0.03 dB, of 10^5 a tenth of that.)
const LEAST_GAIN_DB: f64 = 0.1;

/// What is to be done about impulses. Thresholds are in standard deviations of the background.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Suppression {
    /// The locally optimum map where the noise is not Gaussian; nothing where it is, nor to the samples of a
    /// coarse converter.
    #[default]
    Auto,
    /// Nothing.
    Off,
    /// The locally optimum map of the mixture estimated.
    Optimal,
    /// Samples above the threshold become zero.
    Blank(f64),
    /// Samples above the threshold keep their phase, and its magnitude.
    Clip(f64),
    /// Samples keep their phase alone.
    Sign,
}

impl Suppression {
    /// The map, where there is one.
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

/// What was found and done over a stream.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImpulseReport {
    /// The suppression that acted.
    pub suppression: String,
    /// Share of the samples, of all channels, that it acted on; the rest was judged Gaussian, or coarse.
    pub treated: f64,
    /// Mean share of impulses in them.
    pub impulse_share: f64,
    /// Variance of impulses over that of the background (geometric mean).
    pub variance_ratio: f64,
    /// Loss of C/N0 against the background alone that the samples as they came would mean, dB.
    pub untreated_loss_db: f64,
    /// The same of the samples as treated, dB.
    pub loss_db: f64,
}

/// Estimates the noise of each channel, block by block, and maps its samples.
///
/// The wanted signals keep their level whatever is done (the map's gain for weak signals is 1), so that
/// neither the channels of an array nor blocks treated and untreated differ in gain. Cost for each sample: the
/// histogram reads it once; the map reads it once more, looks up one weight, and writes it. Coarse samples
/// cost a look at one in hundreds. Nothing is allocated once the number of channels is known.
#[derive(Clone, Debug)]
pub struct ImpulseSuppressor {
    suppression: Suppression,
    real: bool,
    channels: Vec<Channel>,
}

#[derive(Clone, Debug)]
struct Channel {
    /// Power of two that brings samples near 1.
    scale: f32,
    /// The noise of scaled samples, where a map is in force.
    law: Option<Mixture>,
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
    share: f64,
    log_ratio: f64,
}

impl ImpulseSuppressor {
    /// A suppressor of a stream's samples.
    pub fn new(suppression: Suppression, info: &StreamInfo) -> Self {
        let channel = Channel {
            scale: 1.0,
            law: None,
            weights: Box::new([1.0; BINS]),
            powers: PowerHistogram::default(),
            sums: Sums::default(),
        };
        Self { suppression, real: info.real, channels: vec![channel; info.channels] }
    }

    /// Estimates the noise of each channel of a block, and maps its samples. Channels beyond the stream's stay
    /// as they are.
    pub fn process(&mut self, block: &mut Block) {
        let Self { suppression, real, channels } = self;
        if let Some(map) = suppression.map() {
            block.par_channels_mut().zip(channels).for_each(|(samples, channel)| {
                channel.estimate(map, *suppression != Suppression::Auto, *real, samples);
                channel.apply(samples);
            });
        }
    }

    /// Estimates the noise of a channel from these samples; the estimate holds until the next. Gives the law
    /// where a map is in force.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn estimate(&mut self, channel: usize, samples: &[Complex32]) -> Option<Mixture> {
        let map = self.suppression.map()?;
        let state = &mut self.channels[channel];
        state.estimate(map, self.suppression != Suppression::Auto, self.real, samples);
        state.law.map(|law| law.scaled(f64::from(state.scale).powi(-2)))
    }

    /// Maps samples of a channel by its last estimate.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn apply(&mut self, channel: usize, samples: &mut [Complex32]) {
        self.channels[channel].apply(samples);
    }

    /// The weights that [`Self::apply`] would multiply samples by: all 1 where no map is in force.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn weights(&self, channel: usize, samples: &[Complex32], out: &mut [f32]) {
        let Channel { scale, law, weights, .. } = &self.channels[channel];
        if law.is_some() {
            let weight = |z: &Complex32| weights[bin((z * *scale).norm_sqr())];
            out.iter_mut().zip(samples).for_each(|(w, z)| *w = weight(z));
        } else {
            out.fill(1.0);
        }
    }

    /// What was found and done so far; `None` where nothing was.
    pub fn report(&self) -> Option<ImpulseReport> {
        let map = self.suppression.map()?;
        let total = |f: fn(&Sums) -> f64| self.channels.iter().map(|c| f(&c.sums)).sum::<f64>();
        let treated = total(|s| s.treated);
        if treated == 0.0 {
            return None;
        }
        let (share, ratio) =
            (total(|s| s.share) / treated, (total(|s| s.log_ratio) / treated).exp());
        let law = Mixture { share, background: 1.0, impulse: ratio, real: self.real };
        Some(ImpulseReport {
            suppression: match self.suppression {
                Suppression::Auto => Suppression::Optimal,
                other => other,
            }
            .to_string(),
            treated: treated / total(|s| s.seen),
            impulse_share: share,
            variance_ratio: ratio,
            untreated_loss_db: Map::Linear.loss_db(&law),
            loss_db: map.loss_db(&law),
        })
    }
}

impl Channel {
    /// `forced`: a law is wanted whatever the noise.
    fn estimate(&mut self, map: Map, forced: bool, real: bool, samples: &[Complex32]) {
        let places = || samples.chunks(samples.len().div_ceil(PLACES).max(1));
        let looked = || places().flat_map(|place| place.iter().take(LOOK / PLACES));
        let scale = scale(looked()).or_else(|| scale(samples.iter()));
        let Some(scale) = scale else { return };
        self.powers.clear();
        looked().for_each(|z| self.powers.add((z * scale).norm_sqr()));
        if !forced && samples.len() >= LOOK && self.powers.distinct() < LEAST_POWERS {
            self.law = None;
            return;
        }
        self.powers.clear();
        self.powers.add_samples(samples, scale);
        if self.powers.total() >= LEAST_SAMPLES {
            self.scale = scale;
            self.law = law(&self.powers, forced, real);
            if let Some(law) = &self.law {
                tabulate(map, law, &mut self.weights);
            }
        }
    }

    fn apply(&mut self, samples: &mut [Complex32]) {
        let n = samples.len() as f64;
        self.sums.seen += n;
        if let Some(law) = &self.law {
            self.sums.treated += n;
            self.sums.share += n * law.share;
            self.sums.log_ratio += n * (law.impulse / law.background).ln();
            multiply(samples, self.scale, &self.weights);
        }
    }
}

/// The law of the powers counted, where it is to be mapped.
fn law(powers: &PowerHistogram, forced: bool, real: bool) -> Option<Mixture> {
    if powers.excess(real) > LEAST_EXCESS {
        let law = Mixture::fit(powers, real)?;
        let gain_db = Map::Linear.loss_db(&law) - Map::Optimal.loss_db(&law);
        if gain_db > LEAST_GAIN_DB {
            return Some(law);
        }
    }
    forced.then(|| Mixture::gaussian(powers.mean(), real))
}

/// The power of two that brings the greatest number of some samples to 1 to 2; `None` of zeros.
fn scale<'a>(samples: impl Iterator<Item = &'a Complex32>) -> Option<f32> {
    let finite = samples.flat_map(|z| [z.re.abs(), z.im.abs()]).filter(|x| x.is_finite());
    let peak = finite.fold(0f32, f32::max);
    (peak > 0.0).then(|| 2f32.powi(-(f64::from(peak).log2().floor().clamp(-126.0, 126.0) as i32)))
}

/// Tabulates a map of unit gain for weak signals. Powers that are not finite weigh nothing.
fn tabulate(map: Map, law: &Mixture, weights: &mut [f32; BINS]) {
    let Effect { signal, .. } = map.effect(law);
    for (k, weight) in weights.iter_mut().enumerate() {
        let power = middle(k);
        *weight = if power.is_finite() { (map.weight(law, power) / signal) as f32 } else { 0.0 };
    }
}

/// One pass: 8 bytes read and written a sample, and a weight looked up in 16 KiB.
#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "x86_64+avx2+fma",
    "aarch64+neon"
))]
fn multiply(samples: &mut [Complex32], scale: f32, weights: &[f32; BINS]) {
    for z in samples {
        let (re, im) = (z.re * scale, z.im * scale);
        let weight = weights[bin(re * re + im * im)];
        // What is not finite becomes zero as well.
        z.re = if weight == 0.0 { 0.0 } else { z.re * weight };
        z.im = if weight == 0.0 { 0.0 } else { z.im * weight };
    }
}

#[cfg(test)]
mod tests;
