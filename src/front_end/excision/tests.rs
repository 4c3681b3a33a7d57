//! Loss of signal-to-noise ratio of a weak code against noise alone without treatment, by correlation.

use super::*;
use crate::gnss::signal::GPS_L1_CA;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use sdr_rx_linalg::forward_transform;
use std::f64::consts::TAU;

const RATE_HZ: f64 = 2.6e6;
const CHUNK: usize = 260_000;

fn info() -> StreamInfo {
    StreamInfo {
        rate_hz: RATE_HZ,
        if_hz: 0.0,
        channels: 1,
        real: false,
        samples: None,
        start_time: None,
        format: "cf32".into(),
        array: None,
    }
}

fn normal(rng: &mut ChaCha8Rng) -> Complex32 {
    let mut part = || rng.sample::<f32, _>(StandardNormal) * std::f32::consts::FRAC_1_SQRT_2;
    Complex32::new(part(), part())
}

/// White noise of unit power.
fn noise(n: usize, seed: u64) -> Vec<Complex32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..n).map(|_| normal(&mut rng)).collect()
}

fn code(n: usize) -> Vec<Complex32> {
    let mut rng = ChaCha8Rng::seed_from_u64(99);
    let chips: Vec<f32> = (0..n).map(|_| if rng.random::<bool>() { 1.0 } else { -1.0 }).collect();
    // Whatever passes signals of one phase alone shows.
    let phase = |k: usize| Complex32::cis((TAU * 137.0 / RATE_HZ * k as f64) as f32);
    (0..n)
        .map(|k| phase(k) * chips[(k as f64 * GPS_L1_CA.chip_rate_hz / RATE_HZ) as usize])
        .collect()
}

/// What comes out of an excisor, and the excisor.
fn excised(samples: &[Complex32]) -> (Vec<Complex32>, Excisor) {
    let mut excisor = Excisor::new(&info());
    let mut impulses = crate::front_end::ImpulseSuppressor::new(Default::default(), &info());
    let mut out: Vec<Complex32> = Vec::new();
    let chunks = samples.len().div_ceil(CHUNK);
    for (k, chunk) in samples.chunks(CHUNK).enumerate() {
        let mut block = Block::default();
        block.reset(1, chunk.len(), (k * CHUNK) as u64);
        block.channel_mut(0).copy_from_slice(chunk);
        if !excisor.process(&mut block, k + 1 == chunks) {
            impulses.process(&mut block);
        }
        assert_eq!(block.first_sample(), out.len() as u64);
        out.extend_from_slice(block.channel(0));
    }
    assert_eq!(out.len(), samples.len());
    (out, excisor)
}

/// Mean square of the cross-correlation with a code, over all delays.
fn correlation_power(samples: &[Complex32], code: &[Complex32]) -> f64 {
    let fft = forward_transform(samples.len());
    let (mut a, mut b) = (samples.to_vec(), code.to_vec());
    fft.process(&mut a);
    fft.process(&mut b);
    a.iter().zip(&b).map(|(a, b)| f64::from((a * b.conj()).norm_sqr())).sum::<f64>()
}

/// Loss, dB, against `noise` alone, of what is in `samples`.
fn loss_db(samples: &[Complex32], noise: &[Complex32]) -> (f64, Excisor) {
    let pilot = code(samples.len());
    let with = |sign: f32| -> Vec<Complex32> {
        // -20 dB.
        samples.iter().zip(&pilot).map(|(x, p)| x + p * (0.1 * sign)).collect()
    };
    let (plus, excisor) = excised(&with(1.0));
    let (minus, _) = excised(&with(-1.0));
    let inside = 13_000..samples.len() - 13_000;
    let (mut product, mut energy) = (0.0, 0.0);
    for k in inside.clone() {
        product += f64::from(((plus[k] - minus[k]) * pilot[k].conj()).re);
        energy += 0.2 * f64::from(pilot[k].norm_sqr());
    }
    let gain = product / energy;
    let mean: Vec<Complex32> = plus.iter().zip(&minus).map(|(a, b)| (a + b) * 0.5).collect();
    let power = correlation_power(&mean[inside.clone()], &pilot[inside.clone()]);
    let clean = correlation_power(&noise[inside.clone()], &pilot[inside]);
    (10.0 * (power / clean / gain.powi(2)).log10(), excisor)
}

