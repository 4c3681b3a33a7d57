//! What each cell of a basis would hold without interference, and the weights that follow.
//!
//! The weight of a cell is that of the locally optimum detector in Gaussian interference of known power, floor over
//! power: 1 in clean cells. The floor is the spectrum's shape `F`, the running median over +-300 kHz of a quantile over
//! time, so that a line does not raise it; the scale comes from the 10 % quantile of all cells, which half of them being
//! hit does not raise. Lines that stay are `P`, the 20 % quantile over time of a bin. Cells beyond the 1e-4 point of the
//! exponential distribution are hit.

use super::basis::{Basis, Transform};
use num_complex::Complex32;

const SHAPE_BINS: usize = 256;
/// Quantile over time that the shape is made of: bursts of half of the time do not raise it.
const SHAPE_QUANTILE: f64 = 0.25;
/// Powers below this part of their median are those of silence.
const SILENT: f32 = 1e-5;
/// Half of the range of the running median, Hz.
const MEDIAN_HZ: f64 = 300e3;
/// Least part of the mean that the shape counts as.
const LEAST_SHAPE: f64 = 1e-6;
/// -ln 1e-4: power over the floor beyond which a cell is hit.
pub(super) const HIT: f32 = 9.2;
/// Next to a cell of this power, cells beyond the lower bound are hit too.
const STRONG: f32 = 37.0;
const BESIDE_STRONG: f32 = 2.0;
/// Quantiles of cells and of a bin over time.
const SCALE_QUANTILE: f64 = 0.1;
const LINE_QUANTILE: f64 = 0.2;
/// Probability of a line in a bin of noise.
const FALSE_LINE: f64 = 1e-8;
/// Independent blocks without which no line can be told.
const MIN_BLOCKS: usize = 6;

/// Shape of the spectrum without narrow lines: power by frequency, [`SHAPE_BINS`] bins in the order of the transform.
#[derive(Clone, Debug)]
pub(super) struct Shape(Vec<f64>);

impl Shape {
    /// Bins of the shape.
    pub(super) const BINS: usize = SHAPE_BINS;

    /// From all whole blocks of the samples, by a transform of as many bins; none of zeros.
    pub(super) fn of(
        transform: &mut Transform,
        samples: &[Complex32],
        rate_hz: f64,
    ) -> Option<Self> {
        let powers = Powers::of(transform, samples, SHAPE_BINS);
        if powers.blocks() < MIN_BLOCKS {
            return None;
        }
        let quantiles: Vec<f32> =
            (0..SHAPE_BINS).map(|k| powers.quantile(k, SHAPE_QUANTILE)).collect();
        let half = ((MEDIAN_HZ / rate_hz * SHAPE_BINS as f64) as usize).max(1);
        let mut shape: Vec<f64> = running_median(&quantiles, half);
        let mean = shape.iter().sum::<f64>() / SHAPE_BINS as f64;
        shape.iter_mut().for_each(|f| *f = f.max(LEAST_SHAPE * mean));
        (mean > 0.0 && mean.is_finite()).then_some(Self(shape))
    }

    /// Amplitudes of a transform of `len` samples with this shape, the greatest being 1.
    pub(super) fn amplitudes(&self, len: usize) -> impl Iterator<Item = f32> {
        let most = self.0.iter().copied().fold(0.0, f64::max);
        let bins: Vec<f32> = self.0.iter().map(|f| (f / most).sqrt() as f32).collect();
        (0..len).map(move |k| bins[(k * SHAPE_BINS + len / 2) / len % SHAPE_BINS])
    }

