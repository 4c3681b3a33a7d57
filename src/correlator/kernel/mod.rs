//! The correlation kernels: which of them runs, and their scalar twin.
//!
//! Work of a sample and channel, all three taps, with AVX2 (half of it for bytes with AVX-512):
//! - bytes, by sums of eight: 1.5 exclusive ors and sums of absolute differences of 32 bytes for each of 32 samples and
//!   component, and an eighth of two multiply-adds, two conversions and one carrier phasor;
//! - words, by sums of two: three multiply-adds of pairs for each component, half a carrier phasor, six conversions and
//!   twelve fused multiply-adds for each of eight pairs.
//!
//! The carrier is constant over a sum of n samples, which costs (pi n f / rate)^2 / 6 of the amplitude: for eight samples
//! 0.0004 at 5 kHz and 2.6 MHz. Where that is too much, bytes become words.

#[cfg(target_arch = "x86_64")]
mod eights;
#[cfg(target_arch = "x86_64")]
mod pairs;

use num_complex::{Complex32, Complex64};
use std::f64::consts::TAU;

/// Entries of a replica that may be read beyond the samples: one vector of the kernels.
pub const VECTOR: usize = 64;
/// What a byte's step is in words: bytes are the words over this, and half a step more.
pub const WORDS_PER_BYTE: i16 = 16;
/// Carrier cycles a sample up to which sums of eight are used: they lose 0.05 dB there.
#[cfg(target_arch = "x86_64")]
const MOST_OF_EIGHTS: f64 = 0.0075;

