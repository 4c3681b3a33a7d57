//! Sums of two samples by multiply-adds of words, then the carrier.
#![allow(unsafe_code)]

use num_complex::{Complex32, Complex64};
use std::arch::x86_64::*;
use std::f64::consts::TAU;

/// Samples per iteration: one vector of sixteen `i16`, eight pairs.
const LANES: usize = 16;

/// Lengths are checked by the caller: `q` as long as `i`, replicas at least 16 longer.
#[target_feature(enable = "avx2,fma")]
pub fn correlate(i: &[i16], q: &[i16], codes: [&[u8]; 3], phase: f64, step: f64) -> [Complex32; 3] {
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
    let (turn_cos, turn_sin) = (_mm256_set1_ps(turn_cos as f32), _mm256_set1_ps(turn_sin as f32));
    let one = _mm256_set1_epi16(1);
    let mut re = [_mm256_setzero_ps(); 3];
    let mut im = [_mm256_setzero_ps(); 3];

    let mut accumulate = |i: &[i16], q: &[i16], at: usize| {
        // SAFETY: `i` and `q` hold at least sixteen samples, the 32 bytes that are read.
        let load = |x: &[i16]| unsafe { _mm256_loadu_si256(x.as_ptr().cast()) };
        debug_assert!(i.len() >= LANES && q.len() >= LANES);
        let (x, y) = (load(i), load(q));
        for tap in 0..3 {
            debug_assert!(codes[tap].len() >= at + LANES);
            // SAFETY: each replica holds sixteen entries from `at` on, as it is 16 longer than the samples.
            let code = unsafe { _mm_loadu_si128(codes[tap].as_ptr().add(at).cast()) };
            let code = _mm256_or_si256(_mm256_cvtepi8_epi16(code), one);
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
