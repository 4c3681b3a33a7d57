//! Sixteen snapshots side by side: the data structures of the fast sparse solvers.
//!
//! A block of sixteen columns is stored as rows of sixteen numbers, all real parts and then all imaginary
//! ones, so that a row of a part is one AVX-512 register (two of AVX2, four of NEON), and no operation
//! crosses columns. The functions here are inlined into kernels that are compiled for several instruction
//! sets; those of single numbers take one part at a time as a flat slice, which compilers vectorise best.

use super::register::Register;
use crate::array::CMat;
use bytemuck::{Pod, Zeroable};
use faer::MatRef;
use num_complex::Complex64;
use std::f32::consts::FRAC_1_SQRT_2;

/// Snapshots of a block.
pub const LANES: usize = 16;
/// Rows of a product that are summed at the same time: 12 accumulators, 2 operands.
const TILE: usize = 6;

/// One part of one row of a block.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
struct Row([f32; LANES]);

/// A block of sixteen columns: real parts, imaginary parts.
#[derive(Clone, Debug)]
pub(super) struct Block([Vec<Row>; 2]);

impl Block {
    /// So many rows of zeros.
    pub fn zeros(rows: usize) -> Self {
        Self([(); 2].map(|()| vec![Row([0.0; LANES]); rows]))
    }

    /// Rows.
    pub fn rows(&self) -> usize {
        self.0[0].len()
    }

    /// Real (0) or imaginary (1) part, row after row.
    #[inline(always)]
    pub fn part(&self, part: usize) -> &[f32] {
        bytemuck::cast_slice(&self.0[part])
    }

    /// Real (0) or imaginary (1) part, mutable.
    #[inline(always)]
    pub fn part_mut(&mut self, part: usize) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.0[part])
    }

    /// The block of columns from `first` on, those beyond the last being 0, times a factor.
    pub fn of(matrix: MatRef<Complex64>, first: usize, factor: f64) -> Self {
        let mut block = Self::zeros(matrix.nrows());
        for row in 0..matrix.nrows() {
            for k in 0..LANES.min(matrix.ncols() - first) {
                let z = matrix[(row, first + k)] * factor;
                block.0[0][row].0[k] = z.re as f32;
                block.0[1][row].0[k] = z.im as f32;
            }
        }
        block
    }

    /// Real and imaginary parts of one row from `lane` on.
    #[inline(always)]
    fn load<R: Register>(&self, row: usize, lane: usize) -> [R; 2] {
        [0, 1].map(|part| R::load(&self.0[part][row].0[lane..]))
    }

    #[inline(always)]
    fn store<R: Register>(&mut self, row: usize, lane: usize, parts: [R; 2]) {
        for (part, x) in self.0.iter_mut().zip(parts) {
            x.store(&mut part[row].0[lane..]);
        }
    }

    /// One entry.
    pub fn at(&self, row: usize, column: usize) -> Complex64 {
        let [re, im] = [0, 1].map(|part| f64::from(self.0[part][row].0[column]));
        Complex64::new(re, im)
    }
}

/// A matrix of so many columns from its blocks.
pub fn matrix<'a>(rows: usize, columns: usize, block: impl Fn(usize) -> &'a Block) -> CMat {
    CMat::from_fn(rows, columns, |row, column| block(column / LANES).at(row, column % LANES))
}

/// Folds mirrored rows m and M-1-m of a block into their even and odd parts, (a + b) / sqrt 2 and -j (a - b) / sqrt 2,
/// which turns responses that are conjugate in mirrored rows into real numbers. A middle row stays.
#[inline(always)]
pub fn fold<R: Register>(block: &Block, out: &mut Block) {
    let rows = block.rows();
    for m in 0..rows.div_ceil(2) {
        let mirror = rows - 1 - m;
        let scale = R::splat(if m == mirror { 0.5 } else { FRAC_1_SQRT_2 });
        for lane in (0..LANES).step_by(R::WIDTH) {
            let [a, b] = [m, mirror].map(|row| block.load::<R>(row, lane));
            let scaled = |x: R| R::splat(0.0).plus(x, scale);
            let even = [0, 1].map(|part| scaled(a[part]).plus(b[part], scale));
            let odd = [scaled(a[1]).minus(b[1], scale), scaled(b[0]).minus(a[0], scale)];
            out.store(mirror, lane, odd);
            out.store(m, lane, even);
        }
    }
}

/// The inverse of [`fold`], in place, of the first `rows` rows.
#[inline(always)]
pub fn unfold<R: Register>(block: &mut Block, rows: usize) {
    let scale = R::splat(FRAC_1_SQRT_2);
    for m in 0..rows / 2 {
        let mirror = rows - 1 - m;
        for lane in (0..LANES).step_by(R::WIDTH) {
            let [even, odd] = [m, mirror].map(|row| block.load::<R>(row, lane));
            let [re, im] = even.map(|x| R::splat(0.0).plus(x, scale));
            block.store(m, lane, [re.minus(odd[1], scale), im.plus(odd[0], scale)]);
            block.store(mirror, lane, [re.plus(odd[1], scale), im.minus(odd[0], scale)]);
        }
    }
}

/// For each number: its modulus less `by`, as a fraction of the modulus, at least `floor`.
#[inline(always)]
pub fn kept(re: &[f32], im: &[f32], by: f32, floor: f32, out: &mut [f32]) {
    for ((re, im), out) in re.iter().zip(im).zip(out) {
        *out = (1.0 - by * inverse_root(re * re + im * im)).max(floor);
    }
}

/// 1 / sqrt(x) to single precision by Newton's iteration from half the exponent (Lomont 2003): operations
/// that vectorise, where a root and a division take three times as long. Of zero: a large finite number.
#[inline(always)]
fn inverse_root(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(0x5f37_5a86_u32.wrapping_sub(x.to_bits() >> 1));
    for _ in 0..3 {
        y *= 1.5 - half * y * y;
    }
    y
}

