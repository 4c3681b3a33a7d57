//! The singular value decomposition of code periods: how many signals repeat every code period, and their
//! waveforms.
//!
//! Let D hold one row per element and code period, and one column per bin of code phase. A satellite with
//! response a, data d_k and Doppler f adds one term of rank 1, whatever its code:
//!
//! (a kron d_k exp(j 2 pi f k T)) x waveform^T, waveform(n) = c(n - tau) exp(j 2 pi f n/N T)
//!
//! so that the number of singular values of D above the maximum that noise explains
//! ([`crate::array::decision::random_matrix`]) is the number of satellites, even with one antenna or with
//! more satellites than elements; its right singular vectors span the code waveforms, and D V is the array
//! despread without any code: +30 dB.
//!
//! Cost: the Gram matrix D D^H (rows^2 N / 2 multiply-adds) and its eigenvalues; rows are at most 1024.

use super::periods::CodePeriods;
use crate::acquisition::search::add_product;
use crate::array::CMat;
use crate::array::covariance::covariance;
use crate::array::decision::random_matrix::{self, Division};
use num_complex::Complex32;
use sdr_rx_linalg::hermitian_eigen;

/// The decomposition D = U S V^H of the code periods.
#[derive(Clone, Debug)]
pub struct CodePeriodSvd {
    /// Squared singular values over N, descending: with noise alone about the variance of a bin.
    pub eigenvalues: Vec<f64>,
    /// Number of signals, and the noise variance of a bin.
    pub division: Division,
    /// The first right singular vectors: rows of V^H, of norm 1.
    pub right: Vec<Vec<Complex32>>,
    /// D V: a column for each right vector.
    left: CMat,
    elements: usize,
    periods: usize,
}

impl CodePeriodSvd {
    /// Decomposes, with `components` right vectors (or the number of signals, if larger). `nulled` spatial
    /// directions were projected away beforehand. Noise alone gives a signal with probability `false_alarm`.
    /// `None` without samples, or if any is not finite.
    pub fn new(
        data: &CodePeriods,
        components: usize,
        nulled: usize,
        false_alarm: f64,
    ) -> Option<Self> {
        let rows: Vec<&[Complex32]> = data.rows.iter().map(Vec::as_slice).collect();
        let bins = data.bins as f64;
        let (eigenvalues, vectors) = hermitian_eigen(&covariance(&rows))?;
        let nulled = nulled * data.periods;
        let division = random_matrix::divide(&eigenvalues, data.bins, nulled, false_alarm);
        let alive = eigenvalues.iter().take_while(|&&l| l > 1e-9 * division.noise_variance).count();
        let count = components.max(division.rank).min(alive);
        let size = |j: usize| (eigenvalues[j] * bins).sqrt();
        let right = (0..count)
            .map(|j| {
                let mut sum = vec![Complex32::ZERO; data.bins];
                for (i, row) in rows.iter().enumerate() {
                    let weight = vectors[(i, j)].conj() / size(j);
                    add_product(Complex32::new(weight.re as f32, weight.im as f32), row, &mut sum);
                }
                sum
            })
            .collect();
        let left = CMat::from_fn(rows.len(), count, |i, j| vectors[(i, j)] * size(j));
        let (elements, periods) = (data.elements, data.periods);
        Some(Self { eigenvalues, division, right, left, elements, periods })
    }

    /// The array despread without codes: for each signal K snapshots of all elements, M x (K rank). Their
    /// noise has the variance `division.noise_variance`; snapshots of one column of V hold several
    /// satellites, all of them far above the noise.
    pub fn snapshots(&self) -> CMat {
        CMat::from_fn(self.elements, self.periods * self.division.rank, |m, column| {
            let (j, k) = (column / self.periods, column % self.periods);
            self.left[(m * self.periods + k, j)]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::periods::product;
    use super::*;
    use crate::gnss::signal::GPS_L1_CA;

    #[test]
    fn terms_that_repeat_every_period_are_counted_and_their_waveforms_found() {
        // Three terms of about the power of the noise or a little less, on one element, 40 periods of 1500
        // bins.
        let (periods, bins, terms) = (40, 1500, 3);
        let mut state = 7u64;
        let mut sign = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            if state >> 40 & 1 == 0 { 1f32 } else { -1.0 }
        };
        let waves: Vec<Vec<f32>> =
            (0..terms).map(|_| (0..bins).map(|_| sign()).collect()).collect();
        let level = std::f32::consts::FRAC_1_SQRT_2;
        let samples: Vec<Complex32> = (0..periods)
            .flat_map(|_| {
                let signs: Vec<f32> = (0..terms).map(|_| sign()).collect();
                (0..bins)
                    .map(|n| {
                        let signal: f32 = (0..terms).map(|q| 0.6 * signs[q] * waves[q][n]).sum();
                        Complex32::new(signal + level * sign(), level * sign())
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        let data = CodePeriods::new(&[&samples], 1.5e6, &GPS_L1_CA, periods);
        assert_eq!((data.periods, data.bins, data.rows.len()), (periods, bins, periods));
        let svd = CodePeriodSvd::new(&data, 0, 0, 1e-4).unwrap();
        assert_eq!(svd.division.rank, terms);
        // The mean of 6e4 powers of 1, within five standard deviations, and the fraction of the signals'
        // random cross terms in the noise eigenvalues.
        assert!(
            (svd.division.noise_variance - 1.0).abs() < 5.0 / 6e4f64.sqrt() + 0.01,
            "{:?}",
            svd.division
        );
        assert_eq!(svd.snapshots().shape(), (1, periods * terms));
        for wave in &waves {
            let wave: Vec<Complex32> = wave.iter().map(|&w| Complex32::from(w)).collect();
            let fraction: f64 = svd.right.iter().map(|v| product(v, &wave).norm_sqr()).sum();
            // Fraction of the waveform in the span (Benaych-Georges and Nadakuditi 2012), at a power ratio of
            // p = 40 x 0.36 and c = 40/1500: (1 - c/p^2)/(1 + 1/p) = 0.935; some per cent of scatter.
            assert!(fraction / bins as f64 > 0.9, "{fraction}");
        }
    }
}
