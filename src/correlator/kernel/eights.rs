//! Sums of eight bytes without a multiplication, then the carrier.
//!
//! A byte b of the value b - 127.5 becomes 255 - b, the byte of the negative value, by an exclusive or with 255: replicas
//! are masks, and `psadbw` against zero adds eight bytes. Eight values are the sum less 1020.
#![allow(unsafe_code)]

use super::WORDS_PER_BYTE;
use num_complex::{Complex32, Complex64};
use std::arch::x86_64::*;
use std::f64::consts::TAU;

/// Samples per iteration: two vectors of 32 bytes, eight sums.
const LANES: usize = 64;
/// Magnitude of the carrier's phasors.
const MAGNITUDE: f32 = 2047.0;
/// Samples at most: 512 iterations that add up to 1020 times 2 times the magnitude stay below 2^31.
pub const MOST_SAMPLES: usize = 512 * LANES;
/// The 32-bit lane that holds each sum once packed.
const PACKED: [usize; 8] = [0, 1, 4, 5, 2, 3, 6, 7];

/// The carrier at the middles of eight times eight samples, and its turn from one 64 samples to the next: cosines and
/// sines, those of the sums in this order.
fn phasors(phase: f64, step: f64, lanes: [usize; 8]) -> ([[f32; 8]; 2], Complex64) {
    let eight = Complex64::cis(TAU * (8.0 * step).fract());
    let mut at = Complex64::cis(TAU * (phase + 3.5 * step).fract()) * f64::from(MAGNITUDE);
    let mut parts = [[0f32; 8]; 2];
    for lane in lanes {
        (parts[0][lane], parts[1][lane]) = (at.re as f32, at.im as f32);
        at *= eight;
    }
    (parts, eight.powu(8))
}

/// Lengths are checked by the caller: `q` as long as `i`, at most [`MOST_SAMPLES`], replicas at least 64 longer.
#[target_feature(enable = "avx2,fma")]
pub fn correlate(i: &[u8], q: &[u8], codes: [&[u8]; 3], phase: f64, step: f64) -> [Complex32; 3] {
    let ([cosines, sines], turn) = phasors(phase, step, PACKED);
    // SAFETY: each array holds eight f32, the 32 bytes that are read.
    let (mut cos, mut sin) =
        unsafe { (_mm256_loadu_ps(cosines.as_ptr()), _mm256_loadu_ps(sines.as_ptr())) };
    let (turn_cos, turn_sin) = (_mm256_set1_ps(turn.re as f32), _mm256_set1_ps(turn.im as f32));
    let zero = _mm256_setzero_si256();
    let bias = _mm256_set1_epi16(1020);
    let low = _mm256_set1_epi32(0xffff);
    let negative_low = _mm256_set1_epi32(0x0001_ffff);
    let mut re = [zero; 3];
    let mut im = [zero; 3];

    let load = |x: &[u8]| {
        let x = &x[..LANES];
        // SAFETY: the slice holds 64 bytes, all that are read.
        unsafe {
            [_mm256_loadu_si256(x.as_ptr().cast()), _mm256_loadu_si256(x.as_ptr().add(32).cast())]
        }
    };
    // The last samples, and which of 64 they are: after the replica the others count as 127 and 128 in turn.
    let whole = i.len() / LANES * LANES;
    let rest = i.len() - whole;
    let (mut i_tail, mut q_tail, mut valid) = ([0u8; LANES], [0u8; LANES], [0u8; LANES]);
    i_tail[..rest].copy_from_slice(&i[whole..]);
    q_tail[..rest].copy_from_slice(&q[whole..]);
    valid[..rest].fill(255);
    let valid = load(&valid);
    let neutral = _mm256_set1_epi16(0x807f_u16 as i16);

    for at in (0..i.len()).step_by(LANES) {
        let is_tail = at == whole;
        let (x, y) = match is_tail {
            false => (load(&i[at..]), load(&q[at..])),
            true => (load(&i_tail), load(&q_tail)),
        };
        let (c, s) = (_mm256_cvtps_epi32(cos), _mm256_cvtps_epi32(sin));
        // Pairs (c, s) and (-s, c) of words.
        let carrier_re = _mm256_or_si256(_mm256_and_si256(c, low), _mm256_slli_epi32::<16>(s));
        let carrier_im = _mm256_or_si256(_mm256_and_si256(s, low), _mm256_slli_epi32::<16>(c));
        let carrier_im = _mm256_sign_epi16(carrier_im, negative_low);
        for tap in 0..3 {
            let mask = load(&codes[tap][at..]);
            let sums = |part: [__m256i; 2]| {
                let mut signed = [0, 1].map(|k| _mm256_xor_si256(part[k], mask[k]));
                if is_tail {
                    signed = [0, 1].map(|k| _mm256_blendv_epi8(neutral, signed[k], valid[k]));
                }
                let [first, second] = signed.map(|s| _mm256_sad_epu8(s, zero));
                _mm256_packus_epi32(first, second)
            };
            let pairs = _mm256_or_si256(sums(x), _mm256_slli_epi32::<16>(sums(y)));
            let pairs = _mm256_sub_epi16(pairs, bias);
            re[tap] = _mm256_add_epi32(re[tap], _mm256_madd_epi16(pairs, carrier_re));
            im[tap] = _mm256_add_epi32(im[tap], _mm256_madd_epi16(pairs, carrier_im));
        }
        let next = _mm256_fmsub_ps(cos, turn_cos, _mm256_mul_ps(sin, turn_sin));
        sin = _mm256_fmadd_ps(sin, turn_cos, _mm256_mul_ps(cos, turn_sin));
        cos = next;
    }
    std::array::from_fn(|tap| Complex32::new(total(sum(re[tap])), total(sum(im[tap]))))
}