    /// The shape in the bins of a basis: of a sweep the mean over what a block sweeps.
    pub(super) fn bins(&self, basis: &Basis) -> Vec<f32> {
        let n = basis.length as f64;
        let swept = (basis.chirp.abs() * n * SHAPE_BINS as f64).max(SHAPE_BINS as f64 / n);
        let at = |place: f64| {
            let low = place.floor();
            let value = |k: f64| self.0[(k as i64).rem_euclid(SHAPE_BINS as i64) as usize];
            value(low) + (place - low) * (value(low + 1.0) - value(low))
        };
        let steps = swept.ceil().max(1.0);
        let bin = |k: usize| {
            let centre = k as f64 / n * SHAPE_BINS as f64;
            let part = |i: usize| at(centre + swept * ((i as f64 + 0.5) / steps - 0.5));
            ((0..steps as usize).map(part).sum::<f64>() / steps) as f32
        };
        (0..basis.length).map(bin).collect()
    }
}

/// Median of the values around each, `half` to either side, around the circle.
pub(super) fn running_median(values: &[f32], half: usize) -> Vec<f64> {
    let n = values.len();
    let mut window = Vec::with_capacity(2 * half + 1);
    let mut median = |k: usize| {
        window.clear();
        window.extend((0..=2 * half).map(|i| values[(k + n + i - half) % n]));
        f64::from(*window.select_nth_unstable_by(half, f32::total_cmp).1)
    };
    (0..n).map(&mut median).collect()
}

/// Powers of the cells of blocks beside each other.
pub(super) struct Powers {
    bins: usize,
    cells: Vec<f32>,
}

impl Powers {
    /// Of the blocks that start every `hop` samples.
    pub(super) fn of(transform: &mut Transform, samples: &[Complex32], hop: usize) -> Self {
        let bins = transform.basis.length;
        let starts = (0..(samples.len() + 1).saturating_sub(bins)).step_by(hop);
        let mut cells = Vec::with_capacity(starts.len() * bins);
        for at in starts {
            cells.extend(transform.analyse(samples, at).iter().map(Complex32::norm_sqr));
        }
        Self { bins, cells }
    }

    pub(super) fn blocks(&self) -> usize {
        self.cells.len() / self.bins
    }

    /// Quantile over time of a bin.
    pub(super) fn quantile(&self, bin: usize, part: f64) -> f32 {
        let mut values: Vec<f32> = self.cells[bin..].iter().step_by(self.bins).copied().collect();
        quantile(&mut values, part)
    }

    /// Mean over time of each bin.
    pub(super) fn means(&self) -> Vec<f32> {
        let mut sums = vec![0f64; self.bins];
        for block in self.cells.chunks_exact(self.bins) {
            sums.iter_mut().zip(block).for_each(|(s, x)| *s += f64::from(*x));
        }
        sums.iter().map(|s| (s / self.blocks().max(1) as f64) as f32).collect()
    }
}

fn quantile(values: &mut [f32], part: f64) -> f32 {
    let at = (part * values.len() as f64) as usize;
    match values.len() {
        0 => 0.0,
        n => *values.select_nth_unstable_by(at.min(n - 1), f32::total_cmp).1,
    }
}

/// The ratio of the [`LINE_QUANTILE`] of so many exponential powers to its expectation that noise exceeds with the
/// probability [`FALSE_LINE`]: the order statistic `j` of `n` is beyond `x` where at most `j` of them are below, of
/// which each is with `1 - exp(-x)`.
fn false_line_bound(n: usize) -> f64 {
    let expected = -(1.0 - LINE_QUANTILE).ln();
    let j = (LINE_QUANTILE * n as f64) as usize;
    let tail = |ratio: f64| {
        let x = ratio * expected;
        let (ln_below, ln_above) = ((-(-x).exp_m1()).ln(), -x);
        let mut ln_choose = 0.0;
        let mut sum = 0.0;
        for k in 0..=j.min(n) {
            sum += (ln_choose + k as f64 * ln_below + (n - k) as f64 * ln_above).exp();
            ln_choose += ((n - k) as f64 / (k + 1) as f64).ln();
        }
        sum
    };
    let (mut low, mut high) = (1.0, 200.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if tail(middle) > FALSE_LINE { low = middle } else { high = middle }
    }
    high
}