fn amplitude(jn_db: f64) -> f32 {
    10f64.powf(jn_db / 20.0) as f32
}

fn add(
    noise: &[Complex32],
    amplitude: f32,
    interference: impl FnMut(usize) -> Complex32,
) -> Vec<Complex32> {
    let other = (0..noise.len()).map(interference);
    noise.iter().zip(other).map(|(x, j)| x + j * amplitude).collect()
}

fn tone(frequency_hz: f64) -> impl Fn(usize) -> Complex32 {
    move |n| {
        let (sin, cos) = (TAU * (frequency_hz / RATE_HZ * n as f64).fract()).sin_cos();
        Complex32::new(cos as f32, sin as f32)
    }
}

/// A sweep over `span_hz` in `period_s`; of free-running ones each period is drawn anew within 1 %.
fn sweep(span_hz: f64, period_s: f64, free: bool) -> impl FnMut(usize) -> Complex32 {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut phase, mut at, mut period) = (0f64, 0f64, period_s);
    move |_| {
        at += 1.0 / RATE_HZ;
        if at > period {
            at -= period;
            if free {
                period = period_s * (1.0 + 0.01 * rng.sample::<f64, _>(StandardNormal));
                phase += rng.random::<f64>();
            } else {
                phase = 0.0;
            }
        }
        phase += (span_hz * (at / period - 0.5)) / RATE_HZ;
        let (sin, cos) = (TAU * phase.fract()).sin_cos();
        Complex32::new(cos as f32, sin as f32)
    }
}

/// Noise of a narrow band about the carrier, unit power.
fn narrow(n: usize, width_hz: f64) -> Vec<Complex32> {
    let mut spectrum = noise(n, 17);
    let half = (width_hz / 2.0 / RATE_HZ * n as f64) as usize;
    spectrum[half..n - half].fill(Complex32::ZERO);
    sdr_rx_linalg::inverse_transform(n).process(&mut spectrum);
    let power = spectrum.iter().map(|x| f64::from(x.norm_sqr())).sum::<f64>() / n as f64;
    spectrum.iter_mut().for_each(|x| *x /= power.sqrt() as f32);
    spectrum
}

/// Loss, dB, and the excisor, of interference over the noise, with what was shown.
fn measured(name: &str, samples: &[Complex32], quiet: &[Complex32]) -> (f64, Excisor) {
    let (loss, excisor) = loss_db(samples, quiet);
    let named: Vec<String> = excisor.interferers().iter().map(Interferer::to_string).collect();
    let how = excisor.state.as_ref().map(|state| &state.how);
    println!("{name:24} {loss:5.2} dB  {}  {how:?}", named.join("; "));
    (loss, excisor)
}

/// The frequency of the strongest interferer and its power over the noise.
fn first_tone(excisor: &Excisor) -> Option<(f64, f64)> {
    match excisor.interferers().first()? {
        Interferer { kind: InterfererKind::Tone { frequency_hz }, to_noise_db, .. } => {
            Some((*frequency_hz, *to_noise_db))
        }
        _ => None,
    }
}

#[test]
fn clean_noise_and_that_of_a_narrow_front_end_pass_bit_for_bit() {
    let quiet = noise(4 * CHUNK, 1);
    let (out, excisor) = excised(&quiet);
    assert!(out == quiet && excisor.interferers().is_empty() && excisor.state.is_none());
    // A front end of 2 MHz: a wall of 40 dB.
    let n = 2 * CHUNK;
    let mut spectrum = noise(n, 5);
    sdr_rx_linalg::forward_transform(n).process(&mut spectrum);
    let edge = (1e6 / RATE_HZ * n as f64) as usize;
    spectrum[edge..n - edge].iter_mut().for_each(|x| *x *= 0.01);
    sdr_rx_linalg::inverse_transform(n).process(&mut spectrum);
    spectrum.iter_mut().for_each(|x| *x /= n as f32);
    let (out, excisor) = excised(&spectrum);
    assert!(out == spectrum && excisor.interferers().is_empty(), "{:?}", excisor.interferers());
}

