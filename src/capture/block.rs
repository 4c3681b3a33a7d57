//! The block: some samples of all channels.

use num_complex::{Complex32, Complex64};
use rayon::prelude::*;

/// Samples interleaved at a time, so that those of many channels stay in the cache.
const TILE: usize = 256;

/// A run of consecutive samples of all channels, planar: channel 0 whole, then channel 1, ...
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Block {
    samples: Vec<Complex32>,
    channels: usize,
    first_sample: u64,
}

impl Block {
    /// A block of zeros.
    pub fn zeros(channels: usize, len: usize) -> Self {
        Self { samples: vec![Complex32::ZERO; channels * len], channels, first_sample: 0 }
    }

    /// Blocks that follow each other as one.
    pub fn joined(blocks: &[Self]) -> Self {
        let (len, channels) =
            (blocks.iter().map(Self::len).sum(), blocks.first().map_or(0, |b| b.channels));
        let mut joined = Self::default();
        joined.reset(channels, len, blocks.first().map_or(0, |b| b.first_sample));
        let mut at = 0;
        for block in blocks {
            for c in 0..channels {
                joined.channel_mut(c)[at..at + block.len()].copy_from_slice(block.channel(c));
            }
            at += block.len();
        }
        joined
    }

    /// Makes the block `channels` x `len`, keeping its allocation; contents are unspecified.
    pub fn reset(&mut self, channels: usize, len: usize, first_sample: u64) {
        self.samples.resize(channels * len, Complex32::ZERO);
        self.channels = channels;
        self.first_sample = first_sample;
    }

    /// Keeps the first `len` samples of each channel; a shorter block stays as it is.
    pub fn truncate(&mut self, len: usize) {
        let old = self.len();
        if len < old {
            for c in 1..self.channels {
                self.samples.copy_within(c * old..c * old + len, c * len);
            }
            self.samples.truncate(self.channels * len);
        }
    }

    /// Number of samples of each channel.
    pub fn len(&self) -> usize {
        self.samples.len().checked_div(self.channels).unwrap_or(0)
    }

    /// Whether the block holds no sample.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Number of channels (antenna elements).
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Index of the block's first sample, counted from the start of the stream.
    pub fn first_sample(&self) -> u64 {
        self.first_sample
    }

    /// Sets the stream's index of the first sample.
    pub fn set_first_sample(&mut self, first_sample: u64) {
        self.first_sample = first_sample;
    }

    /// The samples of one channel. Panics when there is no such channel.
    pub fn channel(&self, channel: usize) -> &[Complex32] {
        let len = self.len();
        &self.samples[channel * len..(channel + 1) * len]
    }

    /// The samples of one channel, to be changed. Panics when there is no such channel.
    pub fn channel_mut(&mut self, channel: usize) -> &mut [Complex32] {
        let len = self.len();
        &mut self.samples[channel * len..(channel + 1) * len]
    }

    /// Multiplies each channel by its weight: the calibration of an antenna array, when one is given.
    pub fn weight_channels(&mut self, weights: &[Complex64]) {
        for (channel, weight) in self.channels_mut().zip(weights) {
            let weight = Complex32::new(weight.re as f32, weight.im as f32);
            channel.iter_mut().for_each(|x| *x *= weight);
        }
    }

    /// Appends the samples as they lie in a file: channels interleaved by sample, I before Q, and of
    /// `real` samples I alone.
    pub fn append_numbers(&self, real: bool, numbers: &mut Vec<f32>) {
        let old = numbers.len();
        numbers.resize(old + self.samples.len() * if real { 1 } else { 2 }, 0.0);
        let (len, channels) = (self.len(), self.channels);
        for tile in (0..len).step_by(TILE) {
            for c in 0..channels {
                let samples = &self.channel(c)[tile..len.min(tile + TILE)];
                let first = tile * channels + c;
                if real {
                    let out = numbers[old + first..].iter_mut();
                    out.step_by(channels).zip(samples).for_each(|(out, x)| *out = x.re);
                } else {
                    let out: &mut [Complex32] = bytemuck::cast_slice_mut(&mut numbers[old..]);
                    let out = out[first..].iter_mut();
                    out.step_by(channels).zip(samples).for_each(|(out, x)| *out = *x);
                }
            }
        }
    }

    /// The samples of all channels, one slice each, in parallel.
    pub fn par_channels_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [Complex32]> {
        let len = self.len().max(1);
        self.samples.par_chunks_exact_mut(len)
    }

    /// The samples of all channels, one slice each.
    pub fn channels_mut(&mut self) -> impl Iterator<Item = &mut [Complex32]> {
        let len = self.len().max(1);
        self.samples.chunks_exact_mut(len)
    }
}
