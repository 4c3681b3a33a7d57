//! Whether there is interference at all: a test of some blocks of a chunk of samples.
//!
//! Of exponential cells of mean 1 those beyond 9.2 are one in 10^4; too many of them, or one beyond [`SURE`], is
//! interference. Cost: a transform, a quantile and a comparison of 8192 samples for each length of blocks.

use super::basis::Basis;
use super::floor::{CellFloor, HIT, Powers};
use super::treatment::Tools;
use num_complex::Complex32;

/// Samples of each length of blocks that are looked at in a chunk.
const LOOK_SAMPLES: usize = 8192;
/// Cells beyond this are interference: of 8192 exponential ones none is, but for one chunk in 10^9.
const SURE: f32 = 30.0;
/// Chunks for which the shape of the spectrum is taken as known.
const SHAPE_CHUNKS: usize = 10;

/// The test, with the spectrum's shape that it knows.
#[derive(Clone, Default)]
pub(super) struct Look {
    /// Shape by the bins of each length.
    shapes: Vec<(usize, Vec<f32>)>,
    age: usize,
    turn: usize,
    cells: Vec<Complex32>,
}

impl Look {
    /// Whether a chunk shows interference, by blocks of `all` lengths or of one in turn.
    pub(super) fn is_hit(&mut self, tools: &mut Tools, samples: &[Complex32], all: bool) -> bool {
        self.turn += 1;
        self.age += 1;
        if self.shapes.is_empty() || self.age > SHAPE_CHUNKS {
            self.age = 0;
            self.shapes.clear();
            let Some(shape) = tools.shape(&samples[..samples.len().min(2 * LOOK_SAMPLES)]) else {
                return false;
            };
            for length in tools.lengths() {
                self.shapes.push((length, shape.bins(&Basis { length, chirp: 0.0 })));
            }
        }
        let count = self.shapes.len();
        let looked = if all { 0..count } else { self.turn % count..self.turn % count + 1 };
        looked.into_iter().any(|k| self.is_hit_at(tools, samples, k))
    }

    fn is_hit_at(&mut self, tools: &mut Tools, samples: &[Complex32], k: usize) -> bool {
        let (length, shape) = &self.shapes[k];
        let length = *length;
        let blocks = (LOOK_SAMPLES / length).max(2);
        let step = (samples.len() + 1).saturating_sub(length) / blocks;
        if step == 0 {
            return false;
        }
        self.cells.clear();
        for b in 0..blocks {
            self.cells.extend_from_slice(&samples[b * step..b * step + length]);
        }
        let transform = tools.transform(Basis { length, chirp: 0.0 });
        let powers = Powers::of(transform, &self.cells, length);
        let Some((ratios, lines)) = CellFloor::ratios(&powers, shape) else { return false };
        let most = ratios.iter().copied().fold(0f32, f32::max);
        let hits = ratios.iter().filter(|q| **q > HIT).count() as f32;
        let expected = (-HIT).exp() * ratios.len() as f32;
        most > SURE || lines || hits > 2.0 * expected + 6.0 * expected.sqrt() + 6.0
    }
}
