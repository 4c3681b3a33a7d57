//! The sample covariance of the channels, its eigenvalues, and its compression to a few snapshots of
//! high signal-to-noise ratio.
//!
//! Cost of the covariance of M channels: M^2/2 complex multiply-adds a sample. Samples are taken in tiles of
//! 512 that stay in the second-level cache as planes of real and imaginary parts; within a tile products are
//! summed in single precision (32 terms a lane), from tile to tile in double.

use super::CMat;
use super::decision::random_matrix::{self, Division};
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;
use sdr_rx_linalg::hermitian_eigen;

/// Samples in a tile.
const TILE: usize = 512;
/// Samples multiplied at once.
const LANES: usize = 16;
/// Channels in a block of products, each way.
const BLOCK: usize = 2;
/// Samples times channels of one task: fixed, so that sums are the same on any number of threads.
const TASK: usize = 1 << 20;

/// Sample covariance (1/T) sum x x^H of channels of T samples each, M x M.
///
/// # Panics
/// When the channels differ in length.
pub fn covariance(channels: &[&[Complex32]]) -> CMat {
    let count = channels.len();
    let samples = channels.first().map_or(0, |c| c.len());
    assert!(channels.iter().all(|c| c.len() == samples), "covariance: channels differ in length");
    let padded = count.next_multiple_of(BLOCK);
    let stretch = (TASK / padded.max(1) / TILE).max(1) * TILE;
    let starts: Vec<usize> = (0..samples).step_by(stretch).collect();
    let parts: Vec<Vec<Complex64>> = starts
        .into_par_iter()
        .map(|start| {
            let mut sums = vec![Complex64::ZERO; padded * padded];
            let mut planes = vec![0f32; 2 * padded * TILE];
            let end = (start + stretch).min(samples);
            for at in (start..end).step_by(TILE) {
                let len = TILE.min(end - at);
                if len < TILE {
                    planes.fill(0.0);
                }
                for (channel, planes) in channels.iter().zip(planes.chunks_exact_mut(2 * TILE)) {
                    let (re, im) = planes.split_at_mut(TILE);
                    for (x, (re, im)) in channel[at..at + len].iter().zip(re.iter_mut().zip(im)) {
                        (*re, *im) = (x.re, x.im);
                    }
                }
                add_products(&planes, padded, &mut sums);
            }
            sums
        })
        .collect();
    let mean = |i: usize, k: usize| {
        let sum: Complex64 = parts.iter().map(|part| part[i * padded + k]).sum();
        sum / samples.max(1) as f64
    };
    CMat::from_fn(count, count, |i, k| if i >= k { mean(i, k) } else { mean(k, i).conj() })
}

/// Adds x_i conj(x_k) of one tile, for blocks on and below the diagonal.
#[multiversion::multiversion(targets(
    "x86_64+avx2+fma",
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "aarch64+neon"
))]
fn add_products(planes: &[f32], channels: usize, sums: &mut [Complex64]) {
    const FUSED: bool =
        multiversion::target::target_cfg_f!(any(target_feature = "fma", target_arch = "aarch64"));
    let channel = |c: usize| planes[2 * TILE * c..2 * TILE * (c + 1)].split_at(TILE);
    for i in (0..channels).step_by(BLOCK) {
        for k in (0..=i).step_by(BLOCK) {
            let rows = [channel(i), channel(i + 1)];
            let columns = [channel(k), channel(k + 1)];
            let products = block_products::<FUSED>(rows, columns);
            for (row, products) in products.into_iter().enumerate() {
                for (column, [re, im]) in products.into_iter().enumerate() {
                    sums[(i + row) * channels + k + column] +=
                        Complex64::new(f64::from(re), f64::from(im));
                }
            }
        }
    }
}

/// Sums of a conj(b) for two channels `a` against two channels `b`, each as real and imaginary plane.
#[inline(always)]
fn block_products<const FUSED: bool>(
    a: [(&[f32], &[f32]); BLOCK],
    b: [(&[f32], &[f32]); BLOCK],
) -> [[[f32; 2]; BLOCK]; BLOCK] {
    // Without the instruction a fused multiply-add would be a call.
    let add = |x: f32, y: f32, sum: f32| if FUSED { x.mul_add(y, sum) } else { x * y + sum };
    let mut sums = [[[[0f32; LANES]; 2]; BLOCK]; BLOCK];
    let a = a.map(|(re, im)| (re.as_chunks::<LANES>().0, im.as_chunks::<LANES>().0));
    let b = b.map(|(re, im)| (re.as_chunks::<LANES>().0, im.as_chunks::<LANES>().0));
    for n in 0..TILE / LANES {
        let a = a.map(|(re, im)| (&re[n], &im[n]));
        let b = b.map(|(re, im)| (&re[n], &im[n]));
        for row in 0..BLOCK {
            for column in 0..BLOCK {
                let [re, im] = &mut sums[row][column];
                let ((ar, ai), (br, bi)) = (a[row], b[column]);
                for lane in 0..LANES {
                    re[lane] = add(ai[lane], bi[lane], add(ar[lane], br[lane], re[lane]));
                    im[lane] = add(-ar[lane], bi[lane], add(ai[lane], br[lane], im[lane]));
                }
            }
        }
    }
    sums.map(|row| row.map(|column| column.map(|lanes| lanes.into_iter().sum())))
}