/// The quadrature of a constant envelope that nothing else is known of costs 3.0 dB; a Hann window of 1.6 ms spreads a
/// tone over four bins of 4096, and a tenth of a dB covers its skirt to 40 dB over the noise; noise of 50 kHz takes away
/// its part of the code's spectrum, 0.24 dB; pulses of a tenth of the time 0.46 dB. Losses are measured to 0.03 dB, by as
/// many independent correlations as samples.
#[test]
fn what_is_lost_to_interference_is_near_what_it_must_cost() {
    let n = 2 * CHUNK;
    let quiet = noise(n, 1);
    let band = narrow(n, 50e3);
    let tones = [-400e3, 12.3e3, 150e3, 610e3].map(tone);
    let strong = amplitude(40.0);
    for (name, frequency_hz) in
        [("tone", 12.3e3), ("tone near the edge", 1.2e6), ("tone between", 300e3)]
    {
        let (loss, excisor) = measured(name, &add(&quiet, strong, tone(frequency_hz)), &quiet);
        let (at_hz, power_db) = first_tone(&excisor).expect("a tone");
        assert!(loss < 0.1, "{name}: {loss}");
        assert!((at_hz - frequency_hz).abs() < 20.0 && (power_db - 40.0).abs() < 0.3, "{name}");
    }
    let (loss, excisor) = measured("offset", &add(&quiet, amplitude(20.0), tone(0.0)), &quiet);
    assert!(loss < 0.1 && excisor.interferers()[0].kind == InterfererKind::Offset);
    let four = add(&quiet, strong * 0.5, |n| tones.iter().map(|tone| tone(n)).sum());
    let (loss, excisor) = measured("four tones", &four, &quiet);
    assert!(loss < 0.2 && excisor.interferers().len() == 4, "{loss}");
    let (loss, excisor) = measured("narrow noise", &add(&quiet, strong, |n| band[n]), &quiet);
    let narrow = excisor.interferers()[0].kind;
    let is_named = |width: f64| (40e3..60e3).contains(&width);
    assert!(loss < 0.6, "{loss}");
    assert!(
        matches!(narrow, InterfererKind::NarrowNoise { width_hz, .. } if is_named(width_hz)),
        "{narrow:?}"
    );
    let (loss, excisor) = measured("sweep", &add(&quiet, strong, sweep(2e6, 1e-3, true)), &quiet);
    let sweep_of = excisor.interferers()[0].kind;
    assert!(loss < 1.5, "{loss}");
    // One of 257 rates, 8e7 Hz/s apart.
    let near = |rate: f64| (rate - 2e9).abs() < 1e8;
    assert!(
        matches!(sweep_of, InterfererKind::Sweep { rate_hz_s } if near(rate_hz_s)),
        "{sweep_of:?}"
    );
    let is_of =
        |excisor: &Excisor, db: f64| (excisor.interferers()[0].to_noise_db - db).abs() < 1.0;
    assert!(is_of(&excisor, 40.0), "{:?}", excisor.interferers());
    let fast = add(&quiet, strong, sweep(2e6, 20e-6, false));
    let (loss, excisor) = measured("fast sweep", &fast, &quiet);
    let comb = excisor.interferers()[0].kind;
    assert!(loss < 1.5, "{loss}");
    let near = |spacing: f64| (spacing - 50e3).abs() < 700.0;
    assert!(matches!(comb, InterfererKind::Comb { spacing_hz } if near(spacing_hz)), "{comb:?}");
    let free = add(&quiet, strong, sweep(2e6, 20e-6, true));
    let (loss, excisor) = measured("free-running fast sweep", &free, &quiet);
    assert!(loss < 3.01 + 0.2, "{loss}");
    assert_eq!(excisor.interferers()[0].kind, InterfererKind::ConstantEnvelope);
    assert!(is_of(&excisor, 40.0), "{:?}", excisor.interferers());
    let inner = tone(210e3);
    let pulse = |n: usize| if n % 2600 < 260 { inner(n) } else { Complex32::ZERO };
    let pulsed = add(&quiet, amplitude(30.0), pulse);
    let (loss, excisor) = measured("pulses", &pulsed, &quiet);
    assert!(loss < 0.6, "{loss}");
    assert_eq!(excisor.interferers()[0].kind, InterfererKind::Pulses);
    // A tenth of the time 30 dB.
    assert!(is_of(&excisor, 20.0), "{:?}", excisor.interferers());
}