/// The lanes together, which may exceed 32 bits.
#[target_feature(enable = "avx2")]
fn sum(v: __m256i) -> i64 {
    let mut lanes = [0i32; 8];
    // SAFETY: the array holds 32 bytes, all that are written.
    unsafe { _mm256_storeu_si256(lanes.as_mut_ptr().cast(), v) };
    lanes.iter().map(|&lane| i64::from(lane)).sum()
}

/// A sum in units of words.
fn total(sum: i64) -> f32 {
    (sum as f64 * f64::from(WORDS_PER_BYTE) / f64::from(MAGNITUDE)) as f32
}

/// The same in vectors of 64 bytes, whose eight sums lie in lanes of 64 bits: one multiply-add gives real and imaginary
/// part.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx2,fma")]
pub fn correlate_512(
    i: &[u8],
    q: &[u8],
    codes: [&[u8]; 3],
    phase: f64,
    step: f64,
) -> [Complex32; 3] {
    let ([cosines, sines], turn) = phasors(phase, step, [0, 1, 2, 3, 4, 5, 6, 7]);
    // SAFETY: each array holds eight f32, the 32 bytes that are read.
    let (mut cos, mut sin) =
        unsafe { (_mm256_loadu_ps(cosines.as_ptr()), _mm256_loadu_ps(sines.as_ptr())) };
    let (turn_cos, turn_sin) = (_mm256_set1_ps(turn.re as f32), _mm256_set1_ps(turn.im as f32));
    let zero = _mm512_setzero_si512();
    let bias = _mm512_set1_epi16(1020);
    let neutral = _mm512_set1_epi16(0x807f_u16 as i16);
    let low = _mm256_set1_epi32(0xffff);
    let negative_low = _mm256_set1_epi32(0x0001_ffff);
    let mut sums = [zero; 3];
    for at in (0..i.len()).step_by(LANES) {
        let valid = u64::MAX >> (64 - (i.len() - at).min(64));
        let load = |x: &[u8]| {
            debug_assert!(x.len() - at >= valid.count_ones() as usize);
            // SAFETY: the valid bytes, which alone are read, are within the slice.
            unsafe { _mm512_maskz_loadu_epi8(valid, x.as_ptr().add(at).cast()) }
        };
        let (x, y) = (load(i), load(q));
        let (c, s) = (_mm256_cvtps_epi32(cos), _mm256_cvtps_epi32(sin));
        // Words (c, s, -s, c).
        let re = _mm256_or_si256(_mm256_and_si256(c, low), _mm256_slli_epi32::<16>(s));
        let im = _mm256_or_si256(_mm256_and_si256(s, low), _mm256_slli_epi32::<16>(c));
        let im = _mm256_sign_epi16(im, negative_low);
        let carrier = _mm512_or_si512(
            _mm512_cvtepu32_epi64(re),
            _mm512_slli_epi64::<32>(_mm512_cvtepu32_epi64(im)),
        );
        for tap in 0..3 {
            let mask = load(codes[tap]);
            let eight = |part: __m512i| {
                let signed = _mm512_mask_mov_epi8(neutral, valid, _mm512_xor_si512(part, mask));
                _mm512_sad_epu8(signed, zero)
            };
            let pair = _mm512_or_si512(eight(x), _mm512_slli_epi64::<16>(eight(y)));
            let pairs = _mm512_or_si512(pair, _mm512_slli_epi64::<32>(pair));
            let product = _mm512_madd_epi16(_mm512_sub_epi16(pairs, bias), carrier);
            sums[tap] = _mm512_add_epi32(sums[tap], product);
        }
        let next = _mm256_fmsub_ps(cos, turn_cos, _mm256_mul_ps(sin, turn_sin));
        sin = _mm256_fmadd_ps(sin, turn_cos, _mm256_mul_ps(cos, turn_sin));
        cos = next;
    }
    sums.map(|v| {
        let mut lanes = [0i32; 16];
        // SAFETY: the array holds 64 bytes, all that are written.
        unsafe { _mm512_storeu_si512(lanes.as_mut_ptr().cast(), v) };
        let part = |first: usize| lanes[first..].iter().step_by(2).map(|&x| i64::from(x)).sum();
        Complex32::new(total(part(0)), total(part(1)))
    })
}
