//! What can be done about interference, and how it is chosen: by what a weak signal keeps.
//!
//! ```text
//! score = P(y) / G^2
//! ```
//!
//! `P` is the power of the output weighted by the code's spectrum. `G` is the gain of a signal of small power: the same
//! fit and treatment of `x + e p` and `x - e p`, where `p` is a code that no satellite has, and
//! `G = <difference, p> / (2 e <p, p>)`. The noise cancels in the difference, and that weights follow the samples is
//! included. (Any other measure of gain is fooled: the mean weight takes impulses for a spectrum of few bins.)

use super::basis::{Basis, Transform};
use super::envelope::Envelope;
use super::floor::{CellFloor, Powers, Shape};
use crate::capture::StreamInfo;
use crate::front_end::{ImpulseSuppressor, Suppression};
use crate::gnss::signal::GPS_L1_CA;
use num_complex::Complex32;
use sdr_rx_linalg::{Fft, forward_transform, inverse_transform};
use std::f64::consts::{PI, TAU};

/// Samples of the blocks of spectra and of sweeps at [`BLOCK_RATE_HZ`]; at twice the rate twice as many.
const LENGTHS: [usize; 5] = [4096, 1024, 256, 64, 16];
const SWEEP_LENGTHS: [usize; 3] = [32, 64, 256];
const BLOCK_RATE_HZ: f64 = 2.6e6;
/// Blocks by which a sweep's rate is found.
const SWEEP_BLOCKS: usize = 48;
/// A treatment must bring so much, dB, and one of two parts as much more than the better of them.
const WORTH_DB: f64 = 0.1;
const SECOND_WORTH_DB: f64 = 0.3;
/// Blocks that the samples must have for a basis.
const MIN_BLOCKS: usize = 8;
/// What is gained is more than so many standard deviations of the powers compared.
const SIGMAS: f64 = 3.0;
/// The longest spectra, which are tried with the map of impulses whatever the others show.
const MAPPED_SPECTRA: usize = 3;
/// Below this fourth moment there may be a ring: 1.75 is that of one as strong as the noise.
const RING_MOMENT: f64 = 1.85;
/// Rounds in which lines and impulses are told apart.
const ROUNDS: usize = 3;
/// What passes less of a signal than this takes the signal for interference.
const LEAST_GAIN: f64 = 0.03;
/// Amplitude of the pilot over that of the output in the code's band.
const PILOT: f64 = 0.1;
/// Bins of the spectrum of the output.
const SPECTRUM_BINS: usize = 1024;

/// A treatment: bases one after the other, and a memoryless map, fitted together.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Treatment {
    pub bases: Vec<Basis>,
    pub map: Option<MemorylessMap>,
}

/// What is done to each sample by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum MemorylessMap {
    /// Impulses are attenuated.
    Impulses,
    /// What lies along a constant envelope is removed.
    Envelope,
}

impl Treatment {
    /// Samples on either side on which a treated sample depends.
    pub(super) fn reach(&self) -> usize {
        let once: usize = self.bases.iter().map(|basis| basis.length).sum();
        if self.map.is_some() { ROUNDS * once } else { once }
    }
}

/// Tables and scratch for the treatments of one stream.
#[derive(Clone)]
pub(super) struct Tools {
    rate_hz: f64,
    /// Where the carrier lies, Hz.
    if_hz: f64,
    real: bool,
    /// One- and two-bit samples: nothing but long spectra is tried.
    coarse: bool,
    transforms: Vec<Transform>,
    pub impulses: ImpulseSuppressor,
}

impl Tools {
    pub(super) fn new(info: &StreamInfo) -> Self {
        Self {
            rate_hz: info.rate_hz,
            if_hz: info.if_hz,
            real: info.real,
            coarse: false,
            transforms: Vec::new(),
            impulses: ImpulseSuppressor::new(Suppression::Auto, info),
        }
    }

    /// Says whether samples come from a converter of one or two bits.
    pub(super) fn set_coarse(&mut self, coarse: bool) {
        self.coarse = coarse;
    }