/// The signals of a covariance as a few snapshots far above the noise (directions without codes).
#[derive(Clone, Debug)]
pub struct Compressed {
    /// u_k sqrt(lambda_k - sigma^2) of each eigenvalue above the noise: M x rank.
    pub snapshots: CMat,
    /// All eigenvalues, descending.
    pub eigenvalues: Vec<f64>,
    /// Rank, noise variance and threshold.
    pub division: Division,
}

/// Compresses a covariance of `samples` samples to the snapshots u_k sqrt(lambda_k - sigma^2), which have the
/// covariance of the signals alone; `nulled` directions were projected away beforehand. Noise alone gives a
/// snapshot with probability `false_alarm`. `None` where the covariance is not finite.
///
/// With M elements fewer than M signals can be resolved this way.
pub fn compress(r: &CMat, samples: usize, nulled: usize, false_alarm: f64) -> Option<Compressed> {
    let (eigenvalues, vectors) = hermitian_eigen(r)?;
    let division = random_matrix::divide(&eigenvalues, samples, nulled, false_alarm);
    let scale = |k: usize| (eigenvalues[k] - division.noise_variance).sqrt();
    let snapshots = CMat::from_fn(r.nrows(), division.rank, |m, k| vectors[(m, k)] * scale(k));
    Some(Compressed { snapshots, eigenvalues, division })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    fn noise(channels: usize, samples: usize, seed: u64) -> Vec<Vec<Complex32>> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut part = || rng.sample::<f32, _>(StandardNormal) * std::f32::consts::FRAC_1_SQRT_2;
        (0..channels)
            .map(|_| (0..samples).map(|_| Complex32::new(part(), part())).collect())
            .collect()
    }

    fn slices(channels: &[Vec<Complex32>]) -> Vec<&[Complex32]> {
        channels.iter().map(Vec::as_slice).collect()
    }

    #[test]
    fn the_kernel_equals_the_direct_sum() {
        for (count, samples) in [(1, 1), (2, 512), (3, 700), (7, 5000), (64, 16_384 + 513)] {
            let channels = noise(count, samples, 3);
            let r = covariance(&slices(&channels));
            for i in 0..count {
                for k in 0..count {
                    let wide = |x: &Complex32| Complex64::new(x.re.into(), x.im.into());
                    let pairs = channels[i].iter().zip(&channels[k]);
                    let plain: Complex64 = pairs.map(|(a, b)| wide(a) * wide(b).conj()).sum();
                    // 64 roundings of 6e-8 of sums of a magnitude below the number of terms.
                    assert!(
                        (r[(i, k)] - plain / samples as f64).norm() < 4e-6,
                        "{count} {samples}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_covariance_is_the_same_on_any_number_of_threads() {
        let channels = noise(8, 300_000, 4);
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| covariance(&slices(&channels)))
        };
        assert!(with(1) == with(3));
    }

    #[test]
    fn compressed_snapshots_have_the_covariance_of_the_signals() {
        let (elements, samples) = (6, 40_000);
        let mut channels = noise(elements, samples, 5);
        let waves = noise(2, samples, 6);
        let response = |s: f64, m: usize| Complex64::cis(std::f64::consts::PI * s * m as f64);
        let narrow = |z: Complex64| Complex32::new(z.re as f32, z.im as f32);
        for (m, channel) in channels.iter_mut().enumerate() {
            let gains = [narrow(response(0.3, m)), narrow(response(-0.4, m) * 0.5)];
            for (n, x) in channel.iter_mut().enumerate() {
                *x += waves[0][n] * gains[0] + waves[1][n] * gains[1];
            }
        }
        let compressed = compress(&covariance(&slices(&channels)), samples, 0, 1e-4).unwrap();
        assert_eq!(compressed.division.rank, 2);
        let y = &compressed.snapshots;
        let signals = y * y.adjoint();
        for i in 0..elements {
            for k in 0..elements {
                let truth = response(0.3, i) * response(0.3, k).conj()
                    + response(-0.4, i) * response(-0.4, k).conj() * 0.25;
                // An entry of R has the standard deviation sqrt(R_ii R_kk / T) = 2.25 / 200; five of them.
                assert!((signals[(i, k)] - truth).norm() < 5.0 * 2.25 / 200.0);
            }
        }
        let quiet =
            compress(&covariance(&slices(&noise(6, samples, 7))), samples, 0, 1e-4).unwrap();
        assert_eq!((quiet.division.rank, quiet.snapshots.ncols()), (0, 0));
    }
}