/// Consecutive samples, in-phase and quadrature apart.
#[derive(Clone, Copy, Debug)]
pub enum Window<'a> {
    /// A byte b stands for b - 127.5 steps of 16 words.
    Bytes([&'a [u8]; 2]),
    /// As they are.
    Words([&'a [i16]; 2]),
}

impl Window<'_> {
    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Self::Bytes([i, _]) => i.len(),
            Self::Words([i, _]) => i.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A sample, in units of words.
    pub fn sample(&self, n: usize) -> Complex64 {
        let byte = |b: u8| (f64::from(b) - 127.5) * f64::from(WORDS_PER_BYTE);
        match self {
            Self::Bytes([i, q]) => Complex64::new(byte(i[n]), byte(q[n])),
            Self::Words([i, q]) => Complex64::new(i[n].into(), q[n].into()),
        }
    }
}

/// Sign of a replica's entry: 0 stands for +1, 255 for -1.
pub fn sign(entry: u8) -> f64 {
    1.0 - 2.0 * f64::from(entry & 1)
}

/// Correlates samples with three replicas after removing a carrier: for each replica c the sum of
/// x\[n\] c\[n\] exp(-j 2 pi (phase + n step)).
///
/// `codes`: replicas of at least as many entries as there are samples, and [`VECTOR`] more, 0 for +1 and 255 for -1;
/// `phase` (cycles) that of the carrier at the first sample, `step` (cycles per sample) its advance.
///
/// # Panics
/// When a replica is shorter than that.
pub fn correlate(window: Window<'_>, codes: [&[u8]; 3], phase: f64, step: f64) -> [Complex32; 3] {
    let len = window.len();
    assert!(codes.iter().all(|c| c.len() >= len + VECTOR), "correlate: a short replica");
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        let run = |from: usize, count: usize| {
            let range = from..len.min(from + count);
            (range, codes.map(|c| &c[from..]), (phase + step * from as f64).fract())
        };
        let mut sums = [Complex32::ZERO; 3];
        let mut add = |part: [Complex32; 3]| sums.iter_mut().zip(part).for_each(|(s, p)| *s += p);
        match window {
            Window::Words([i, q]) => {
                assert!(q.len() == len, "correlate: q is not as long as i");
                // SAFETY: the processor has AVX2 and FMA, which is all that the function asks for.
                #[allow(unsafe_code)]
                add(unsafe { pairs::correlate(i, q, codes, phase, step) });
            }
            Window::Bytes([i, q]) if step.abs() <= MOST_OF_EIGHTS => {
                assert!(q.len() == len, "correlate: q is not as long as i");
                let has_512 =
                    is_x86_feature_detected!("avx512bw") && is_x86_feature_detected!("avx512vl");
                for from in (0..len).step_by(eights::MOST_SAMPLES) {
                    let (range, codes, phase) = run(from, eights::MOST_SAMPLES);
                    let (i, q) = (&i[range.clone()], &q[range]);
                    // SAFETY: as above, or with AVX-512F, BW and VL besides.
                    #[allow(unsafe_code)]
                    add(match has_512 {
                        true => unsafe { eights::correlate_512(i, q, codes, phase, step) },
                        false => unsafe { eights::correlate(i, q, codes, phase, step) },
                    });
                }
            }
            Window::Bytes([i, q]) => {
                const RUN: usize = 1024;
                let word = |b: u8| (2 * i16::from(b) - 255) * (WORDS_PER_BYTE / 2);
                let (mut words_i, mut words_q) = ([0i16; RUN], [0i16; RUN]);
                for from in (0..len).step_by(RUN) {
                    let (range, codes, phase) = run(from, RUN);
                    words_i.iter_mut().zip(&i[range.clone()]).for_each(|(w, &b)| *w = word(b));
                    words_q.iter_mut().zip(&q[range.clone()]).for_each(|(w, &b)| *w = word(b));
                    let (i, q) = (&words_i[..range.len()], &words_q[..range.len()]);
                    // SAFETY: as above.
                    #[allow(unsafe_code)]
                    add(unsafe { pairs::correlate(i, q, codes, phase, step) });
                }
            }
        }
        return sums;
    }
    correlate_scalar(window, codes, phase, step)
}

/// Scalar version of [`correlate`]: one sample after the other, in double precision.
pub fn correlate_scalar(
    window: Window<'_>,
    codes: [&[u8]; 3],
    phase: f64,
    step: f64,
) -> [Complex32; 3] {
    let rotation = Complex64::cis(-TAU * step);
    let mut carrier = Complex64::cis(-TAU * phase);
    let mut sums = [Complex64::ZERO; 3];
    for n in 0..window.len() {
        let mixed = window.sample(n) * carrier;
        for (sum, code) in sums.iter_mut().zip(codes) {
            *sum += mixed * sign(code[n]);
        }
        carrier *= rotation;
    }
    sums.map(|s| Complex32::new(s.re as f32, s.im as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn replicas(len: usize, seed: u64) -> [Vec<u8>; 3] {
        let mut state = seed | 1;
        let mut chip = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            if state & 1 == 0 { 0 } else { 255 }
        };
        std::array::from_fn(|_| (0..len + VECTOR).map(|_| chip()).collect())
    }

    /// Whether fast and plain agree to what a carrier that is constant over `group` samples, whose phase is rounded to
    /// `fraction`, and a recurrence in `f32` can differ.
    fn check(window: Window<'_>, seed: u64, phase: f64, step: f64, group: f64, fraction: f64) {
        let codes = replicas(window.len(), seed);
        let codes = codes.each_ref().map(Vec::as_slice);
        let fast = correlate(window, codes, phase, step);
        let plain = correlate_scalar(window, codes, phase, step);
        let len = window.len();
        let magnitude: f64 = (0..len).map(|n| window.sample(n).norm()).sum();
        let turned = PI * (group - 1.0) * step.abs();
        let rounded = fraction + 2e-7 * (8.0 + len as f64 / 16.0);
        // Where samples end within a group of eight half a step may be left of it.
        let bound = magnitude * (turned + rounded) + f64::from(WORDS_PER_BYTE);
        for tap in 0..3 {
            let difference = f64::from((fast[tap] - plain[tap]).norm());
            assert!(difference <= bound, "{difference} of {bound}, {len} samples");
        }
    }

    /// Where the processor has both.
    #[cfg(target_arch = "x86_64")]
    fn both_sums_of_eight_are_equal(i: &[u8], q: &[u8], seed: u64, phase: f64, step: f64) {
        if is_x86_feature_detected!("avx512bw") && is_x86_feature_detected!("avx512vl") {
            let codes = replicas(i.len(), seed);
            let codes = codes.each_ref().map(Vec::as_slice);
            // SAFETY: the processor has AVX-512, and so AVX2 and FMA.
            #[allow(unsafe_code)]
            let [narrow, wide] = unsafe {
                [
                    eights::correlate(i, q, codes, phase, step),
                    eights::correlate_512(i, q, codes, phase, step),
                ]
            };
            assert_eq!(narrow, wide);
        }
    }

    proptest! {
        #[test]
        fn the_kernels_equal_their_scalar_version(
            samples in prop::collection::vec((-3000i16..3000, -3000i16..3000), 0..3000),
            seed: u64, phase in -10.0f64..10.0, step in -0.02f64..0.02,
        ) {
            let (i, q): (Vec<i16>, Vec<i16>) = samples.into_iter().unzip();
            check(Window::Words([&i, &q]), seed, phase, step, 2.0, 0.0);
            let byte = |x: &i16| ((x + 2048) / 16).clamp(0, 255) as u8;
            let (i, q): (Vec<u8>, Vec<u8>) = (i.iter().map(byte).collect(), q.iter().map(byte).collect());
            // A phasor of 2047 steps is off by at most one half of each.
            check(Window::Bytes([&i, &q]), seed, phase, step, 8.0, 0.5 / 2047.0 * 2f64.sqrt());
            #[cfg(target_arch = "x86_64")]
            both_sums_of_eight_are_equal(&i, &q, seed, phase, step);
        }
    }

    /// Longer than what sums of 32 bits hold, at the largest samples.
    #[test]
    fn long_windows_of_the_largest_samples_do_not_overflow() {
        let len = 100_000;
        let bytes = vec![255u8; len];
        let code = vec![0u8; len + VECTOR];
        let window = Window::Bytes([&bytes, &bytes]);
        let sums = correlate(window, [&code, &code, &code], 0.0, 0.0);
        let expected = 127.5 * 16.0 * len as f64;
        for part in [sums[1].re, sums[1].im] {
            assert!((f64::from(part) / expected - 1.0).abs() < 1e-6, "{part} {expected}");
        }
    }

    #[test]
    fn a_matching_carrier_and_code_add_up_in_phase() {
        let (step, phase) = (2.3e-3, 0.7);
        let code: Vec<u8> =
            (0..4000 + VECTOR).map(|n| if n * 7 % 11 < 5 { 0 } else { 255 }).collect();
        let wave = |n: usize| Complex64::cis(TAU * (phase + step * n as f64)) * sign(code[n]);
        let words = |part: fn(&Complex64) -> f64| -> Vec<i16> {
            (0..4000).map(|n| (1000.0 * part(&wave(n))).round() as i16).collect()
        };
        let bytes = |part: fn(&Complex64) -> f64| -> Vec<u8> {
            (0..4000).map(|n| (62.5 * part(&wave(n)) + 127.5).round() as u8).collect()
        };
        let (i, q) = (words(|z| z.re), words(|z| z.im));
        let (i8, q8) = (bytes(|z| z.re), bytes(|z| z.im));
        // Full amplitude but for what sums of two and of eight lose, (pi n step)^2 / 6, and the rounding of samples: its
        // standard deviation over sqrt(4000).
        for (window, group, rounding) in [
            (Window::Words([&i, &q]), 2.0, 0.29 / 1000.0),
            (Window::Bytes([&i8, &q8]), 8.0, 0.29 / 62.5),
        ] {
            let [_, sum, _] = correlate(window, [&code, &code, &code], phase, step);
            let loss = (PI * group * step).powi(2) / 6.0;
            let bound = 5.0 * rounding / 4000f64.sqrt() + 3e-5;
            let sum = Complex64::new(sum.re.into(), sum.im.into()) / 4e6;
            assert!((sum.re - 1.0 + loss).abs() < bound && sum.im.abs() < bound, "{sum} {loss}");
        }
    }
}
