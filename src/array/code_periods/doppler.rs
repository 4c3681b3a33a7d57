//! Covariances of the elements by Doppler modulo the inverse of a code period.
//!
//! A C/A code repeats every T = 1 ms: a satellite of Doppler f turns by exp(j 2 pi f T) from period to period, whatever
//! its code. With D_k (M x N: elements x bins) the k-th of the K periods of a block,
//!
//! Y_f = sum_k D_k exp(-j 2 pi f T k) / sqrt(K),  f = 0, 1 / (2 K T), ... below 1 / T
//!
//! holds the noise unchanged and K times the power of the satellites of Doppler f modulo 1 / T. Each
//! S_f = Y_f Y_f^H / N, summed over the blocks, is a small covariance in which one or two satellites are, so that more
//! of them than elements are resolved. White noise, and signals of longer codes, are in all S_f alike.
//!
//! Cost a block: 2 K M N (K + M / 2) complex multiply-adds.

use super::cells::Row;
use super::periods::{CodePeriods, product};
use crate::acquisition::search::add_product;
use crate::array::CMat;
use crate::array::covariance::covariance;
use crate::array::decision::random_matrix::divide;
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;
use sdr_rx_linalg::hermitian_eigen;
use std::f64::consts::TAU;

/// Lags over which neighbouring bins may be correlated by the front end's filter.
const LAGS: usize = 16;
/// Probability of a signal in noise alone when the noise of one covariance is estimated.
const FLOOR_FALSE_ALARM: f64 = 1e-2;

/// The covariances of a stretch of samples.
#[derive(Clone, Debug)]
pub struct DopplerCovariances {
    /// By Doppler, each of noise variance 1.
    pub covariances: Vec<CMat>,
    /// Spacing of the Dopplers, Hz: half the inverse of a block.
    pub step_hz: f64,
    /// Independent snapshots in each: the bins of all blocks, fewer where a filter correlates neighbouring ones.
    pub samples: f64,
    /// Variance of the noise of a bin.
    pub noise_variance: f64,
    /// Code periods in a block, K, and number of blocks.
    pub block: usize,
    /// Number of blocks, B.
    pub blocks: usize,
    /// Bins of all blocks.
    bins: f64,
    /// Dimensions of the bins that were removed.
    removed: f64,
}

impl DopplerCovariances {
    /// Of all whole blocks of so many code periods; `nulled` spatial directions were projected away from the samples.
    /// `None` without a block, or without noise.
    pub fn new(data: &CodePeriods, block: usize, nulled: usize) -> Option<Self> {
        let blocks = data.periods / block.max(1);
        if blocks == 0 {
            return None;
        }
        let bins = (data.bins * blocks) as f64;
        let samples = bins / correlated_bins(data)?;
        let mut look = Self {
            covariances: Vec::new(),
            step_hz: 0.5 / (block as f64 * data.period_s),
            samples,
            noise_variance: 1.0,
            block,
            blocks,
            bins,
            removed: 0.0,
        };
        let of_doppler = |index: usize| {
            let turns = look.turns(index);
            let mut folded = vec![vec![Complex32::ZERO; data.bins * blocks]; data.elements];
            for (m, folded) in folded.iter_mut().enumerate() {
                for (b, sum) in folded.chunks_exact_mut(data.bins).enumerate() {
                    for (k, turn) in turns.iter().enumerate() {
                        add_product(*turn, data.row(m, b * block + k), sum);
                    }
                }
            }
            covariance(&folded.iter().map(Vec::as_slice).collect::<Vec<_>>())
        };
        let covariances: Vec<CMat> = (0..2 * block).into_par_iter().map(of_doppler).collect();
        let floor = |s: &CMat| {
            let eigenvalues = hermitian_eigen(s)?.0;
            let division = divide(&eigenvalues, samples as usize, nulled, FLOOR_FALSE_ALARM);
            Some(division.noise_variance)
        };
        let mut floors: Vec<f64> = covariances.iter().map(floor).collect::<Option<_>>()?;
        let middle = floors.len() / 2;
        let (_, &mut noise_variance, _) = floors.select_nth_unstable_by(middle, f64::total_cmp);
        if !(noise_variance > 0.0 && noise_variance.is_finite()) {
            return None;
        }
        let scaled = |s: &CMat| s * faer::Scale(Complex64::from(1.0 / noise_variance));
        look.covariances = covariances.iter().map(scaled).collect();
        look.noise_variance = noise_variance;
        Some(look)
    }

    /// Doppler, Hz, modulo the inverse of a code period.
    pub fn doppler_hz(&self, index: usize) -> f64 {
        index as f64 * self.step_hz
    }

    /// Distance of two Dopplers, modulo the inverse of a code period, in inverse block lengths.
    pub(in crate::array) fn blocks_apart(&self, a: usize, b: usize) -> f64 {
        let apart = a.abs_diff(b);
        0.5 * apart.min(self.covariances.len() - apart) as f64
    }

