//! What interference is called: its kind, frequency and power, from the mean spectrum and the treatment that was chosen.

use super::basis::Basis;
use super::floor::{Powers, running_median};
use super::treatment::{MemorylessMap, Treatment, db};
use serde::Serialize;
use std::fmt;

/// Power of a bin over its surroundings from which it is a line: lines of strong satellites' codes have up to 2.9.
const LINE: f64 = 4.0;
/// Bins that belong to a line have at least this part of its strongest.
const SKIRT: f64 = 1e-3;
/// Lines weaker than this part of the strongest are not named.
const WEAK: f64 = 1e-3;
/// Bins that a tone fills: the main lobe of a Hann window, and its skirt where strong.
const TONE_BINS: usize = 5;
/// Half of the range of the running median, Hz.
const MEDIAN_HZ: f64 = 300e3;
/// Most lines that are named.
const MOST_NAMED: usize = 8;
/// Blocks longer than this single out lines, shorter ones pulses.
const LINE_BLOCK_S: f64 = 128.0 / 2.6e6;
/// So many lines may be a comb, if they have so much of the power of the strongest: others are aliases.
const COMB_LINES: usize = 6;
const TOOTH: f64 = 0.1;

/// Kind of an interfering signal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum InterfererKind {
    /// A continuous wave, at this frequency against the carrier, Hz.
    Tone {
        /// Against the carrier, Hz.
        frequency_hz: f64,
    },
    /// The offset of the converter: a continuous wave at the frequency 0 of the samples.
    Offset,
    /// Noise of a narrow band, Hz.
    NarrowNoise {
        /// Its centre against the carrier, Hz.
        frequency_hz: f64,
        /// Its width, Hz.
        width_hz: f64,
    },
    /// A tone that sweeps at this rate, Hz/s.
    Sweep {
        /// Its rate, Hz/s.
        rate_hz_s: f64,
    },
    /// Lines at equal distances: something that repeats itself.
    Comb {
        /// Distance of the lines, Hz.
        spacing_hz: f64,
    },
    /// Pulses.
    Pulses,
    /// Of constant envelope, and no line: a tone that sweeps too fast.
    ConstantEnvelope,
}

/// Interference that was removed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Interferer {
    /// What it is.
    #[serde(flatten)]
    pub kind: InterfererKind,
    /// Its power over that of the noise in the whole band of the samples, dB.
    pub to_noise_db: f64,
    /// Fraction of the time so far in which it was there.
    pub time_fraction: f64,
}

impl fmt::Display for Interferer {
    /// As in `CW at +12.3 kHz, 31 dB over the noise, 100 % of the time`.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self.kind {
            InterfererKind::Tone { frequency_hz } => {
                write!(f, "CW at {:+.1} kHz", frequency_hz / 1e3)?;
            }
            InterfererKind::Offset => f.write_str("offset of the converter")?,
            InterfererKind::NarrowNoise { frequency_hz, width_hz } => {
                write!(
                    f,
                    "noise {:.0} kHz wide at {:+.1} kHz",
                    width_hz / 1e3,
                    frequency_hz / 1e3
                )?;
            }
            InterfererKind::Sweep { rate_hz_s } => {
                write!(f, "sweep of {:+.2} GHz/s", rate_hz_s / 1e9)?;
            }
            InterfererKind::Comb { spacing_hz } => {
                let period_us = 1e6 / spacing_hz;
                let spacing = spacing_hz / 1e3;
                write!(
                    f,
                    "comb of lines {spacing:.1} kHz apart, repeating every {period_us:.1} us"
                )?;
            }
            InterfererKind::Pulses => f.write_str("pulses")?,
            InterfererKind::ConstantEnvelope => f.write_str("fast sweep of constant envelope")?,
        }
        let percent = 100.0 * self.time_fraction;
        write!(f, ", {:.0} dB over the noise, {percent:.0} % of the time", self.to_noise_db)
    }
}

/// Lines of a mean spectrum of `powers`, strongest first; many at equal distances are one comb.
pub(super) fn lines(powers: &Powers, rate_hz: f64, if_hz: f64, real: bool) -> Vec<Interferer> {
    let spectrum = Spectrum::new(&powers.means(), rate_hz);
    let mut lines = spectrum.lines(real);
    let strongest = lines.iter().map(|l| l.power).fold(0.0, f64::max);
    lines.retain(|line| line.power > WEAK * strongest);
    let centre = |line: &Line| {
        let at_hz = line.centre * spectrum.bin_hz - if_hz;
        (at_hz + rate_hz / 2.0).rem_euclid(rate_hz) - rate_hz / 2.0
    };
    let teeth = || lines.iter().filter(|line| line.power > TOOTH * strongest);
    if teeth().count() >= COMB_LINES {
        let mut places: Vec<f64> = teeth().map(centre).collect();
        places.sort_by(f64::total_cmp);
        let mut gaps: Vec<f64> = places.windows(2).map(|p| p[1] - p[0]).collect();
        gaps.sort_by(f64::total_cmp);
        let spacing_hz = gaps[gaps.len() / 4];
        // Some lines may be too weak: gaps are whole multiples.
        let whole = |gap: &&f64| {
            let times = (*gap / spacing_hz).round();
            (*gap - times * spacing_hz).abs() < 2.0 * spectrum.bin_hz
        };
        if gaps.iter().filter(whole).count() * 10 > gaps.len() * 7 {
            let power: f64 = lines.iter().map(|l| l.power).sum();
            let kind = InterfererKind::Comb { spacing_hz };
            return vec![interferer(kind, power / spectrum.noise)];
        }
    }
    let name = |line: &Line| {
        let frequency_hz = centre(line);
        let from_zero = line.centre.min(spectrum.floor.len() as f64 - line.centre).abs();
        let kind = if line.core > TONE_BINS {
            InterfererKind::NarrowNoise {
                frequency_hz,
                width_hz: line.core as f64 * spectrum.bin_hz,
            }
        } else if from_zero < 0.5 {
            InterfererKind::Offset
        } else {
            InterfererKind::Tone { frequency_hz }
        };
        let twice = if real && kind != InterfererKind::Offset { 2.0 } else { 1.0 };
        interferer(kind, twice * line.power / spectrum.noise)
    };
    lines.iter().take(MOST_NAMED).map(name).collect()
}

