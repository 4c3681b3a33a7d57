//! Correlations of sixteen codes side by side: one lane of a vector each, so that no value moves between lanes.
//!
//! Counted work for sixteen correlations of N bins: N products, some 5 N log2 N operations on vectors (of 16 numbers with AVX-512, of 8 with AVX2) in passes of radix 4,
//! 5, 3 and 2, and N powers. The first pass takes the products as they are made. Passes split what is long into parts
//! that follow each other (decimation in frequency, in place); parts that fit the first-level cache are transformed with
//! their values in order (Stockham).

use num_complex::{Complex32, Complex64};
use std::f64::consts::TAU;

/// Codes side by side.
pub(super) const LANES: usize = 16;

/// A complex number of each code.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(128))]
pub(super) struct Lanes {
    re: [f32; LANES],
    im: [f32; LANES],
}

impl Lanes {
    pub(super) const ZERO: Self = Self { re: [0.0; LANES], im: [0.0; LANES] };

    pub(super) fn set(&mut self, lane: usize, value: Complex32) {
        (self.re[lane], self.im[lane]) = (value.re, value.im);
    }
}

/// One pass of a transform of `parts` times `radix` values, `stride` of them side by side.
#[derive(Clone, Debug)]
struct Pass {
    radix: usize,
    parts: usize,
    stride: usize,
    /// exp(j 2 pi p k / (parts radix)) of each part p, by k.
    twiddles: Vec<Complex32>,
}

impl Pass {
    fn new(radix: usize, length: usize, stride: usize) -> Self {
        let parts = length / radix;
        let twiddle = |p: usize, k: usize| {
            let turn = Complex64::cis(TAU * (p * k % length) as f64 / length as f64);
            Complex32::new(turn.re as f32, turn.im as f32)
        };
        let twiddles = (0..parts).flat_map(|p| (0..radix).map(move |k| twiddle(p, k))).collect();
        Self { radix, parts, stride, twiddles }
    }

    /// By part.
    #[inline(always)]
    fn twiddles<const R: usize>(&self) -> &[[Complex32; R]] {
        self.twiddles.as_chunks().0
    }
}

/// Values of a part of which two fit the first-level cache.
const SHORT: usize = 160;

/// Inverse transforms of one length, a product of 2, 3 and 5, of sixteen products with codes at a time.
#[derive(Clone, Debug)]
pub(super) struct LaneTransform {
    /// Passes that split the whole, and then the parts as long as they are long.
    splits: Vec<Pass>,
    /// Those of a short part.
    rest: Vec<Pass>,
    /// The bin of the first value of each short part; the others are as many bins apart as there are parts.
    first_bins: Vec<usize>,
}

impl LaneTransform {
    pub(super) fn new(length: usize) -> Self {
        let radix_of = |n: usize| [4, 5, 3, 2].into_iter().find(|r| n.is_multiple_of(*r));
        let mut splits = vec![Pass::new(radix_of(length).unwrap_or(1), length, 1)];
        let mut left = splits[0].parts;
        while let Some(radix) = radix_of(left).filter(|_| left > SHORT) {
            splits.push(Pass::new(radix, left, 1));
            left /= radix;
        }
        let (mut first_bins, mut step) = (vec![0], 1);
        for Pass { radix, .. } in &splits {
            let within = |bin: &usize| (0..*radix).map(|k| bin + k * step).collect::<Vec<_>>();
            first_bins = first_bins.iter().flat_map(within).collect();
            step *= radix;
        }
        let (mut stride, mut rest) = (1, Vec::new());
        while let Some(radix) = radix_of(left) {
            rest.push(Pass::new(radix, left, stride));
            (left, stride) = (left / radix, stride * radix);
        }
        Self { splits, rest, first_bins }
    }

