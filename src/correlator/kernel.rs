//! The correlation kernel, and its scalar version.
//!
//! Work per sample and channel: three multiply-adds of `i16` pairs for each of I and Q; per pair of
//! samples one carrier phasor (a recurrence in `f32`), two conversions and four fused multiply-adds
//! per tap. The carrier is constant over a pair of samples, which costs (pi f / rate)^2 / 2 of the
//! amplitude: 0.00002 at 5 kHz and 2.6 MHz.

use num_complex::{Complex32, Complex64};
use std::f64::consts::TAU;

/// Correlates samples with three replicas after removing a carrier: for each replica c the sum of
/// x\[n\] c\[n\] exp(-j 2 pi (phase + n step)).
///
/// `i` and `q` are the samples; `codes` replicas of at least their length plus 16 entries; `phase`
/// (cycles) that of the carrier at the first sample, `step` (cycles per sample) its advance.
///
/// # Panics
/// When `q` or a replica is shorter than that.
pub fn correlate(
    i: &[i16],
    q: &[i16],
    codes: [&[i16]; 3],
    phase: f64,
    step: f64,
) -> [Complex32; 3] {
    assert!(
        q.len() == i.len() && codes.iter().all(|c| c.len() >= i.len() + 16),
        "correlate: short input"
    );
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        // SAFETY: the processor has AVX2 and FMA, which is all that the function asks for.
        #[allow(unsafe_code)]
        return unsafe { avx2::correlate(i, q, codes, phase, step) };
    }
    correlate_scalar(i, q, codes, phase, step)
}

