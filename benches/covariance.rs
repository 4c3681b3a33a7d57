//! The sample covariance of 8 and 50 channels over 20 ms at 2.048 MHz: the tiled kernel, the general complex
//! product of `faer` (planar samples copied to a matrix in advance), and the plain loops. One thread; elements
//! are complex samples of all channels.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use num_complex::Complex32;
use rand::{RngExt, SeedableRng};
use sdr_rx::array::covariance::covariance;

const SAMPLES: usize = 40_960;

fn bench(c: &mut Criterion) {
    let one_thread =
        rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be started");
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    for elements in [8, 50] {
        let mut part = || rng.random::<f32>() - 0.5;
        let mut channel = || (0..SAMPLES).map(|_| Complex32::new(part(), part())).collect();
        let channels: Vec<Vec<Complex32>> = (0..elements).map(|_| channel()).collect();
        let slices: Vec<&[Complex32]> = channels.iter().map(Vec::as_slice).collect();
        let matrix = Mat::from_fn(SAMPLES, elements, |n, m| channels[m][n]);
        let mut product = Mat::<Complex32>::zeros(elements, elements);
        let mut group = c.benchmark_group(format!("covariance of {elements} channels"));
        group.sample_size(10).throughput(Throughput::Elements((SAMPLES * elements) as u64));
        group.bench_function("tiles", |b| b.iter(|| one_thread.install(|| covariance(&slices))));
        group.bench_function("faer", |b| {
            b.iter(|| {
                let one = Complex32::ONE;
                matmul(&mut product, Accum::Replace, matrix.adjoint(), &matrix, one, Par::Seq);
            });
        });
        group.bench_function("plain", |b| {
            b.iter(|| {
                let entry = |i: usize, k: usize| -> Complex32 {
                    channels[i].iter().zip(&channels[k]).map(|(a, b)| a * b.conj()).sum()
                };
                (0..elements)
                    .flat_map(|i| (0..=i).map(move |k| (i, k)))
                    .map(|(i, k)| entry(i, k))
                    .sum::<Complex32>()
            });
        });
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