    /// Adds to `power` (at their [places](Self::place), `advance` bins later) the powers of the inverse transform of `codes` times `spectrum`.
    pub(super) fn add_power(
        &self,
        codes: &[Lanes],
        spectrum: &[Complex32],
        advance: usize,
        work: &mut Work,
        power: &mut [[f32; LANES]],
    ) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx512f") {
            // SAFETY: the processor has AVX-512F, which is all that the function asks for.
            #[allow(unsafe_code)]
            return unsafe { x86::add_power_512(self, codes, spectrum, advance, work, power) };
        }
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the processor has AVX2 and FMA, which is all that the function asks for.
            #[allow(unsafe_code)]
            return unsafe { x86::add_power_256(self, codes, spectrum, advance, work, power) };
        }
        self.add_power_by::<f32>(codes, spectrum, advance, work, power);
    }

    #[inline(always)]
    fn add_power_by<V: Vector>(
        &self,
        codes: &[Lanes],
        spectrum: &[Complex32],
        advance: usize,
        Work { all, part }: &mut Work,
        power: &mut [[f32; LANES]],
    ) {
        let (first, splits) = (&self.splits[0], &self.splits[1..]);
        match first.radix {
            2 => first_pass::<V, 2>(first, codes, spectrum, all),
            3 => first_pass::<V, 3>(first, codes, spectrum, all),
            4 => first_pass::<V, 4>(first, codes, spectrum, all),
            5 => first_pass::<V, 5>(first, codes, spectrum, all),
            _ => first_pass::<V, 1>(first, codes, spectrum, all),
        }
        let of_part = self.first_bins.len() / first.radix;
        let parts = all.chunks_exact_mut(first.parts).zip(self.first_bins.chunks(of_part));
        // One part after the other, so that each stays in the second-level cache.
        for (values, first_bins) in parts {
            for split in splits {
                for values in values.chunks_exact_mut(split.radix * split.parts) {
                    match split.radix {
                        2 => split_pass::<V, 2>(split, values),
                        3 => split_pass::<V, 3>(split, values),
                        4 => split_pass::<V, 4>(split, values),
                        _ => split_pass::<V, 5>(split, values),
                    }
                }
            }
            for (values, bin) in values.chunks_exact_mut(part.len()).zip(first_bins) {
                let (mut from, mut to) = (values, &mut part[..]);
                for pass in &self.rest {
                    match pass.radix {
                        2 => one_pass::<V, 2>(pass, from, to),
                        3 => one_pass::<V, 3>(pass, from, to),
                        4 => one_pass::<V, 4>(pass, from, to),
                        _ => one_pass::<V, 5>(pass, from, to),
                    }
                    std::mem::swap(&mut from, &mut to);
                }
                let count = self.first_bins.len();
                let (residue, turn) = ((bin + advance) % count, (bin + advance) / count);
                let power = &mut power[residue * from.len()..(residue + 1) * from.len()];
                let turn = turn % from.len();
                let (early, late) = from.split_at(from.len() - turn);
                add_powers::<V>(early, &mut power[turn..]);
                add_powers::<V>(late, &mut power[..turn]);
            }
        }
    }

    /// Where the powers of a bin are: bins that are as far apart as there are short parts lie side by side.
    pub(super) fn place(&self, bin: usize) -> usize {
        let count = self.first_bins.len();
        bin % count * self.short() + bin / count
    }

    fn short(&self) -> usize {
        self.splits.last().map_or(1, |last| last.parts)
    }
}

/// Memory of a transform.
pub(super) struct Work {
    all: Vec<Lanes>,
    part: Vec<Lanes>,
}

impl Work {
    pub(super) fn new(transform: &LaneTransform) -> Self {
        let short = transform.short();
        let length = short * transform.first_bins.len();
        Self { all: vec![Lanes::ZERO; length], part: vec![Lanes::ZERO; short] }
    }
}

/// As many real numbers as a processor computes with at once: a part of the lanes.
trait Vector: Copy {
    const WIDTH: usize;
    /// From the first of these numbers.
    fn load(from: &[f32]) -> Self;
    fn store(self, to: &mut [f32]);
    fn splat(value: f32) -> Self;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    /// The product with `factor`, plus `addend`.
    fn mul_add(self, factor: Self, addend: Self) -> Self;
}