    /// A length of blocks at this stream's rate.
    fn length(&self, length: usize) -> usize {
        let octaves = (self.rate_hz / BLOCK_RATE_HZ).log2().round() as i32;
        let scaled = (length as f64 * 2f64.powi(octaves)) as usize;
        scaled.clamp(16, 1 << 16)
    }

    /// The lengths of spectra that are tried, longest first.
    pub(super) fn lengths(&self) -> Vec<usize> {
        let tried = if self.coarse { &LENGTHS[..1] } else { &LENGTHS[..] };
        let mut lengths: Vec<usize> = tried.iter().map(|n| self.length(*n)).collect();
        lengths.dedup();
        lengths
    }

    pub(super) fn transform(&mut self, basis: Basis) -> &mut Transform {
        let known = self.transforms.iter().position(|t| t.basis == basis);
        let index = known.unwrap_or_else(|| {
            self.transforms.push(Transform::new(basis));
            self.transforms.len() - 1
        });
        &mut self.transforms[index]
    }

    pub(super) fn shape(&mut self, samples: &[Complex32]) -> Option<Shape> {
        let rate_hz = self.rate_hz;
        let basis = Basis { length: Shape::BINS, chirp: 0.0 };
        Shape::of(self.transform(basis), samples, rate_hz)
    }

    /// Treated samples. Where they are too short for a basis it changes nothing.
    pub(super) fn treat(&mut self, samples: &[Complex32], how: &Treatment) -> Vec<Complex32> {
        let Some(shape) = self.shape(samples) else { return samples.to_vec() };
        match how.map {
            None => return self.without_lines(samples, &shape, &how.bases),
            Some(MemorylessMap::Envelope) => {
                let mut out = self.without_lines(samples, &shape, &how.bases);
                if let Some(envelope) = Envelope::fit(&out) {
                    envelope.apply(&mut out);
                }
                return out;
            }
            Some(MemorylessMap::Impulses) => (),
        }
        // Lines are taken for a ring by the map, impulses are smeared by a spectrum: neither may come first.
        let mut rest = samples.to_vec();
        let mut weights = vec![1f32; samples.len()];
        // At the two ends what is left is not what a basis leaves.
        let margin = how.bases.iter().map(|b| b.length).sum::<usize>().min(samples.len() / 4);
        let inside = margin..samples.len() - margin;
        if !how.bases.is_empty() {
            let mut without_impulses = samples.to_vec();
            for _ in 0..ROUNDS {
                let clean = self.without_lines(&without_impulses, &shape, &how.bases);
                for ((r, x), (i, y)) in
                    rest.iter_mut().zip(samples).zip(without_impulses.iter().zip(&clean))
                {
                    *r = x - (i - y);
                }
                self.impulses.estimate(0, &rest[inside.clone()]);
                self.weigh(&rest, &mut weights);
                for ((i, x), (r, w)) in
                    without_impulses.iter_mut().zip(samples).zip(rest.iter().zip(&weights))
                {
                    *i = x - r * (1.0 - w);
                }
            }
        }
        self.impulses.estimate(0, &rest[inside]);
        if how.bases.is_empty() {
            self.impulses.apply(0, &mut rest);
        } else {
            self.weigh(&rest, &mut weights);
            rest.iter_mut().zip(&weights).for_each(|(r, w)| *r *= w);
            self.impulses.count(0, rest.len());
        }
        rest
    }

    /// Weights of the map for what the bases leave, at most 1: what they attenuated is small, and not quiet.
    fn weigh(&self, samples: &[Complex32], weights: &mut [f32]) {
        self.impulses.weights(0, samples, weights);
        let mut some: Vec<f32> = samples.iter().step_by(37).map(Complex32::norm_sqr).collect();
        let half = some.len() / 2;
        if some.is_empty() {
            return;
        }
        let median = some.select_nth_unstable_by(half, f32::total_cmp).1.sqrt();
        let mut most = [0f32];
        self.impulses.weights(0, &[Complex32::new(median, 0.0)], &mut most);
        let most = most[0].max(f32::MIN_POSITIVE);
        weights.iter_mut().for_each(|w| *w = (*w / most).min(1.0));
    }