/// Prints the loss to each kind at each power.
#[test]
#[ignore = "long"]
fn table_of_losses() {
    let n = 2 * CHUNK;
    let quiet = noise(n, 1);
    let band = narrow(n, 50e3);
    for jn_db in [0.0, 10.0, 20.0, 40.0, 60.0] {
        println!("{jn_db} dB over the noise");
        let a = amplitude(jn_db);
        let inner = tone(210e3);
        let tones = [-400e3, 12.3e3, 150e3, 610e3].map(tone);
        let pulse = |n: usize| if n % 2600 < 260 { inner(n) } else { Complex32::ZERO };
        measured("tone", &add(&quiet, a, tone(12.3e3)), &quiet);
        measured("offset", &add(&quiet, a, tone(0.0)), &quiet);
        measured("tone at 300 kHz", &add(&quiet, a, tone(300e3)), &quiet);
        measured("tone at 1.2 MHz", &add(&quiet, a, tone(1.2e6)), &quiet);
        let four = add(&quiet, a * 0.5, |n| tones.iter().map(|tone| tone(n)).sum());
        measured("four tones", &four, &quiet);
        measured("narrow noise", &add(&quiet, a, |n| band[n]), &quiet);
        measured("sweep of 1 ms", &add(&quiet, a, sweep(2e6, 1e-3, true)), &quiet);
        measured("sweep of 20 us", &add(&quiet, a, sweep(2e6, 20e-6, false)), &quiet);
        measured("the same, free-running", &add(&quiet, a, sweep(2e6, 20e-6, true)), &quiet);
        measured("pulses", &add(&quiet, a, pulse), &quiet);
    }
}

/// One sample in ten of a thousand times the variance costs 0.48 dB alone.
#[test]
fn lines_are_removed_among_impulses() {
    let n = 2 * CHUNK;
    let quiet = noise(n, 1);
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let impulses: Vec<Complex32> = quiet
        .iter()
        .map(|x| if rng.random::<f64>() < 0.1 { normal(&mut rng) * 1000f32.sqrt() } else { *x })
        .collect();
    let with = add(&impulses, amplitude(40.0), tone(12.3e3));
    let (loss, excisor) = measured("tone among impulses", &with, &quiet);
    assert!(loss < 0.48 + 0.3, "{loss}");
    let report = excisor.impulses().expect("impulses");
    assert!((report.impulse_probability - 0.1).abs() < 0.01, "{report:?}");
}

#[test]
fn a_treatment_ends_a_second_after_its_interference() {
    let quiet = noise(14 * CHUNK, 1);
    let with_tone = tone(12.3e3);
    let until = 2 * CHUNK + CHUNK / 2;
    let on_and_off = add(&quiet, 10.0, |n| if n < until { with_tone(n) } else { Complex32::ZERO });
    let (out, excisor) = excised(&on_and_off);
    assert!(excisor.state.is_none());
    assert!(out[13 * CHUNK..] == quiet[13 * CHUNK..]);
    let there = excisor.interferers()[0].time_fraction;
    assert!((there - 2.5 / 14.0).abs() < 1.0 / 14.0, "{there}");
}

#[test]
fn a_tone_that_becomes_a_sweep_is_treated_anew() {
    let n = 16 * CHUNK;
    let quiet = noise(n, 1);
    let (at_first, mut later) = (tone(12.3e3), sweep(2e6, 1e-3, true));
    let with = add(&quiet, amplitude(30.0), |k| if k < 2 * CHUNK { at_first(k) } else { later(k) });
    let (out, excisor) = excised(&with);
    let kinds: Vec<InterfererKind> = excisor.interferers().iter().map(|i| i.kind).collect();
    let is_sweep = |kind: &InterfererKind| matches!(kind, InterfererKind::Sweep { .. });
    assert!(kinds.iter().any(is_sweep), "{kinds:?}");
    // What is left of 30 dB in the last chunks: less than the noise.
    let power = |x: &[Complex32]| x.iter().map(|z| f64::from(z.norm_sqr())).sum::<f64>();
    let end = 13 * CHUNK..15 * CHUNK;
    let left = power(&out[end.clone()]) / power(&quiet[end]);
    assert!(left < 2.0, "{left}");
}
