//! Speed from bytes to conditioned samples, one core.
//!
//! Counted work per input sample (complex): one-bit decoding reads 1/4 byte and writes 8; removing the
//! intermediate frequency costs two complex products, 8 multiply-adds, and moves 16 bytes; decimation by D adds
//! 2 (8 + 1/D) multiply-adds and writes 8/D bytes.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use num_complex::Complex32;
use sdr_rx::capture::{Block, Datatype, SampleFormat, StreamInfo};
use sdr_rx::front_end::{Conditioner, ImpulseSuppressor, Suppression};
use sdr_rx::scenario::noise::{GaussianMixture, NoiseSource};
use sdr_rx::scenario::quantiser::Quantiser;
use std::hint::black_box;

/// Input samples of a block: 6.5 ms at 20 Msps.
const LEN: usize = 1 << 17;

fn formats(c: &mut Criterion) {
    let mut group = c.benchmark_group("formats");
    group.throughput(Throughput::Elements(LEN as u64));
    let mut samples = vec![Complex32::ZERO; LEN];
    for name in ["b1", "cs8", "cs16"] {
        let format = SampleFormat::named(name, None, None).expect("a known format");
        let words = LEN / format.samples_per_word();
        let bytes: Vec<u8> = (0..words * format.word_bytes()).map(|k| k as u8).collect();
        group.bench_function(BenchmarkId::new("decode", name), |b| {
            b.iter(|| format.decode(black_box(&bytes), &mut samples));
        });
    }
    let mut bytes = Vec::new();
    for (name, datatype) in [("cs8", Datatype::I8), ("cs16", Datatype::I16)] {
        group.bench_function(BenchmarkId::new("encode", name), |b| {
            b.iter(|| {
                bytes.clear();
                datatype.encode(bytemuck::cast_slice(black_box(&samples)), &mut bytes)
            });
        });
    }
    group.finish();
}

fn conditioning(c: &mut Criterion) {
    let mut group = c.benchmark_group("conditioning at 20 Msps");
    group.throughput(Throughput::Elements(LEN as u64));
    for (if_hz, decimation) in [(5e6, 1), (0.0, 4), (0.0, 5), (5e6, 5)] {
        let info = StreamInfo {
            rate_hz: 20e6,
            if_hz,
            channels: 1,
            real: false,
            samples: None,
            start_time: None,
            format: "cf32".into(),
            array: None,
        };
        let name = format!("IF {if_hz:.0} Hz, by {decimation}");
        group.bench_function(name, |b| {
            let mut conditioner = Conditioner::new(&info, decimation);
            let (mut input, mut output) = (Block::zeros(1, LEN), Block::default());
            input.channel_mut(0).fill(Complex32::new(3.0, -1.0));
            let mut first = 0;
            b.iter(|| {
                input.reset(1, LEN, first);
                conditioner.process(&input, &mut output);
                first += LEN as u64;
            });
        });
    }
    group.finish();
}

/// Suppression of impulses: 8 bytes read for the histogram; 8 read, 8 written and a weight looked up for the map.
/// Compared with the weight of each sample computed from the mixture (two exponentials), and with Gaussian and
/// coarse samples.
fn suppression(c: &mut Criterion) {
    let mut group = c.benchmark_group("impulses");
    group.throughput(Throughput::Elements(LEN as u64));
    let info = StreamInfo {
        rate_hz: 2e6,
        if_hz: 0.0,
        channels: 1,
        real: false,
        samples: None,
        start_time: None,
        format: "cf32".into(),
        array: None,
    };
    let noise = |share: f64, bits: Option<u32>| {
        let (mut re, mut im) = (vec![0.0; LEN], vec![0.0; LEN]);
        NoiseSource::new(GaussianMixture { probability: share, ratio: 1e3 }, 1, 0)
            .add(0, &mut re, &mut im);
        if let Some(bits) = bits {
            Quantiser::new(bits, None).apply(&mut re);
            Quantiser::new(bits, None).apply(&mut im);
        }
        let mut block = Block::zeros(1, LEN);
        let samples = block.channel_mut(0).iter_mut().zip(re.iter().zip(&im));
        samples.for_each(|(z, (&re, &im))| *z = Complex32::new(re, im));
        block
    };
    let (impulsive, clean, coarse) = (noise(0.1, None), noise(0.0, None), noise(0.0, Some(1)));
    for (name, block) in [("impulsive", &impulsive), ("Gaussian", &clean), ("1 bit", &coarse)] {
        group.bench_function(BenchmarkId::new("estimate", name), |b| {
            let mut suppressor = ImpulseSuppressor::new(Suppression::Auto, &info);
            b.iter(|| suppressor.estimate(0, black_box(block.channel(0))));
        });
    }
    let mut suppressor = ImpulseSuppressor::new(Suppression::Auto, &info);
    let law = suppressor.estimate(0, impulsive.channel(0)).expect("impulses");
    // The map takes impulses away, so each iteration begins with a copy of them.
    let mut block = impulsive.clone();
    group.bench_function("copy and map", |b| {
        b.iter(|| {
            block.clone_from(&impulsive);
            suppressor.apply(0, block.channel_mut(0));
        });
    });
    group.bench_function("copy and map, plain", |b| {
        b.iter(|| {
            block.clone_from(&impulsive);
            for z in block.channel_mut(0) {
                *z *= (law.background * law.inverse_variance(f64::from(z.norm_sqr()))) as f32;
            }
        });
    });
    group.finish();
}

criterion_group!(benches, formats, conditioning, suppression);
criterion_main!(benches);
