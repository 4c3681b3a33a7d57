//! Speed of tracking: the correlation kernel against its scalar version, and a whole channel.
//!
//! Elements are samples of one channel: elements per second over 10^6 are channel x Msamples per second
//! of one core. Counted work of a sample, all three taps: see `sdr_rx::correlator`.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use sdr_rx::acquisition::Acquisition;
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::correlator::{CodeTable, Depth, SampleBuffer, correlate, correlate_scalar};
use sdr_rx::gnss::signal;
use sdr_rx::scenario::{Scenario, ScenarioSource};
use sdr_rx::tracking::{Channel, LockState, TrackStart, TrackingOptions};
use std::hint::black_box;

/// Rates and depths.
const CASES: [(f64, Depth); 4] =
    [(2.6e6, Depth::Words), (2.6e6, Depth::Bytes), (12e6, Depth::Words), (12e6, Depth::Bytes)];

/// One second of the satellites over Munich, and one of them at the first sample.
fn one_second(rate_hz: f64, depth: Depth) -> (SampleBuffer, Acquisition) {
    let path = format!("{}/signals/static_8sv.toml", env!("CARGO_MANIFEST_DIR"));
    let mut scenario = Scenario::read(path.as_ref()).expect("a scenario of the repository");
    scenario.front_end.rate_hz = rate_hz;
    let mut source = ScenarioSource::new(&scenario).expect("a scenario of the repository");
    let mut block = Block::default();
    source.read(&mut block, rate_hz as usize).expect("a scenario gives its samples");
    let truth = &source.truth_at(0).satellites[0];
    let mut buffer = SampleBuffer::default();
    buffer.push_at(block.channel(0), depth);
    let start = Acquisition {
        transmission: signal::of(truth.sv),
        doppler_hz: truth.doppler_hz,
        code_phase_chips: truth.code_phase_chips,
        cn0_dbhz: truth.cn0_dbhz,
        statistic: 0.0,
        false_alarm: 0.0,
    };
    (buffer, start)
}

fn kernel(c: &mut Criterion) {
    for (rate_hz, depth) in CASES {
        let (buffer, start) = one_second(rate_hz, depth);
        let table = CodeTable::new(start.transmission, rate_hz);
        let taps = table.taps(0, 17.3, 17.3 + rate_hz * 1e-3, 0.25);
        let window = buffer.window(taps.first_sample, taps.first_sample + taps.len as u64);
        let window = window.expect("a millisecond of the second");
        let step = start.doppler_hz / rate_hz;
        let mut group =
            c.benchmark_group(format!("one code period at {} MHz, {depth:?}", rate_hz / 1e6));
        group.throughput(Throughput::Elements(taps.len as u64));
        group.bench_function("correlate", |b| {
            b.iter(|| correlate(window, taps.codes, black_box(0.3), step));
        });
        group.bench_function("correlate_scalar", |b| {
            b.iter(|| correlate_scalar(window, taps.codes, black_box(0.3), step));
        });
        group.finish();
    }
}

fn channel(c: &mut Criterion) {
    let mut group = c.benchmark_group("channel, 1 s");
    group.sample_size(20);
    for (rate_hz, depth) in CASES {
        let (buffer, acquisition) = one_second(rate_hz, depth);
        let start = TrackStart {
            sample: 0,
            acquisition,
            doppler_rate_hz_s: 0.0,
            carrier_phase: 0.0,
            symbol_edge: None,
        };
        group.throughput(Throughput::Elements(rate_hz as u64));
        group.bench_function(format!("{} MHz, {depth:?}", rate_hz / 1e6), |b| {
            b.iter_batched(
                || {
                    let channel = Channel::new(&start, rate_hz, TrackingOptions::default());
                    (channel, Vec::with_capacity(1000), Vec::with_capacity(50))
                },
                |(mut channel, mut epochs, mut bits)| {
                    channel.process(&buffer, &mut epochs, &mut bits);
                    assert!(channel.lock() == LockState::Locked && epochs.len() > 990);
                    epochs
                },
                BatchSize::PerIteration,
            );
        });
    }
    group.finish();
}

criterion_group!(benches, kernel, channel);
criterion_main!(benches);