/// The floor of a basis, and the lines that stay.
pub(super) struct CellFloor {
    /// One over scale, shape and line: power times this is exponential of mean 1 where nothing is hit.
    inverse: Vec<f32>,
    /// One over the line.
    weights: Vec<f32>,
}

impl CellFloor {
    /// From the blocks of the samples; none where they are too short, or zeros.
    pub(super) fn fit(
        transform: &mut Transform,
        shape: &Shape,
        samples: &[Complex32],
    ) -> Option<Self> {
        let powers = Powers::of(transform, samples, transform.basis.length);
        Self::of(&powers, &shape.bins(&transform.basis))
    }

    fn of(powers: &Powers, shape: &[f32]) -> Option<Self> {
        let (_, scale) = scaled(powers, shape)?;
        let lines: Vec<f64> = lines(powers, shape, scale).collect();
        let inverse = lines.iter().zip(shape);
        let inverse = inverse.map(|(p, f)| (1.0 / (scale * f64::from(*f) * p)) as f32);
        Some(Self {
            inverse: inverse.collect(),
            weights: lines.iter().map(|p| (1.0 / p) as f32).collect(),
        })
    }

    /// Powers over the floor, and whether a line stays in any bin; none of zeros.
    pub(super) fn ratios(powers: &Powers, shape: &[f32]) -> Option<(Vec<f32>, bool)> {
        let (mut cells, scale) = scaled(powers, shape)?;
        let inverse = (1.0 / scale) as f32;
        cells.iter_mut().for_each(|q| *q *= inverse);
        let lines = powers.blocks() >= MIN_BLOCKS && lines(powers, shape, scale).any(|p| p > 1.0);
        Some((cells, lines))
    }

    /// Multiplies cells by floor over power.
    pub(super) fn weigh(&self, cells: &mut [Complex32]) {
        let n = cells.len();
        let ratio = |cells: &[Complex32], k: usize| cells[k].norm_sqr() * self.inverse[k];
        // Of the cell before, as it was.
        let (first, mut before) = (ratio(cells, 0), ratio(cells, n - 1));
        let mut here = first;
        for k in 0..n {
            let after = if k + 1 < n { ratio(cells, k + 1) } else { first };
            let beside = before.max(after) > STRONG && here > BESIDE_STRONG;
            let weight =
                if here > HIT || beside { self.weights[k] / here } else { self.weights[k] };
            cells[k] *= weight;
            (before, here) = (here, after);
        }
    }
}

/// Powers over the shape, and the scale of the floor; none of zeros.
fn scaled(powers: &Powers, shape: &[f32]) -> Option<(Vec<f32>, f64)> {
    let inverse: Vec<f32> = shape.iter().map(|f| 1.0 / f).collect();
    let blocks = powers.cells.chunks_exact(shape.len());
    let cells: Vec<f32> = blocks.flat_map(|b| b.iter().zip(&inverse).map(|(x, f)| x * f)).collect();
    let mut loud = cells.clone();
    let silent = SILENT * quantile(&mut loud, 0.5);
    loud.retain(|x| *x > silent);
    let scale = f64::from(quantile(&mut loud, SCALE_QUANTILE)) / -(1.0 - SCALE_QUANTILE).ln();
    (scale > 0.0 && scale.is_finite()).then_some((cells, scale))
}

/// Power over the floor of the line that stays in each bin; 1 where none does.
fn lines(powers: &Powers, shape: &[f32], scale: f64) -> impl Iterator<Item = f64> {
    let independent = powers.blocks();
    let sure = false_line_bound(independent);
    shape.iter().enumerate().map(move |(k, shape)| {
        if independent < MIN_BLOCKS {
            return 1.0;
        }
        let low = f64::from(powers.quantile(k, LINE_QUANTILE)) / -(1.0 - LINE_QUANTILE).ln();
        let line = low / (scale * f64::from(*shape));
        if line > sure { line } else { 1.0 }
    })
}
