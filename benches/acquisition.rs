//! Speed of the cold search: the parallel code-phase search against a straightforward search, on one thread.
//!
//! Elements are cells (satellite x Doppler x code phase), so that the rates compare. Counted work of one
//! window of T ms, with D Dopplers and S satellites: here 2T forward and D S inverse transforms; straightforward
//! T D forward and T D S inverse ones.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use num_complex::{Complex32, Complex64};
use sdr_rx::acquisition::{SearchOptions, SearchPlan};
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use sdr_rx_linalg::{forward_transform, inverse_transform};
use std::f64::consts::TAU;

const RATE_HZ: f64 = 4e6;
const PERIOD: usize = 4000;
const MS: usize = 10;
const DOPPLER_HZ: f64 = 5000.0;
const STEP_HZ: f64 = 50.0;

/// Twenty milliseconds of the satellites over Munich at 4 MHz.
fn samples() -> Block {
    let path = format!("{}/signals/static_8sv.toml", env!("CARGO_MANIFEST_DIR"));
    let mut scenario = Scenario::read(path.as_ref()).expect("a scenario of the repository");
    scenario.front_end.rate_hz = RATE_HZ;
    let mut source = ScenarioSource::new(&scenario).expect("a scenario of the repository");
    let mut block = Block::default();
    source.read(&mut block, 2 * MS * PERIOD).expect("a scenario gives its samples");
    block
}

/// The straightforward search of one satellite: for each Doppler and each millisecond the carrier is removed, and the
/// correlation done by one transform, one product and one transform back; periods are summed coherently.
fn plain_search(samples: &[Complex32], code: &[i8]) -> (f32, f64, usize) {
    let (forward, inverse) = (forward_transform(PERIOD), inverse_transform(PERIOD));
    let mut replica: Vec<Complex32> =
        (0..PERIOD).map(|n| Complex32::from(f32::from(code[n * 1023 / PERIOD]))).collect();
    forward.process(&mut replica);
    let mut best = (0.0, 0.0, 0);
    for bin in -(DOPPLER_HZ / STEP_HZ) as i32..=(DOPPLER_HZ / STEP_HZ) as i32 {
        let doppler_hz = f64::from(bin) * STEP_HZ;
        let turn = Complex64::cis(-TAU * doppler_hz / RATE_HZ);
        let mut carrier = Complex64::ONE;
        let mut sum = vec![Complex32::ZERO; PERIOD];
        for period in samples[..MS * PERIOD].chunks_exact(PERIOD) {
            let mut mixed: Vec<Complex32> = period
                .iter()
                .map(|x| {
                    let mixed = x * Complex32::new(carrier.re as f32, carrier.im as f32);
                    carrier *= turn;
                    mixed
                })
                .collect();
            forward.process(&mut mixed);
            mixed.iter_mut().zip(&replica).for_each(|(x, c)| *x *= c.conj());
            inverse.process(&mut mixed);
            sum.iter_mut().zip(&mixed).for_each(|(sum, x)| *sum += x);
        }
        for (n, power) in sum.iter().map(Complex32::norm_sqr).enumerate() {
            if power > best.0 {
                best = (power, doppler_hz, n);
            }
        }
    }
    best
}

fn cold_search(c: &mut Criterion) {
    let block = samples();
    let samples = block.channel(0);
    let one_thread =
        rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be started");
    let mut group = c.benchmark_group("cold search, +-5 kHz, 10 ms at 4 MHz, one thread");
    group.sample_size(10);
    let dopplers = 2.0 * DOPPLER_HZ / STEP_HZ + 1.0;
    for max_windows in [1, 2] {
        let options = SearchOptions { max_windows, ..SearchOptions::default() };
        let plan = SearchPlan::new(RATE_HZ, options).expect("a search that is possible");
        let found = one_thread.install(|| plan.search(samples)).expect("20 ms are enough");
        // Both must agree on the strongest satellite before they are compared.
        let (_, doppler_hz, at) = plain_search(samples, &found[0].transmission.code());
        let chips = (1023.0 - at as f64 * 1023.0 / PERIOD as f64) - found[0].code_phase_chips;
        assert!((doppler_hz - found[0].doppler_hz).abs() <= STEP_HZ && chips.abs() < 1.0);
        group.throughput(Throughput::Elements((32.0 * dopplers * PERIOD as f64) as u64));
        group.bench_function(format!("32 satellites, {max_windows} window(s)"), |b| {
            b.iter(|| one_thread.install(|| plan.search(samples)));
        });
    }
    let code = SearchOptions::default().satellites[0].code();
    group.throughput(Throughput::Elements((dopplers * PERIOD as f64) as u64));
    group.bench_function("plain, 1 satellite, 1 window", |b| {
        b.iter(|| plain_search(samples, &code));
    });
    group.finish();
}

criterion_group!(benches, cold_search);
criterion_main!(benches);