fn interferer(kind: InterfererKind, to_noise: f64) -> Interferer {
    Interferer { kind, to_noise_db: db(to_noise), time_fraction: 1.0 }
}

/// A mean spectrum over its surroundings.
struct Spectrum {
    bin_hz: f64,
    floor: Vec<f64>,
    ratio: Vec<f64>,
    noise: f64,
}

/// Bins side by side that rise above their surroundings.
struct Line {
    /// Centre of its power, in bins.
    centre: f64,
    power: f64,
    /// Bins within 10 dB of the strongest.
    core: usize,
}

impl Spectrum {
    fn new(means: &[f32], rate_hz: f64) -> Self {
        let n = means.len();
        let bin_hz = rate_hz / n as f64;
        let half = ((MEDIAN_HZ / bin_hz) as usize).clamp(1, (n - 1) / 2);
        let floor = running_median(means, half);
        let ratio = means.iter().zip(&floor);
        let ratio = ratio.map(|(x, f)| f64::from(*x) / f.max(f64::MIN_POSITIVE)).collect();
        Self { bin_hz, noise: floor.iter().sum(), floor, ratio }
    }

    /// Strongest first. Real samples hold each line twice: once is looked at.
    fn lines(&self, real: bool) -> Vec<Line> {
        let n = self.ratio.len();
        let mut free = vec![true; n];
        let bins = if real { 0..n / 2 } else { 0..n };
        let mut order: Vec<usize> = bins.filter(|k| self.ratio[*k] > LINE).collect();
        order.sort_by(|a, b| self.ratio[*b].total_cmp(&self.ratio[*a]));
        let mut found = Vec::new();
        for top in order {
            if !free[top] {
                continue;
            }
            let most = self.ratio[top];
            // Outwards through the core and down its skirts, to where the next line rises.
            let mut side = |step: usize| {
                let mut at = top;
                let mut reached = Vec::new();
                let mut in_skirt = false;
                loop {
                    at = (at + step) % n;
                    let here = self.ratio[at];
                    in_skirt |= here < SKIRT * most;
                    if here < LINE || !free[at] || (in_skirt && here > SKIRT * most) || at == top {
                        return reached;
                    }
                    free[at] = false;
                    reached.push(at);
                }
            };
            let (below, above) = (side(n - 1), side(1));
            free[top] = false;
            let excess = |k: usize| (self.ratio[k] - 1.0) * self.floor[k];
            let offset = |k: usize| {
                let up = (k + n - top) % n;
                if up > n / 2 { up as f64 - n as f64 } else { up as f64 }
            };
            let all = || below.iter().chain(&above).copied().chain([top]);
            let power: f64 = all().map(excess).sum();
            let moment: f64 = all().map(|k| excess(k) * offset(k)).sum();
            let core = all().filter(|k| self.ratio[*k] > 0.1 * most).count();
            let centre = (top as f64 + moment / power).rem_euclid(n as f64);
            found.push(Line { centre, power, core });
        }
        found
    }
}

/// What is no line: named by the treatment. `to_noise` is its power over that of the noise.
pub(super) fn others(treatment: &Treatment, rate_hz: f64, to_noise: f64) -> Option<Interferer> {
    let kind = match treatment.bases.iter().find(|basis| basis.chirp != 0.0) {
        Some(basis) => InterfererKind::Sweep { rate_hz_s: basis.chirp * rate_hz * rate_hz },
        None if treatment.map == Some(MemorylessMap::Envelope) => InterfererKind::ConstantEnvelope,
        None => InterfererKind::Pulses,
    };
    Some(interferer(kind, to_noise))
}

/// Whether a treatment is of lines.
pub(super) fn is_of_lines(treatment: &Treatment, rate_hz: f64) -> bool {
    let long = |basis: &Basis| basis.chirp == 0.0 && basis.length as f64 / rate_hz > LINE_BLOCK_S;
    treatment.bases.iter().any(long)
}