    /// exp(-j 2 pi f T k) / sqrt(K).
    fn turns(&self, index: usize) -> Vec<Complex32> {
        let turn = |k: usize| {
            let cycles = (index * k % (2 * self.block)) as f64 / (2 * self.block) as f64;
            let turn = Complex64::cis(-TAU * cycles) / (self.block as f64).sqrt();
            Complex32::new(turn.re as f32, turn.im as f32)
        };
        (0..self.block).map(turn).collect()
    }

    /// Power of a beam of unit norm, over that of the noise.
    pub fn power(&self, index: usize, beam: &[Complex64]) -> f64 {
        let s = &self.covariances[index];
        let along = |m: usize| -> Complex64 {
            beam.iter().enumerate().map(|(k, b)| s[(m, k)] * b).sum::<Complex64>() * beam[m].conj()
        };
        (0..beam.len()).map(|m| along(m).re).sum()
    }

    /// The waveforms of one code period, a row for each block, in a beam of unit norm at one Doppler: noise has the
    /// power 1 in a row.
    pub(in crate::array) fn rows(
        &self,
        data: &CodePeriods,
        index: usize,
        beam: &[Complex64],
        time_s: impl Fn(usize) -> f64 + Sync,
    ) -> Vec<Row> {
        let scale = 1.0 / (self.noise_variance * data.bins as f64).sqrt();
        let turns = self.turns(index);
        let row = |b: usize| {
            let mut samples = vec![Complex32::ZERO; data.bins];
            for (m, weight) in beam.iter().enumerate() {
                let weight = weight.conj() * scale;
                let weight = Complex32::new(weight.re as f32, weight.im as f32);
                for (k, turn) in turns.iter().enumerate() {
                    add_product(weight * turn, data.row(m, b * self.block + k), &mut samples);
                }
            }
            Row { samples, at_s: time_s(b) }
        };
        (0..self.blocks).into_par_iter().map(row).collect()
    }

    /// Removes from the samples of each block, and from all covariances, the span of the waveforms of that block,
    /// which are orthonormal and of one number.
    pub(in crate::array) fn remove(
        &mut self,
        data: &mut CodePeriods,
        waves: &[Vec<Vec<Complex32>>],
    ) {
        let (elements, periods) = (data.elements, data.periods);
        for (b, waves) in waves.iter().enumerate() {
            for wave in waves {
                // The prompts of the block, period by period.
                let rows = (0..elements).flat_map(|m| (0..self.block).map(move |k| (m, k)));
                let prompts: Vec<Complex64> = rows
                    .map(|(m, k)| {
                        let row = &mut data.rows[m * periods + b * self.block + k];
                        let prompt = product(row, wave);
                        let less = Complex32::new(-prompt.re as f32, -prompt.im as f32);
                        add_product(less, wave, row);
                        prompt
                    })
                    .collect();
                for index in 0..self.covariances.len() {
                    let turns = self.turns(index);
                    let folded = |m: usize| -> Complex64 {
                        let prompts = &prompts[m * self.block..];
                        let wide = |t: &Complex32| Complex64::new(t.re.into(), t.im.into());
                        turns.iter().zip(prompts).map(|(t, p)| wide(t) * p).sum()
                    };
                    let lost: Vec<Complex64> = (0..elements).map(folded).collect();
                    let scale = 1.0 / (self.noise_variance * self.bins);
                    let s = &mut self.covariances[index];
                    for i in 0..elements {
                        for k in 0..elements {
                            s[(i, k)] -= lost[i] * lost[k].conj() * scale;
                        }
                    }
                }
            }
        }
        // Each removed dimension takes its part of the noise.
        let dimensions = waves.iter().map(Vec::len).sum::<usize>() as f64;
        let before = self.bins - self.removed;
        self.removed += dimensions;
        let scale = faer::Scale(Complex64::from(before / (self.bins - self.removed)));
        self.covariances.iter_mut().for_each(|s| *s = scale * &*s);
    }
}

/// sum over the lags of |rho|^2, the number of bins that count as one (Bartlett 1946), as the first element shows.
/// `None` of zeros.
fn correlated_bins(data: &CodePeriods) -> Option<f64> {
    let (mut power, mut lags) = (0.0, [Complex64::ZERO; LAGS]);
    for row in data.rows.iter().take(data.periods) {
        power += product(row, row).re;
        for (lag, sum) in lags.iter_mut().enumerate() {
            *sum += product(&row[lag + 1..], &row[..row.len() - lag - 1]);
        }
    }
    let count = (data.periods * data.bins) as f64;
    // What noise gives by chance is taken off.
    let excess = |sum: &Complex64| (sum.norm_sqr() / (power * power) - 1.0 / count).max(0.0);
    let correlated = 1.0 + 2.0 * lags.iter().map(excess).sum::<f64>();
    (power > 0.0 && correlated.is_finite()).then_some(correlated)
}