    fn without_lines(
        &mut self,
        samples: &[Complex32],
        shape: &Shape,
        bases: &[Basis],
    ) -> Vec<Complex32> {
        let mut out = samples.to_vec();
        for &basis in bases {
            let transform = self.transform(basis);
            if let Some(floor) = CellFloor::fit(transform, shape, &out) {
                out = transform.filter(&out, |cells| floor.weigh(cells));
            }
        }
        out
    }

    /// Power of the noise over that of a weak signal after a treatment, and the signal's gain.
    fn score(&mut self, samples: &[Complex32], pilot: &Pilot, how: &Treatment) -> Score {
        let out = self.treat(samples, how);
        let margin = how.reach().min(samples.len() / 4);
        let inside = margin..samples.len() - margin;
        let power = self.power_in_band(&out[inside.clone()]);
        let level = (PILOT * power.sqrt()) as f32;
        let mut with = |sign: f32| {
            let received = samples.iter().zip(&pilot.received);
            let x: Vec<Complex32> = received.map(|(x, p)| x + p * (sign * level)).collect();
            self.treat(&x, how)
        };
        let (plus, minus) = (with(1.0), with(-1.0));
        let (mut product, mut energy) = (0.0, 0.0);
        for k in inside {
            product += f64::from(((plus[k] - minus[k]) * pilot.sent[k].conj()).re);
            energy += f64::from((pilot.received[k] * pilot.sent[k].conj()).re);
        }
        let gain = product / (2.0 * f64::from(level) * energy);
        let noise = if gain > LEAST_GAIN { power / (gain * gain) } else { f64::INFINITY };
        Score { noise, gain }
    }

    /// Mean power spectrum weighted by the spectrum of the code's replica.
    fn power_in_band(&mut self, samples: &[Complex32]) -> f64 {
        let transform = self.transform(Basis { length: SPECTRUM_BINS, chirp: 0.0 });
        let spectrum = Powers::of(transform, samples, SPECTRUM_BINS / 2).means();
        // Of a replica of rectangular chips as it is sampled, aliases included: the transform of its triangle.
        let samples_per_chip = self.rate_hz / GPS_L1_CA.chip_rate_hz;
        let code = |offset_hz: f64| -> f64 {
            let lags = 1..samples_per_chip.ceil() as usize;
            let term = |n: usize| {
                (1.0 - n as f64 / samples_per_chip)
                    * (TAU * offset_hz / self.rate_hz * n as f64).cos()
            };
            1.0 + 2.0 * lags.map(term).sum::<f64>()
        };
        let (mut sum, mut weights) = (0.0, 0.0);
        for (k, power) in spectrum.iter().enumerate() {
            let at_hz = |k: usize| k as f64 / SPECTRUM_BINS as f64 * self.rate_hz;
            let apart = |f: f64| {
                let d = (f - self.if_hz).rem_euclid(self.rate_hz);
                d.min(self.rate_hz - d)
            };
            let image = if self.real { code(apart(-at_hz(k))) } else { 0.0 };
            let weight = code(apart(at_hz(k))) + image;
            sum += weight * f64::from(*power);
            weights += weight;
        }
        if weights > 0.0 { sum / weights } else { 0.0 }
    }