/// An entry of a matrix: a complex number, or, at half the cost, a real one.
pub trait Entry: Copy + Default {
    /// The nearest to a complex number.
    fn of(z: Complex64) -> Self;
    /// Adds this entry times (re, im) to a sum.
    fn add<R: Register>(self, re: R, im: R, sum: &mut [R; 2]);
}

impl Entry for [f32; 2] {
    fn of(z: Complex64) -> Self {
        [z.re as f32, z.im as f32]
    }

    #[inline(always)]
    fn add<R: Register>(self, re: R, im: R, sum: &mut [R; 2]) {
        let [a, b] = self.map(R::splat);
        sum[0] = sum[0].plus(a, re).minus(b, im);
        sum[1] = sum[1].plus(a, im).plus(b, re);
    }
}

impl Entry for f32 {
    fn of(z: Complex64) -> Self {
        z.re as f32
    }

    #[inline(always)]
    fn add<R: Register>(self, re: R, im: R, sum: &mut [R; 2]) {
        let a = R::splat(self);
        *sum = [sum[0].plus(a, re), sum[1].plus(a, im)];
    }
}

/// A matrix packed for multiplication with blocks: tiles of six rows, column by column within.
#[derive(Clone, Debug)]
pub struct Packed<E> {
    rows: usize,
    columns: usize,
    tiles: Vec<[E; TILE]>,
}

impl<E: Entry> Packed<E> {
    /// Packs the matrix with these entries.
    pub fn new(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> Complex64) -> Self {
        let column = |first: usize, c: usize| {
            std::array::from_fn(|t| match first + t < rows {
                true => E::of(entry(first + t, c)),
                false => E::default(),
            })
        };
        let tiles = (0..rows.div_ceil(TILE))
            .flat_map(|tile| (0..columns).map(move |c| (tile * TILE, c)))
            .map(|(first, c)| column(first, c))
            .collect();
        Self { rows, columns, tiles }
    }

    /// Rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// out = this matrix times a block of `columns` rows. Cost: 4 fused multiply-adds of sixteen numbers for
    /// each complex entry, 2 for each real one.
    #[inline(always)]
    pub fn product<R: Register>(&self, block: &Block, out: &mut Block) {
        let [re, im] = [&block.0[0][..self.columns], &block.0[1][..self.columns]];
        for (number, tile) in self.tiles.chunks_exact(self.columns).enumerate() {
            for first_lane in (0..LANES).step_by(R::WIDTH) {
                let mut sums = [[R::splat(0.0); 2]; TILE];
                for ((entries, re), im) in tile.iter().zip(re).zip(im) {
                    let [re, im] = [re, im].map(|x| R::load(&x.0[first_lane..]));
                    for (sum, entry) in sums.iter_mut().zip(entries) {
                        entry.add(re, im, sum);
                    }
                }
                let first_row = number * TILE;
                for (t, sum) in sums.into_iter().enumerate().take(self.rows - first_row) {
                    for (part, sum) in out.0.iter_mut().zip(sum) {
                        sum.store(&mut part[first_row + t].0[first_lane..]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::register::{Sweep, dispatch};
    use super::*;
    use crate::gnss::random::SplitMix64;

    struct Product<'a, E>(&'a Packed<E>, &'a Block, &'a mut Block);

    impl<E: Entry> Sweep for Product<'_, E> {
        #[inline(always)]
        fn run<R: Register>(self) {
            self.0.product::<R>(self.1, self.2);
        }
    }

    #[test]
    fn products_agree_with_plain_complex_arithmetic_with_either_kind_of_registers() {
        products_agree::<[f32; 2]>(|z| z);
        products_agree::<f32>(|z| z.re.into());
    }

    fn products_agree<E: Entry>(entry: fn(Complex64) -> Complex64) {
        let mut rng = SplitMix64::new(3);
        for (rows, columns) in [(1, 1), (6, 4), (50, 31), (13, 8)] {
            let a = CMat::from_fn(rows, columns, |_, _| entry(rng.complex_normal()));
            let x = CMat::from_fn(columns, 21, |_, _| rng.complex_normal());
            let plain = &a * &x;
            let packed = Packed::<E>::new(rows, columns, |r, c| a[(r, c)]);
            for plain_registers in [false, true] {
                let run = |first: usize| {
                    let (block, mut out) = (Block::of(x.as_ref(), first, 1.0), Block::zeros(rows));
                    let product = Product(&packed, &block, &mut out);
                    match plain_registers {
                        true => product.run::<[f32; 4]>(),
                        false => dispatch(product),
                    }
                    out
                };
                let blocks = [run(0), run(LANES)];
                let error = (matrix(rows, 21, |b| &blocks[b]) - &plain).norm_max();
                // Each is a sum of `columns` products of numbers below 4, in single precision.
                assert!(error < 16.0 * 2f64.powi(-23) * columns as f64, "{error}");
            }
        }
    }

    #[test]
    fn remaining_fractions_are_those_of_shrinkage() {
        let moduli = [1e-15f32, 0.3, 1.0, 1.5, 7.5, 1e15];
        let mut out = [0.0; 6];
        kept(&moduli.map(|m| 0.6 * m), &moduli.map(|m| -0.8 * m), 1.0, 0.0, &mut out);
        for (modulus, out) in moduli.into_iter().zip(out) {
            assert!((out - (1.0 - 1.0 / modulus).max(0.0)).abs() < 4.0 * f32::EPSILON);
        }
        kept(&[0.0], &[0.0], 1.0, 0.0, &mut out[..1]);
        assert_eq!(out[0], 0.0);
    }
}