/// Scalar version of [`correlate`]: one sample after the other, in double precision.
pub fn correlate_scalar(
    i: &[i16],
    q: &[i16],
    codes: [&[i16]; 3],
    phase: f64,
    step: f64,
) -> [Complex32; 3] {
    let rotation = Complex64::cis(-TAU * step);
    let mut carrier = Complex64::cis(-TAU * phase);
    let mut sums = [Complex64::ZERO; 3];
    for n in 0..i.len() {
        let mixed = Complex64::new(i[n].into(), q[n].into()) * carrier;
        for (sum, code) in sums.iter_mut().zip(codes) {
            *sum += mixed * f64::from(code[n]);
        }
        carrier *= rotation;
    }
    sums.map(|s| Complex32::new(s.re as f32, s.im as f32))
}

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod avx2 {
    use super::*;
    use std::arch::x86_64::*;

    /// Samples per iteration: one vector of sixteen `i16`, eight pairs.
    const LANES: usize = 16;

    /// Lengths are checked by the caller: `q` as long as `i`, replicas at least 16 longer.
    #[target_feature(enable = "avx2,fma")]
    pub fn correlate(
        i: &[i16],
        q: &[i16],
        codes: [&[i16]; 3],
        phase: f64,
        step: f64,
    ) -> [Complex32; 3] {
        let pair = Complex64::cis(TAU * (2.0 * step).fract());
        let mut lane = Complex64::cis(TAU * (phase + 0.5 * step).fract());
        let (mut cosines, mut sines) = ([0f32; 8], [0f32; 8]);
        for (cosine, sine) in cosines.iter_mut().zip(&mut sines) {
            (*cosine, *sine) = (lane.re as f32, lane.im as f32);
            lane *= pair;
        }
        let (turn_sin, turn_cos) = (TAU * (step * LANES as f64).fract()).sin_cos();
        // SAFETY: each array holds eight f32, the 32 bytes that are read.
        let (mut cos, mut sin) =
            unsafe { (_mm256_loadu_ps(cosines.as_ptr()), _mm256_loadu_ps(sines.as_ptr())) };
        let (turn_cos, turn_sin) =
            (_mm256_set1_ps(turn_cos as f32), _mm256_set1_ps(turn_sin as f32));
        let mut re = [_mm256_setzero_ps(); 3];
        let mut im = [_mm256_setzero_ps(); 3];

        let mut accumulate = |i: &[i16], q: &[i16], at: usize| {
            // SAFETY: `i` and `q` hold at least sixteen samples, and each replica sixteen entries from
            // `at` on (replicas are 16 longer than the samples), the 32 bytes that are read.
            let load = |x: &[i16]| unsafe { _mm256_loadu_si256(x.as_ptr().cast()) };
            debug_assert!(i.len() >= LANES && q.len() >= LANES);
            let (x, y) = (load(i), load(q));
            for tap in 0..3 {
                debug_assert!(codes[tap].len() >= at + LANES);
                // SAFETY: as above.
                let code = unsafe { _mm256_loadu_si256(codes[tap].as_ptr().add(at).cast()) };
                let x = _mm256_cvtepi32_ps(_mm256_madd_epi16(x, code));
                let y = _mm256_cvtepi32_ps(_mm256_madd_epi16(y, code));
                re[tap] = _mm256_fmadd_ps(x, cos, _mm256_fmadd_ps(y, sin, re[tap]));
                im[tap] = _mm256_fmadd_ps(y, cos, _mm256_fnmadd_ps(x, sin, im[tap]));
            }
            let next = _mm256_fmsub_ps(cos, turn_cos, _mm256_mul_ps(sin, turn_sin));
            sin = _mm256_fmadd_ps(sin, turn_cos, _mm256_mul_ps(cos, turn_sin));
            cos = next;
        };
        let whole = i.len() / LANES * LANES;
        for at in (0..whole).step_by(LANES) {
            accumulate(&i[at..at + LANES], &q[at..at + LANES], at);
        }
        if whole < i.len() {
            let (mut i_tail, mut q_tail) = ([0i16; LANES], [0i16; LANES]);
            i_tail[..i.len() - whole].copy_from_slice(&i[whole..]);
            q_tail[..i.len() - whole].copy_from_slice(&q[whole..]);
            accumulate(&i_tail, &q_tail, whole);
        }
        std::array::from_fn(|tap| Complex32::new(sum(re[tap]), sum(im[tap])))
    }

    #[target_feature(enable = "avx2,fma")]
    fn sum(v: __m256) -> f32 {
        let half = _mm_add_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps::<1>(v));
        let quarter = _mm_add_ps(half, _mm_movehl_ps(half, half));
        _mm_cvtss_f32(_mm_add_ss(quarter, _mm_shuffle_ps::<1>(quarter, quarter)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_vector_kernel_equals_its_scalar_version(
            samples in proptest::collection::vec((-3000i16..3000, -3000i16..3000), 0..3000),
            seed: u64, phase in -10.0f64..10.0, step in -0.004f64..0.004,
        ) {
            let (i, q): (Vec<i16>, Vec<i16>) = samples.into_iter().unzip();
            let mut state = seed | 1;
            let mut chip = || { state ^= state << 13; state ^= state >> 7; state ^= state << 17; 1 - 2 * (state & 1) as i16 };
            let codes: [Vec<i16>; 3] = std::array::from_fn(|_| (0..i.len() + 16).map(|_| chip()).collect());
            let codes = [&codes[0][..], &codes[1][..], &codes[2][..]];
            let fast = correlate(&i, &q, codes, phase, step);
            let plain = correlate_scalar(&i, &q, codes, phase, step);
            // Each sample's phase is off by at most half a step (pi step rad), never in the same
            // direction for both of a pair; f32 rounding grows with the length of the recurrence.
            let magnitude: f64 = i.iter().zip(&q).map(|(&i, &q)| f64::from(i).hypot(f64::from(q))).sum();
            let bound = magnitude * (std::f64::consts::PI * step.abs() + 2e-7 * (8.0 + i.len() as f64 / 16.0)) + 1e-3;
            for tap in 0..3 {
                prop_assert!(f64::from((fast[tap] - plain[tap]).norm()) <= bound);
            }
        }
    }

    #[test]
    fn a_matching_carrier_and_code_add_up_in_phase() {
        let (step, phase) = (2.3e-3, 0.7);
        let code: Vec<i16> = (0..4016).map(|n| if n * 7 % 11 < 5 { 1 } else { -1 }).collect();
        let wave = |n: usize| {
            Complex64::cis(TAU * (phase + step * n as f64)) * 1000.0 * f64::from(code[n])
        };
        let (i, q): (Vec<i16>, Vec<i16>) =
            (0..4000).map(|n| (wave(n).re.round() as i16, wave(n).im.round() as i16)).unzip();
        let sums = correlate(&i, &q, [&code, &code, &code], phase, step);
        // Full amplitude except for the pairing loss (2.6e-5) and rounding of samples (0.29/sqrt(4000)).
        assert!(
            (sums[1].re / 4e6 - 1.0).abs() < 1e-4 && (sums[1].im / 4e6).abs() < 1e-4,
            "{}",
            sums[1]
        );
    }
}