/// The scalar version.
impl Vector for f32 {
    const WIDTH: usize = 1;
    fn load(from: &[f32]) -> Self {
        from[0]
    }
    fn store(self, to: &mut [f32]) {
        to[0] = self;
    }
    fn splat(value: f32) -> Self {
        value
    }
    fn add(self, other: Self) -> Self {
        self + other
    }
    fn sub(self, other: Self) -> Self {
        self - other
    }
    fn mul(self, other: Self) -> Self {
        self * other
    }
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        self * factor + addend
    }
}

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod x86 {
    use super::*;
    use std::arch::x86_64::*;

    /// A vector type, for functions alone that enable its features, and the function that does.
    macro_rules! vector {
        ($name:ident, $inner:ty, $width:literal, $features:literal, $function:ident,
         $load:ident, $store:ident, $splat:ident, $add:ident, $sub:ident, $mul:ident, $fmadd:ident) => {
            #[derive(Clone, Copy)]
            struct $name($inner);

            // SAFETY, of all: made and used within the function below alone, which enables the features; slices are
            // checked to hold what is read and written.
            impl Vector for $name {
                const WIDTH: usize = $width;
                #[inline(always)]
                fn load(from: &[f32]) -> Self {
                    Self(unsafe { $load(from[..$width].as_ptr()) })
                }
                #[inline(always)]
                fn store(self, to: &mut [f32]) {
                    unsafe { $store(to[..$width].as_mut_ptr(), self.0) }
                }
                #[inline(always)]
                fn splat(value: f32) -> Self {
                    Self(unsafe { $splat(value) })
                }
                #[inline(always)]
                fn add(self, other: Self) -> Self {
                    Self(unsafe { $add(self.0, other.0) })
                }
                #[inline(always)]
                fn sub(self, other: Self) -> Self {
                    Self(unsafe { $sub(self.0, other.0) })
                }
                #[inline(always)]
                fn mul(self, other: Self) -> Self {
                    Self(unsafe { $mul(self.0, other.0) })
                }
                #[inline(always)]
                fn mul_add(self, factor: Self, addend: Self) -> Self {
                    Self(unsafe { $fmadd(self.0, factor.0, addend.0) })
                }
            }

            #[target_feature(enable = $features)]
            pub(super) fn $function(
                transform: &LaneTransform,
                codes: &[Lanes],
                spectrum: &[Complex32],
                advance: usize,
                work: &mut Work,
                power: &mut [[f32; LANES]],
            ) {
                transform.add_power_by::<$name>(codes, spectrum, advance, work, power);
            }
        };
    }

    vector!(
        Eight,
        __m256,
        8,
        "avx2,fma",
        add_power_256,
        _mm256_loadu_ps,
        _mm256_storeu_ps,
        _mm256_set1_ps,
        _mm256_add_ps,
        _mm256_sub_ps,
        _mm256_mul_ps,
        _mm256_fmadd_ps
    );
    vector!(
        Sixteen,
        __m512,
        16,
        "avx512f",
        add_power_512,
        _mm512_loadu_ps,
        _mm512_storeu_ps,
        _mm512_set1_ps,
        _mm512_add_ps,
        _mm512_sub_ps,
        _mm512_mul_ps,
        _mm512_fmadd_ps
    );
}

/// Complex numbers of a part of the lanes.
#[derive(Clone, Copy)]
struct Values<V> {
    re: V,
    im: V,
}

impl<V: Vector> Values<V> {
    #[inline(always)]
    fn load(from: &Lanes, lane: usize) -> Self {
        Self { re: V::load(&from.re[lane..]), im: V::load(&from.im[lane..]) }
    }

    #[inline(always)]
    fn store(self, to: &mut Lanes, lane: usize) {
        self.re.store(&mut to.re[lane..]);
        self.im.store(&mut to.im[lane..]);
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { re: self.re.add(other.re), im: self.im.add(other.im) }
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { re: self.re.sub(other.re), im: self.im.sub(other.im) }
    }

    /// The sum with j times another.
    #[inline(always)]
    fn add_j(self, other: Self) -> Self {
        Self { re: self.re.sub(other.im), im: self.im.add(other.re) }
    }

    /// The difference from j times another.
    #[inline(always)]
    fn sub_j(self, other: Self) -> Self {
        Self { re: self.re.add(other.im), im: self.im.sub(other.re) }
    }

    #[inline(always)]
    fn scaled(self, factor: f32) -> Self {
        let factor = V::splat(factor);
        Self { re: self.re.mul(factor), im: self.im.mul(factor) }
    }

    /// The sum with another times a real number.
    #[inline(always)]
    fn add_times(self, other: Self, factor: f32) -> Self {
        let factor = V::splat(factor);
        Self { re: other.re.mul_add(factor, self.re), im: other.im.mul_add(factor, self.im) }
    }

    #[inline(always)]
    fn times(self, w: Complex32) -> Self {
        let (re, im, less) = (V::splat(w.re), V::splat(w.im), V::splat(-w.im));
        Self {
            re: self.re.mul_add(re, self.im.mul(less)),
            im: self.re.mul_add(im, self.im.mul(re)),
        }
    }
}

