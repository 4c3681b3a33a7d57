//! Short-time spectra, dechirped or not, and their inverse.
//!
//! ```text
//! X[t,k] = sum_n w(n) x(n + t N/4) exp(-j pi r m^2) exp(-2 pi j k n / N),   m = n - (N-1)/2
//! ```
//!
//! with a Hann window `w` of unit energy, before the transform and after its inverse, and overlap of three quarters
//! (Allen & Rabiner 1977). Only blocks wholly inside the samples are used: padding with zeros cuts a tone.

use num_complex::Complex32;
use sdr_rx_linalg::{Fft, forward_transform, inverse_transform};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// In which interference may be sparse: spectra of blocks, of signals that sweep where `chirp` is not 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Basis {
    /// Samples of a block, a power of two from 16.
    pub length: usize,
    /// Sweep rate that is removed first, cycles a sample squared.
    pub chirp: f64,
}

/// Blocks overlap by all but this part of their length.
const HOPS: usize = 4;
/// Where the windows of all blocks sum to less than this part of their sum in the middle, samples are attenuated instead
/// of amplified: at the two ends.
const LEAST_COVER: f32 = 0.05;

/// A basis with its tables.
#[derive(Clone)]
pub(super) struct Transform {
    pub basis: Basis,
    /// Window and dechirping.
    window: Vec<Complex32>,
    /// The window's square, times the length.
    cover: Vec<f32>,
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
    scratch: Vec<Complex32>,
    frame: Vec<Complex32>,
}

impl Transform {
    pub(super) fn new(basis: Basis) -> Self {
        let n = basis.length;
        let (forward, inverse) = (forward_transform(n), inverse_transform(n));
        let hann = |k: usize| 0.5 - 0.5 * (TAU * k as f64 / n as f64).cos();
        // The squares of a Hann window sum to 3/8 of its length.
        let norm = (0.375 * n as f64).sqrt();
        let window = (0..n).map(|k| {
            let m = k as f64 - (n as f64 - 1.0) / 2.0;
            let (sin, cos) = (-PI * basis.chirp * m * m).sin_cos();
            let w = hann(k) / norm;
            Complex32::new((w * cos) as f32, (w * sin) as f32)
        });
        let scratch = forward.get_inplace_scratch_len().max(inverse.get_inplace_scratch_len());
        Self {
            basis,
            window: window.collect(),
            cover: (0..n).map(|k| ((hann(k) / norm).powi(2) * n as f64) as f32).collect(),
            scratch: vec![Complex32::ZERO; scratch],
            frame: vec![Complex32::ZERO; n],
            forward,
            inverse,
        }
    }

    /// The spectrum of the block that starts at sample `at`. White noise of unit variance has unit variance in each bin.
    pub(super) fn analyse(&mut self, samples: &[Complex32], at: usize) -> &mut [Complex32] {
        let block = &samples[at..at + self.basis.length];
        for ((x, s), w) in self.frame.iter_mut().zip(block).zip(&self.window) {
            *x = s * w;
        }
        self.forward.process_with_scratch(&mut self.frame, &mut self.scratch);
        &mut self.frame
    }

    /// Samples from spectra that `weigh` changes.
    pub(super) fn filter(
        &mut self,
        samples: &[Complex32],
        mut weigh: impl FnMut(&mut [Complex32]),
    ) -> Vec<Complex32> {
        let (n, hop) = (self.basis.length, self.basis.length / HOPS);
        let mut out = vec![Complex32::ZERO; samples.len()];
        let mut cover = vec![0f32; samples.len()];
        for at in (0..(samples.len() + 1).saturating_sub(n)).step_by(hop) {
            weigh(self.analyse(samples, at));
            self.inverse.process_with_scratch(&mut self.frame, &mut self.scratch);
            for ((y, x), w) in out[at..at + n].iter_mut().zip(&self.frame).zip(&self.window) {
                *y += x * w.conj();
            }
            for (c, w) in cover[at..at + n].iter_mut().zip(&self.cover) {
                *c += w;
            }
        }
        let least = LEAST_COVER * HOPS as f32;
        out.iter_mut().zip(&cover).for_each(|(y, c)| *y /= c.max(least));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unchanged_spectra_give_the_samples_back() {
        let x: Vec<Complex32> =
            (0..1000).map(|n| Complex32::cis(n as f32 * n as f32 * 0.37)).collect();
        for (length, chirp) in [(16, 0.0), (64, 0.0), (64, 3.0 * 2.0 / 4096.0), (256, -1e-4)] {
            let y = Transform::new(Basis { length, chirp }).filter(&x, |_| ());
            // The last block starts at a multiple of a quarter block; the ends are attenuated.
            let inside = length / 2..x.len() - length;
            let worst = inside.map(|k| (y[k] - x[k]).norm()).fold(0.0, f32::max);
            assert!(worst < 1e-5, "{length} {chirp}: {worst}");
        }
    }

    #[test]
    fn a_sweep_of_the_basis_is_a_line() {
        let (length, chirp) = (256, 10.0 / 65_536.0);
        let sweep: Vec<Complex32> = (0..length)
            .map(|n| Complex32::cis((PI * chirp * (n as f64 - 100.0).powi(2)) as f32))
            .collect();
        let mut transform = Transform::new(Basis { length, chirp });
        let cells = transform.analyse(&sweep, 0);
        let powers: Vec<f32> = cells.iter().map(Complex32::norm_sqr).collect();
        let total: f32 = powers.iter().sum();
        let mut sorted = powers.clone();
        sorted.sort_by(|a, b| b.total_cmp(a));
        // A tone between bins has all but a thousandth in the four bins about it.
        assert!(sorted[..4].iter().sum::<f32>() > 0.999 * total);
    }
}
