//! Speed of the scenario: kernels against their counted work, and the whole chain against real time.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use num_complex::Complex64;
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::gnss::{Sv, signal};
use sdr_rx::scenario::kernel::{ChipTable, mix_add};
use sdr_rx::scenario::noise::{GaussianMixture, NoiseSource};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::hint::black_box;

const LEN: usize = 2048;

fn kernels(c: &mut Criterion) {
    let mut group = c.benchmark_group("scenario kernels, 2048 samples");
    group.throughput(Throughput::Elements(LEN as u64));
    let code = signal::of(Sv::all_gps().nth(6).expect("G07")).code();
    let code: Vec<f32> = code.iter().map(|&chip| f32::from(chip)).collect();
    let table = ChipTable::new(&code, 1024);
    let mut chips = vec![0.0; LEN];
    group.bench_function("spread", |b| {
        b.iter(|| table.spread(black_box(17.3), black_box(0.393), &mut chips));
    });
    let (mut re, mut im) = (vec![0.0; LEN], vec![0.0; LEN]);
    let one = Complex64::ONE;
    group.bench_function("mix_add", |b| {
        b.iter(|| mix_add(&chips, one, black_box(1e-3), &mut re, &mut im));
    });
    for (name, probability) in [("white noise", 0.0), ("Gaussian mixture", 0.1)] {
        let mut noise = NoiseSource::new(GaussianMixture { probability, ratio: 50.0 }, 1, 0);
        let mut first = 0;
        group.bench_function(name, |b| {
            b.iter(|| {
                noise.add(first, &mut re, &mut im);
                first += LEN as u64;
            });
        });
    }
    group.finish();
}

/// Elements per second over 2.6e6 is the multiple of real time.
fn chain(c: &mut Criterion) {
    let mut group = c.benchmark_group("scenario, 8 satellites, 0.2 s at 2.6 Msps");
    group.sample_size(10);
    group.throughput(Throughput::Elements(520_000));
    for name in ["static_8sv", "circle_8sv", "impulsive_8sv"] {
        let path = format!("{}/signals/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let mut scenario = Scenario::read(path.as_ref()).expect("a scenario of the repository");
        scenario.duration_s = 0.2;
        let mut block = Block::default();
        group.bench_function(name, |b| {
            b.iter_batched(
                || ScenarioSource::new(&scenario).expect("a scenario of the repository"),
                |mut source| source.read(&mut block, usize::MAX),
                BatchSize::PerIteration,
            );
        });
    }
    group.finish();
}

/// Elements are samples of all channels together; the satellites' chips are made once for all.
fn arrays(c: &mut Criterion) {
    let mut group = c.benchmark_group("scenario, arrays, 0.1 s at 2.048 Msps");
    group.sample_size(10);
    for (name, channels) in [("ula4", 4), ("ula8", 8), ("ula50", 50), ("jammed_ula8", 8)] {
        let path = format!("{}/signals/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let mut scenario = Scenario::read(path.as_ref()).expect("a scenario of the repository");
        scenario.duration_s = 0.1;
        let mut block = Block::default();
        group.throughput(Throughput::Elements(204_800 * channels));
        group.bench_function(name, |b| {
            b.iter_batched(
                || ScenarioSource::new(&scenario).expect("a scenario of the repository"),
                |mut source| source.read(&mut block, usize::MAX),
                BatchSize::PerIteration,
            );
        });
    }
    group.finish();
}

criterion_group!(benches, kernels, chain, arrays);
criterion_main!(benches);