/// Sums of a[j] exp(j 2 pi j k / R) over j.
#[inline(always)]
fn butterfly<V: Vector, const R: usize>(a: [Values<V>; R]) -> [Values<V>; R] {
    const COS_72: f32 = 0.309_017;
    const COS_144: f32 = -0.809_017;
    const SIN_72: f32 = 0.951_056_5;
    const SIN_144: f32 = 0.587_785_25;
    const SIN_120: f32 = 0.866_025_4;
    let mut b = a;
    match R {
        2 => (b[0], b[1]) = (a[0].add(a[1]), a[0].sub(a[1])),
        3 => {
            let sum = a[1].add(a[2]);
            let even = a[0].add_times(sum, -0.5);
            let odd = a[1].sub(a[2]).scaled(SIN_120);
            (b[0], b[1], b[2]) = (a[0].add(sum), even.add_j(odd), even.sub_j(odd));
        }
        4 => {
            let (even, odd) = (a[0].add(a[2]), a[1].add(a[3]));
            let (other, turned) = (a[0].sub(a[2]), a[1].sub(a[3]));
            (b[0], b[1]) = (even.add(odd), other.add_j(turned));
            (b[2], b[3]) = (even.sub(odd), other.sub_j(turned));
        }
        5 => {
            let (sum_1, sum_2) = (a[1].add(a[4]), a[2].add(a[3]));
            let (less_1, less_2) = (a[1].sub(a[4]), a[2].sub(a[3]));
            let even_1 = a[0].add_times(sum_1, COS_72).add_times(sum_2, COS_144);
            let even_2 = a[0].add_times(sum_1, COS_144).add_times(sum_2, COS_72);
            let odd_1 = less_1.scaled(SIN_72).add_times(less_2, SIN_144);
            let odd_2 = less_1.scaled(SIN_144).add_times(less_2, -SIN_72);
            b[0] = a[0].add(sum_1).add(sum_2);
            (b[1], b[4]) = (even_1.add_j(odd_1), even_1.sub_j(odd_1));
            (b[2], b[3]) = (even_2.add_j(odd_2), even_2.sub_j(odd_2));
        }
        _ => {}
    }
    b
}

/// `R` parts of equal length.
#[inline(always)]
fn split<T, const R: usize>(values: &[T], parts: usize) -> [&[T]; R] {
    let mut slices = [&values[..parts]; R];
    for j in 1..R {
        slices[j] = &values[j * parts..][..parts];
    }
    slices
}

/// The same, to be written.
#[inline(always)]
fn split_mut<const R: usize>(mut values: &mut [Lanes], parts: usize) -> [&mut [Lanes]; R] {
    std::array::from_fn(|_| {
        let (part, rest) = std::mem::take(&mut values).split_at_mut(parts);
        values = rest;
        part
    })
}

#[inline(always)]
fn first_pass<V: Vector, const R: usize>(
    pass: &Pass,
    codes: &[Lanes],
    spectrum: &[Complex32],
    out: &mut [Lanes],
) {
    let parts = pass.parts;
    let (codes, spectrum) = (split::<_, R>(codes, parts), split::<_, R>(spectrum, parts));
    let (twiddles, out) = (pass.twiddles::<R>(), split_mut::<R>(out, parts));
    for p in 0..parts {
        for lane in (0..LANES / V::WIDTH).map(|k| k * V::WIDTH) {
            let mut a = [Values::<V>::load(&codes[0][p], lane).times(spectrum[0][p]); R];
            for j in 1..R {
                a[j] = Values::load(&codes[j][p], lane).times(spectrum[j][p]);
            }
            let b = butterfly(a);
            b[0].store(&mut out[0][p], lane);
            for k in 1..R {
                b[k].times(twiddles[p][k]).store(&mut out[k][p], lane);
            }
        }
    }
}

/// In place: part k of the values is what a pass leaves for the bins k, k + R, ...
#[inline(always)]
fn split_pass<V: Vector, const R: usize>(pass: &Pass, values: &mut [Lanes]) {
    let parts = pass.parts;
    let (twiddles, values) = (pass.twiddles::<R>(), split_mut::<R>(values, parts));
    for p in 0..parts {
        for lane in (0..LANES / V::WIDTH).map(|k| k * V::WIDTH) {
            let mut a = [Values::<V>::load(&values[0][p], lane); R];
            for j in 1..R {
                a[j] = Values::load(&values[j][p], lane);
            }
            let b = butterfly(a);
            b[0].store(&mut values[0][p], lane);
            for k in 1..R {
                b[k].times(twiddles[p][k]).store(&mut values[k][p], lane);
            }
        }
    }
}

