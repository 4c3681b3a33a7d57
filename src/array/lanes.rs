//! Sixteen snapshots side by side: the ground of the fast sparse solvers.
//!
//! A block of sixteen columns lies as rows of [`Lane`]s, real and imaginary parts apart, so that one row is
//! one AVX-512 register for each (or two of AVX2, four of NEON), and no operation ever crosses columns. The
//! functions here are inlined into kernels that are compiled for several instruction sets.

use super::CMat;
use num_complex::Complex64;

/// Snapshots of a block.
pub const LANES: usize = 16;
/// Rows of a product that are summed at the same time: 12 accumulators, 2 operands.
const TILE: usize = 6;

/// One row of a block: sixteen complex numbers.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct Lane {
    /// Real parts.
    pub re: [f32; LANES],
    /// Imaginary parts.
    pub im: [f32; LANES],
}

impl Lane {
    /// Sixteen zeros.
    pub const ZERO: Self = Self { re: [0.0; LANES], im: [0.0; LANES] };

    /// |z|^2 of each.
    #[inline(always)]
    pub fn power(&self) -> [f32; LANES] {
        std::array::from_fn(|k| self.re[k] * self.re[k] + self.im[k] * self.im[k])
    }

    /// `a` self + `b` other, the coefficients real.
    #[inline(always)]
    pub fn mix(&self, a: f32, other: &Self, b: f32) -> Self {
        let mut out = Self::ZERO;
        for k in 0..LANES {
            out.re[k] = a * self.re[k] + b * other.re[k];
            out.im[k] = a * self.im[k] + b * other.im[k];
        }
        out
    }

    /// Each number moved towards zero by `by`, and to zero if it was nearer.
    #[inline(always)]
    pub fn shrunk(&self, by: f32) -> Self {
        let power = self.power();
        let mut out = Self::ZERO;
        for k in 0..LANES {
            let left = (1.0 - by * inverse_root(power[k])).max(0.0);
            out.re[k] = left * self.re[k];
            out.im[k] = left * self.im[k];
        }
        out
    }
}

/// 1 / sqrt(x) to single precision by Newton's iteration from the exponent's half (Lomont 2003): twelve
/// operations that vectorise, where a root and a division take three times as long. Of zero: a large
/// finite number.
#[inline(always)]
pub fn inverse_root(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(0x5f37_5a86 - (x.to_bits() >> 1));
    for _ in 0..3 {
        y *= 1.5 - half * y * y;
    }
    y
}

/// a b + c: in one rounding where the instruction set has it.
#[inline(always)]
fn fma<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
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

    /// The product with a block (`columns` lanes), row by row to `take`. Cost: 4 fused multiply-adds of
    /// sixteen numbers for each entry.
    #[inline(always)]
    pub fn product<const FUSED: bool>(&self, block: &[Lane], mut take: impl FnMut(usize, &Lane)) {
        let block = &block[..self.columns];
        for (number, tile) in self.tiles.chunks_exact(self.columns).enumerate() {
            let mut re = [[0f32; LANES]; TILE];
            let mut im = [[0f32; LANES]; TILE];
            for (entries, x) in tile.iter().zip(block) {
                for t in 0..TILE {
                    let [a, b] = entries[t];
                    for k in 0..LANES {
                        re[t][k] = fma::<FUSED>(a, x.re[k], re[t][k]);
                        im[t][k] = fma::<FUSED>(a, x.im[k], im[t][k]);
                    }
                    for k in 0..LANES {
                        re[t][k] = fma::<FUSED>(-b, x.im[k], re[t][k]);
                        im[t][k] = fma::<FUSED>(b, x.re[k], im[t][k]);
                    }
                }
            }
            let first = number * TILE;
            for t in 0..TILE.min(self.rows - first) {
                take(first + t, &Lane { re: re[t], im: im[t] });
            }
        }
    }
}

/// The columns of a matrix as blocks, times a factor; the last is filled up with zeros.
pub fn blocks(matrix: &CMat, factor: f64) -> Vec<Vec<Lane>> {
    let first_columns = (0..matrix.ncols()).step_by(LANES);
    let block = |first: usize| {
        let mut rows = vec![Lane::ZERO; matrix.nrows()];
        for k in 0..LANES.min(matrix.ncols() - first) {
            for (row, lane) in rows.iter_mut().enumerate() {
                let z = matrix[(row, first + k)] * factor;
                (lane.re[k], lane.im[k]) = (z.re as f32, z.im as f32);
            }
        }
        rows
    };
    first_columns.map(block).collect()
}

/// Blocks of `rows` lanes as a matrix of so many columns, times a factor.
pub fn matrix<'a>(
    rows: usize,
    columns: usize,
    factor: f64,
    block: impl Fn(usize) -> &'a [Lane],
) -> CMat {
    CMat::from_fn(rows, columns, |row, column| {
        let lane = &block(column / LANES)[row];
        let k = column % LANES;
        Complex64::new(lane.re[k].into(), lane.im[k].into()) * factor
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::random::SplitMix64;

    #[test]
    fn products_shrinkage_and_roots_agree_with_plain_complex_arithmetic() {
        let mut rng = SplitMix64::new(3);
        for (rows, columns) in [(1, 1), (6, 4), (50, 31), (13, 8)] {
            let a = CMat::from_fn(rows, columns, |_, _| rng.complex_normal());
            let x = CMat::from_fn(columns, 21, |_, _| rng.complex_normal());
            let packed = Packed::new(rows, columns, |r, c| a[(r, c)]);
            let shrunk = |z: Complex64| z * (1.0 - 1.0 / z.norm()).max(0.0);
            let plain = &a * &x;
            let run = |block: &Vec<Lane>| {
                let (mut fused, mut apart) = (vec![Lane::ZERO; rows], vec![Lane::ZERO; rows]);
                packed.product::<true>(block, |r, lane| fused[r] = lane.shrunk(1.0));
                packed.product::<false>(block, |r, lane| apart[r] = *lane);
                (fused, apart)
            };
            let results: Vec<_> = blocks(&x, 1.0).iter().map(run).collect();
            let fused = matrix(rows, 21, 1.0, |b| &results[b].0);
            let apart = matrix(rows, 21, 1.0, |b| &results[b].1);
            // Each sum of `columns` products of numbers below 4, in single precision.
            let tolerance = 16.0 * 2f64.powi(-23) * columns as f64;
            for k in 0..21 {
                for r in 0..rows {
                    assert!((fused[(r, k)] - shrunk(plain[(r, k)])).norm() < tolerance);
                    assert!((apart[(r, k)] - plain[(r, k)]).norm() < tolerance);
                }
            }
        }
        for x in [1e-30f32, 0.3, 1.0, 7.5e9, 1e30] {
            assert!((inverse_root(x) * x.sqrt() - 1.0).abs() < 4.0 * f32::EPSILON);
        }
        assert_eq!(Lane::ZERO.shrunk(1.0).power(), [0.0; LANES]);
    }
}
