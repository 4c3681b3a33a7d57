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

use crate::array::CMat;
use crate::array::covariance::covariance;
use crate::array::decision::random_matrix::{self, Division};
use crate::gnss::Signal;
use multiversion::multiversion;
use num_complex::{Complex32, Complex64};
use sdr_rx_linalg::hermitian_eigen;

/// Maximum number of bins in a code period; at higher rates neighbouring samples are summed.
const MAX_BINS: usize = 4096;
/// Maximum number of rows, elements x periods: the cost of eigenvalues grows with their cube.
const MAX_ROWS: usize = 1024;

/// Samples of all elements, by code period and bin of code phase.
#[derive(Clone, Debug)]
pub struct CodePeriods {
    /// Rows, element by element: row m K + k is period k of element m. Samples of one bin are summed and
    /// divided by the root of their number, so that white noise keeps its variance.
    pub rows: Vec<Vec<Complex32>>,
    /// Number of elements, M.
    pub elements: usize,
    /// Number of code periods, K.
    pub periods: usize,
    /// Bins in a code period, N.
    pub bins: usize,
    /// Mean position of a sample in its bin, 0 to 1.
    pub offset: f64,
}

impl CodePeriods {
    /// Sorts the first `periods` code periods of a signal of all channels, limited by their length and by
    /// 1024 rows. `rate_hz` is at least the chip rate.
    ///
    /// # Panics
    /// When a channel is shorter than the first.
    pub fn new(channels: &[&[Complex32]], rate_hz: f64, signal: &Signal, periods: usize) -> Self {
        let samples = channels.first().map_or(0, |c| c.len());
        let elements = channels.len();
        let per_period = rate_hz * signal.period_s();
        let bins = bins_per_period(per_period, signal.chips);
        let bins_per_sample = bins as f64 / per_period;
        let whole = ((samples as f64 + 1e-6) / per_period) as usize;
        let periods = periods.min(whole).min(MAX_ROWS / elements.max(1));
        // A sample on the edge between two bins belongs to the later one in spite of rounding.
        let position = |n: usize| n as f64 * bins_per_sample + 1e-6;
        let used = (0..samples).take_while(|&n| position(n) < (periods * bins) as f64).count();
        let mut scale = vec![0f32; periods * bins];
        (0..used).for_each(|n| scale[position(n) as usize] += 1.0);
        scale.iter_mut().for_each(|count| *count = count.max(1.0).sqrt().recip());
        let mut rows = Vec::with_capacity(elements * periods);
        for channel in channels {
            let mut sorted = vec![Complex32::ZERO; periods * bins];
            for (n, x) in channel[..used].iter().enumerate() {
                sorted[position(n) as usize] += x;
            }
            sorted.iter_mut().zip(&scale).for_each(|(x, scale)| *x *= scale);
            rows.extend(sorted.chunks_exact(bins.max(1)).map(<[Complex32]>::to_vec));
        }
        let offset = (0..used).map(|n| position(n).fract()).sum::<f64>() / used.max(1) as f64;
        Self { rows, elements, periods, bins, offset }
    }

    /// Sum of x(n) conj(w(n)) for every row, M x K.
    pub fn despread(&self, waveform: &[Complex32]) -> CMat {
        CMat::from_fn(self.elements, self.periods, |m, k| {
            product(&self.rows[m * self.periods + k], waveform)
        })
    }
}

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

/// Bins per code period: as many as samples or slightly fewer, at high rates a fraction of them; with prime
/// factors 2, 3 and 5 only, for fast transforms.
fn bins_per_period(samples: f64, chips: usize) -> usize {
    let whole = (samples + 1e-6) as usize;
    let most = whole / whole.div_ceil(MAX_BINS).max(1);
    let is_smooth = |n: &usize| {
        [2, 3, 5].into_iter().fold(*n, |mut rest, prime| {
            while rest > 0 && rest.is_multiple_of(prime) {
                rest /= prime;
            }
            rest
        }) == 1
    };
    (1..=most.max(chips)).rev().find(is_smooth).unwrap_or(1)
}

/// Sum of a conj(b).
#[multiversion(targets(
    "x86_64+avx2+fma",
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "aarch64+neon"
))]
pub(crate) fn product(a: &[Complex32], b: &[Complex32]) -> Complex64 {
    const LANES: usize = 16;
    let (mut re, mut im) = ([0f32; LANES], [0f32; LANES]);
    let mut add = |lane: usize, a: &Complex32, b: &Complex32| {
        re[lane] += a.re * b.re + a.im * b.im;
        im[lane] += a.im * b.re - a.re * b.im;
    };
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            add(lane, &a[lane], &b[lane]);
        }
    }
    a_rest.iter().zip(b_rest).enumerate().for_each(|(lane, (a, b))| add(lane, a, b));
    let sum = |lanes: [f32; LANES]| lanes.into_iter().map(f64::from).sum();
    Complex64::new(sum(re), sum(im))
}

/// Adds weight x.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn add_product(weight: Complex32, x: &[Complex32], sums: &mut [Complex32]) {
    for (sum, x) in sums.iter_mut().zip(x) {
        sum.re += weight.re * x.re - weight.im * x.im;
        sum.im += weight.re * x.im + weight.im * x.re;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::signal::GPS_L1_CA;

    #[test]
    fn the_number_of_bins_is_that_of_samples_or_a_fraction_of_it() {
        for (rate, bins) in
            [(2.048e6, 2048), (2e6, 2000), (2.6e6, 2592), (4e6, 4000), (5e6, 2500), (20e6, 4000)]
        {
            assert_eq!(bins_per_period(rate * 1e-3, GPS_L1_CA.chips), bins, "{rate}");
        }
    }

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