    /// A code that no satellite has, at the carrier, of unit power, and what the front end passes of it.
    fn pilot(&mut self, samples: &[Complex32]) -> Option<Pilot> {
        let len = samples.len();
        let chips_per_sample = GPS_L1_CA.chip_rate_hz / self.rate_hz;
        let cycles_per_sample = self.if_hz / self.rate_hz;
        let sample = |n: usize| {
            let chip = (n as f64 * chips_per_sample) as u64;
            // The top bit of a multiplicative hash: as good as random for codes of some ten thousand chips.
            let hash = (chip.wrapping_add(1)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let hash = (hash ^ (hash >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let sign = if hash >> 63 == 0 { 1.0 } else { -1.0 };
            // One turn in all: what passes signals of one phase alone passes half of this.
            let turns = (cycles_per_sample * n as f64).fract() + n as f64 / len as f64;
            let (sin, cos) = (TAU * turns).sin_cos();
            match self.real {
                true => Complex32::new((sign * cos * 2f64.sqrt()) as f32, 0.0),
                false => Complex32::new((sign * cos) as f32, (sign * sin) as f32),
            }
        };
        let sent: Vec<Complex32> = (0..len).map(sample).collect();
        let shape = self.shape(samples)?;
        let mut received = sent.clone();
        forward_transform(len).process(&mut received);
        received.iter_mut().zip(shape.amplitudes(len)).for_each(|(x, a)| *x *= a / len as f32);
        inverse_transform(len).process(&mut received);
        Some(Pilot { sent, received })
    }

    /// What a treatment gives on these samples.
    pub(super) fn scored_now(&mut self, samples: &[Complex32], how: &Treatment) -> Option<Score> {
        let known = self.impulses.clone();
        let score = self.pilot(samples).map(|pilot| self.score(samples, &pilot, how));
        self.impulses = known;
        score
    }

    /// The best treatment of the samples, if any gains enough.
    pub(super) fn choose(&mut self, samples: &[Complex32]) -> Option<Chosen> {
        let known = self.impulses.clone();
        let chosen = self.best_of_all(samples);
        // What was tried is not what was done.
        self.impulses = known;
        chosen
    }

    fn best_of_all(&mut self, samples: &[Complex32]) -> Option<Chosen> {
        let pilot = &self.pilot(samples)?;
        let untreated = self.scored(samples, pilot, &[], None);
        let spectra = self.spectra();
        let sweeps = if self.coarse { Vec::new() } else { self.sweeps(samples) };
        let mut bases = [spectra, sweeps].concat();
        // At the ends of the samples blocks are missing.
        bases.retain(|basis| basis.length * MIN_BLOCKS <= samples.len());
        let single: Vec<Scored> =
            bases.iter().map(|basis| self.scored(samples, pilot, &[*basis], None)).collect();
        let best_basis = best(single)?;
        let basis = best_basis.how.bases[0];
        let mut chosen = best_basis;
        if !self.coarse {
            let real = self.real;
            let mut scored = |bases: &[Basis], map| self.scored(samples, pilot, bases, map);
            let impulses = scored(&[], Some(MemorylessMap::Impulses));
            let impulsive = untreated.over(&impulses) > WORTH_DB;
            // Impulses smear the spectra: which one is best shows only with the map.
            let tried = if impulsive { bases.len() } else { MAPPED_SPECTRA.min(bases.len()) };
            let with_map = bases[..tried].iter().copied().filter(|b| *b != basis).chain([basis]);
            let mut single = vec![chosen];
            if !real && fourth_moment(samples) < RING_MOMENT {
                single.push(scored(&[], Some(MemorylessMap::Envelope)));
            }
            chosen = best(single)?;
            // Of equals the map is the one that follows the noise from sample to sample.
            if impulses.over(&chosen) < SECOND_WORTH_DB {
                chosen = impulses;
            }
            let apart = |b: &Basis| b.length * 4 <= basis.length || basis.length * 4 <= b.length;
            let second = bases.iter().copied().find(apart);
            let mut both: Vec<Scored> =
                with_map.map(|basis| scored(&[basis], Some(MemorylessMap::Impulses))).collect();
            both.extend(second.map(|second| scored(&[basis, second], None)));
            if let Some(both) = best(both).filter(|b| chosen.over(b) > SECOND_WORTH_DB) {
                chosen = both;
            }
        }
        let gain_db = untreated.over(&chosen);
        let others_task =
            chosen.how.bases.is_empty() && chosen.how.map == Some(MemorylessMap::Impulses);
        // Standard deviation of a power of so many independent samples, dB.
        let sigma_db = db(1.0 + (2.0 / samples.len() as f64).sqrt());
        (gain_db > WORTH_DB.max(SIGMAS * sigma_db) && !others_task)
            .then_some(Chosen { treatment: chosen.how, score: chosen.score })
    }

    fn scored(
        &mut self,
        samples: &[Complex32],
        pilot: &Pilot,
        bases: &[Basis],
        map: Option<MemorylessMap>,
    ) -> Scored {
        let how = Treatment { bases: bases.to_vec(), map };
        let score = self.score(samples, pilot, &how);
        Scored { how, score }
    }

    fn spectra(&self) -> Vec<Basis> {
        self.lengths().into_iter().map(|length| Basis { length, chirp: 0.0 }).collect()
    }

    /// Of each length the sweep whose blocks are the nearest to a line.
    fn sweeps(&self, samples: &[Complex32]) -> Vec<Basis> {
        let found = SWEEP_LENGTHS.iter().map(|n| self.length(*n)).filter_map(|length| {
            let half = (length / 2) as i64;
            let rates = (-half..=half).filter(|i| *i != 0);
            let chirp = |i: i64| 2.0 * i as f64 / (length * length) as f64;
            let fft = forward_transform(length);
            let sharp = rates.map(|i| (i, sharpness(samples, &*fft, chirp(i))));
            let best = sharp.max_by(|a, b| a.1.total_cmp(&b.1))?;
            Some(Basis { length, chirp: chirp(best.0) })
        });
        found.collect()
    }
}

/// E |z|^4 over the square of E |z|^2: 2 of noise, 1 of a constant envelope.
fn fourth_moment(samples: &[Complex32]) -> f64 {
    let powers = samples.iter().map(|z| f64::from(z.norm_sqr()));
    let (second, fourth) = powers.fold((0.0, 0.0), |(s, f), p| (s + p, f + p * p));
    fourth * samples.len() as f64 / (second * second)
}

/// Mean over some blocks of the strongest cell over the mean one, dechirped.
fn sharpness(samples: &[Complex32], fft: &dyn Fft<f32>, chirp: f64) -> f64 {
    let length = fft.len();
    let mut scratch = vec![Complex32::ZERO; fft.get_inplace_scratch_len()];
    let dechirp: Vec<Complex32> = (0..length)
        .map(|n| {
            let m = n as f64 - (length as f64 - 1.0) / 2.0;
            Complex32::cis((-PI * chirp * m * m) as f32)
        })
        .collect();
    let step = ((samples.len() + 1).saturating_sub(length) / SWEEP_BLOCKS).max(1);
    let mut frame = vec![Complex32::ZERO; length];
    let mut sum = 0.0;
    for block in samples.windows(length).step_by(step).take(SWEEP_BLOCKS) {
        for ((x, s), d) in frame.iter_mut().zip(block).zip(&dechirp) {
            *x = s * d;
        }
        fft.process_with_scratch(&mut frame, &mut scratch);
        let powers = frame.iter().map(|x| f64::from(x.norm_sqr()));
        let (total, most) = powers.fold((0.0, 0f64), |(t, m), p| (t + p, m.max(p)));
        if total > 0.0 {
            sum += most / total;
        }
    }
    sum
}

/// A weak signal by which treatments are judged.
struct Pilot {
    sent: Vec<Complex32>,
    /// Behind the front end, whose shape the noise shows.
    received: Vec<Complex32>,
}

/// A treatment and its result.
struct Scored {
    how: Treatment,
    score: Score,
}

impl Scored {
    /// How much more noise this leaves than another, dB.
    fn over(&self, other: &Self) -> f64 {
        db(self.score.noise / other.score.noise)
    }
}

fn best(all: Vec<Scored>) -> Option<Scored> {
    all.into_iter().min_by(|a, b| a.score.noise.total_cmp(&b.score.noise))
}

/// A treatment's result.
#[derive(Clone, Copy, Debug)]
pub(super) struct Score {
    /// Noise in the code's band over the gain of a weak signal.
    pub noise: f64,
    /// The gain of a weak signal, in amplitude.
    pub gain: f64,
}

/// The treatment chosen.
#[derive(Clone, Debug)]
pub(super) struct Chosen {
    pub treatment: Treatment,
    pub score: Score,
}

pub(super) fn db(ratio: f64) -> f64 {
    10.0 * ratio.log10()
}
