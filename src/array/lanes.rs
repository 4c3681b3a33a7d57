//! Sixteen snapshots side by side: the ground of the fast sparse solvers.
//!
//! A block of sixteen columns lies as rows of sixteen numbers, all real parts and then all imaginary ones, so
//! that a row of a part is one AVX-512 register (two of AVX2, four of NEON), and no operation crosses columns.
//! The functions here are inlined into kernels that are compiled for several instruction sets; those of
//! single numbers take one part at a time as a flat slice, which is what compilers vectorise best.

use super::CMat;
use super::register::Register;
use bytemuck::{Pod, Zeroable};
use faer::MatRef;
use num_complex::Complex64;

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
pub struct Block([Vec<Row>; 2]);

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

    /// The same, to be changed.
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

    /// One number.
    pub fn at(&self, row: usize, column: usize) -> Complex64 {
        let [re, im] = [0, 1].map(|part| f64::from(self.0[part][row].0[column]));
        Complex64::new(re, im)
    }
}

/// A matrix of so many columns from its blocks.
pub fn matrix<'a>(rows: usize, columns: usize, block: impl Fn(usize) -> &'a Block) -> CMat {
    CMat::from_fn(rows, columns, |row, column| block(column / LANES).at(row, column % LANES))
}

/// For each number: what is left when `by` is taken from its modulus, as a share of it, `floor` at least.
#[inline(always)]
pub fn kept(re: &[f32], im: &[f32], by: f32, floor: f32, out: &mut [f32]) {
    for ((re, im), out) in re.iter().zip(im).zip(out) {
        *out = (1.0 - by * inverse_root(re * re + im * im)).max(floor);
    }
}

/// 1 / sqrt(x) to single precision by Newton's iteration from the exponent's half (Lomont 2003): operations that
/// vectorise, where a root and a division take three times as long. Of zero: a large finite number.
#[inline(always)]
fn inverse_root(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(0x5f37_5a86_u32.wrapping_sub(x.to_bits() >> 1));
    for _ in 0..3 {
        y *= 1.5 - half * y * y;
    }
    y
}

/// A matrix ready to be multiplied with blocks: tiles of six rows, column by column within.
#[derive(Clone, Debug)]
pub struct Packed {
    rows: usize,
    columns: usize,
    tiles: Vec<[[f32; 2]; TILE]>,
}

impl Packed {
    /// Packs the matrix with these entries.
    pub fn new(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> Complex64) -> Self {
        let column = |first: usize, c: usize| {
            std::array::from_fn(|t| match first + t < rows {
                true => {
                    let z = entry(first + t, c);
                    [z.re as f32, z.im as f32]
                }
                false => [0.0; 2],
            })
        };
        let tiles = (0..rows.div_ceil(TILE))
            .flat_map(|tile| (0..columns).map(move |c| (tile * TILE, c)))
            .map(|(first, c)| column(first, c))
            .collect();
        Self { rows, columns, tiles }
    }

    /// out = this matrix times a block of `columns` rows. Cost: 4 fused multiply-adds of sixteen numbers for
    /// each entry.
    #[inline(always)]
    pub fn product<R: Register>(&self, block: &Block, out: &mut Block) {
        let [re, im] = [&block.0[0][..self.columns], &block.0[1][..self.columns]];
        for (number, tile) in self.tiles.chunks_exact(self.columns).enumerate() {
            for first_lane in (0..LANES).step_by(R::WIDTH) {
                let mut sums = [[R::splat(0.0); 2]; TILE];
                for ((entries, re), im) in tile.iter().zip(re).zip(im) {
                    let [re, im] = [re, im].map(|x| R::load(&x.0[first_lane..]));
                    for (sum, &[a, b]) in sums.iter_mut().zip(entries) {
                        let [a, b] = [a, b].map(R::splat);
                        sum[0] = sum[0].plus(a, re).minus(b, im);
                        sum[1] = sum[1].plus(a, im).plus(b, re);
                    }
                }
                let first_row = number * TILE;
                for (t, sum) in sums.into_iter().enumerate().take(self.rows - first_row) {
                    for part in 0..2 {
                        sum[part].store(&mut out.0[part][first_row + t].0[first_lane..]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::random::SplitMix64;
    use crate::array::register::{Sweep, dispatch};

    struct Product<'a>(&'a Packed, &'a Block, &'a mut Block);

    impl Sweep for Product<'_> {
        #[inline(always)]
        fn run<R: Register>(self) {
            self.0.product::<R>(self.1, self.2);
        }
    }

    #[test]
    fn products_agree_with_plain_complex_arithmetic_with_either_kind_of_registers() {
        let mut rng = SplitMix64::new(3);
        for (rows, columns) in [(1, 1), (6, 4), (50, 31), (13, 8)] {
            let a = CMat::from_fn(rows, columns, |_, _| rng.complex_normal());
            let x = CMat::from_fn(columns, 21, |_, _| rng.complex_normal());
            let plain = &a * &x;
            let packed = Packed::new(rows, columns, |r, c| a[(r, c)]);
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
    fn shares_kept_are_those_of_shrinkage() {
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