#[inline(always)]
fn one_pass<V: Vector, const R: usize>(pass: &Pass, from: &[Lanes], to: &mut [Lanes]) {
    let Pass { parts, stride, .. } = *pass;
    let (twiddles, from) = (pass.twiddles::<R>(), split::<_, R>(from, parts * stride));
    let to = to.chunks_exact_mut(R * stride);
    for ((p, to), twiddles) in to.enumerate().zip(&twiddles[..parts]) {
        let to = split_mut::<R>(to, stride);
        let from = from.map(|part| &part[p * stride..][..stride]);
        for q in 0..stride {
            for lane in (0..LANES / V::WIDTH).map(|k| k * V::WIDTH) {
                let mut a = [Values::<V>::load(&from[0][q], lane); R];
                for j in 1..R {
                    a[j] = Values::load(&from[j][q], lane);
                }
                let b = butterfly(a);
                b[0].store(&mut to[0][q], lane);
                for k in 1..R {
                    b[k].times(twiddles[k]).store(&mut to[k][q], lane);
                }
            }
        }
    }
}

#[inline(always)]
fn add_powers<V: Vector>(values: &[Lanes], power: &mut [[f32; LANES]]) {
    for (value, power) in values.iter().zip(power) {
        for lane in (0..LANES / V::WIDTH).map(|k| k * V::WIDTH) {
            let Values { re, im } = Values::<V>::load(value, lane);
            let sum = V::load(&power[lane..]);
            re.mul_add(re, im.mul_add(im, sum)).store(&mut power[lane..]);
        }
    }
}

/// The highest of each lane, and the sum.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "x86_64+avx2+fma",
    "aarch64+neon"
))]
pub(super) fn peaks_and_sums(power: &[[f32; LANES]]) -> ([f32; LANES], [f32; LANES]) {
    let (mut highest, mut total) = ([0f32; LANES], [0f32; LANES]);
    // Of few at a time, for the sake of rounding.
    for run in power.chunks(128) {
        let mut sums = [0f32; LANES];
        for bin in run {
            for k in 0..LANES {
                highest[k] = highest[k].max(bin[k]);
                sums[k] += bin[k];
            }
        }
        total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
    }
    (highest, total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use sdr_rx_linalg::inverse_transform;

    #[test]
    fn transforms_side_by_side_equal_those_of_a_library() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut value =
            || Complex32::new(random.random::<f32>() - 0.5, random.random::<f32>() - 0.5);
        for length in [1, 2, 3, 5, 12, 60, 2048, 2592, 3750, 4000, 5000, 16_384] {
            let spectrum: Vec<Complex32> = (0..length).map(|_| value()).collect();
            let codes: Vec<Vec<Complex32>> =
                (0..LANES).map(|_| (0..length).map(|_| value()).collect()).collect();
            let mut lanes = vec![Lanes::ZERO; length];
            for (lane, code) in codes.iter().enumerate() {
                lanes.iter_mut().zip(code).for_each(|(lanes, c)| lanes.set(lane, *c));
            }
            let transform = LaneTransform::new(length);
            let mut power = vec![[1f32; LANES]; length];
            let advance = length / 3;
            let mut work = Work::new(&transform);
            transform.add_power(&lanes, &spectrum, advance, &mut work, &mut power);
            let mut plain = vec![[1f32; LANES]; length];
            transform.add_power_by::<f32>(&lanes, &spectrum, advance, &mut work, &mut plain);
            let (highest, sums) = peaks_and_sums(&power);
            for (lane, code) in codes.iter().enumerate() {
                let mut product: Vec<_> = spectrum.iter().zip(code).map(|(a, b)| a * b).collect();
                inverse_transform(length).process(&mut product);
                let expected =
                    |bin: usize| 1.0 + product[(bin + length - advance) % length].norm_sqr();
                // Of values of variance length / 36, rounded at each of some 14 passes.
                let bound = length as f32 * 1e-5 + 1e-5;
                for bin in 0..length {
                    let place = transform.place(bin);
                    let difference = power[place][lane] - expected(bin);
                    assert!(difference.abs() < bound, "{length}: {difference} at {bin}");
                    assert!((power[place][lane] - plain[place][lane]).abs() < bound);
                }
                let most = (0..length).map(expected).fold(0f32, f32::max);
                let sum: f64 = (0..length).map(|bin| f64::from(expected(bin))).sum();
                assert!((highest[lane] - most).abs() < bound);
                assert!((f64::from(sums[lane]) / sum - 1.0).abs() < 1e-5);
            }
        }
    }
}
