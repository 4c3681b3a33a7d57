//! Buffer of one channel's samples for the correlators.

use super::kernel::{WORDS_PER_BYTE, Window};
use multiversion::multiversion;
use num_complex::Complex32;

/// Root mean square that the first samples are scaled to, in words: 40 dB above the quantisation noise of
/// 1/12, and 36 dB below the clipping level of 32767. In bytes it is 32: 16 dB less of both, 38 dB above the quantisation
/// noise of 1/6 of I and Q; of Gaussian noise two of 10^8 numbers are clipped.
const TARGET_RMS: f32 = 512.0;
/// Root mean square over that of the first samples for which bytes are used: quantisation costs 0.01 dB at the lowest,
/// clipping of one in 5000 as much at the highest.
const LEVELS_OF_BYTES: std::ops::Range<f32> = 0.25..1.5;

/// How samples are held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// Bytes: enough for noise and the signals under it. Samples of other levels than the first are words still.
    Bytes,
    /// Words of 16 bits: of whatever is in the samples.
    Words,
}

/// A window of consecutive samples of one channel, planar, that moves along the stream.
#[derive(Clone, Debug)]
pub struct SampleBuffer {
    planes: Planes,
    first_sample: u64,
    scale: Option<f32>,
    /// Stream index from which all samples may be bytes.
    bytes_from: u64,
}

#[derive(Clone, Debug)]
enum Planes {
    Bytes(Plane<u8>),
    Words(Plane<i16>),
}

/// I and Q, of which the first `gone` are no longer wanted.
#[derive(Clone, Debug, Default)]
struct Plane<T> {
    parts: [Vec<T>; 2],
    gone: usize,
}

impl<T> Plane<T> {
    fn len(&self) -> usize {
        self.parts[0].len() - self.gone
    }

    /// Makes room once more is gone than twice what is left, so that little is moved.
    fn discard(&mut self, count: usize) {
        self.gone += count;
        if self.gone > 2 * self.len() {
            let gone = std::mem::take(&mut self.gone);
            self.parts.iter_mut().for_each(|part| drop(part.drain(..gone)));
        }
    }

    fn window(&self, from: usize, to: usize) -> [&[T]; 2] {
        self.parts.each_ref().map(|part| &part[self.gone + from..self.gone + to])
    }

    fn converted<U>(&self, value: impl Fn(&T) -> U) -> Plane<U> {
        let kept = self.window(0, self.len());
        Plane { parts: kept.map(|part| part.iter().map(&value).collect()), gone: 0 }
    }
}

impl Default for SampleBuffer {
    fn default() -> Self {
        Self::starting_at(0)
    }
}

impl SampleBuffer {
    /// An empty buffer whose first sample will have this index in the stream.
    pub fn starting_at(first_sample: u64) -> Self {
        let planes = Planes::Bytes(Plane::default());
        Self { planes, first_sample, scale: None, bytes_from: first_sample }
    }

    /// Appends samples as words.
    pub fn push(&mut self, samples: &[Complex32]) {
        self.push_at(samples, Depth::Words);
    }

    /// Appends samples. The first non-zero samples fix the scale from floating point permanently. All samples held are
    /// words as long as any has to be.
    pub fn push_at(&mut self, samples: &[Complex32], depth: Depth) {
        let rms = rms(samples);
        if self.scale.is_none() && rms > 0.0 && rms.is_finite() {
            self.scale = Some(TARGET_RMS / rms);
        }
        let scale = self.scale.unwrap_or(1.0);
        let level = rms * scale / TARGET_RMS;
        if depth == Depth::Words || !(level == 0.0 || LEVELS_OF_BYTES.contains(&level)) {
            self.bytes_from = self.end() + samples.len() as u64;
        }
        let are_bytes = self.bytes_from <= self.first_sample;
        match (&self.planes, are_bytes) {
            (Planes::Words(words), true) => {
                let half = 128 * WORDS_PER_BYTE;
                let byte = |&w: &i16| (w.saturating_add(half) / WORDS_PER_BYTE).clamp(0, 255) as u8;
                self.planes = Planes::Bytes(words.converted(byte));
            }
            (Planes::Bytes(bytes), false) => {
                let word = |&b: &u8| (2 * i16::from(b) - 255) * (WORDS_PER_BYTE / 2);
                self.planes = Planes::Words(bytes.converted(word));
            }
            _ => {}
        }
        match &mut self.planes {
            Planes::Bytes(plane) => {
                append_bytes(samples, scale / f32::from(WORDS_PER_BYTE), &mut plane.parts);
            }
            Planes::Words(plane) => append_words(samples, scale, &mut plane.parts),
        }
    }

    fn len(&self) -> usize {
        match &self.planes {
            Planes::Bytes(plane) => plane.len(),
            Planes::Words(plane) => plane.len(),
        }
    }

    /// Removes all samples before the stream index `sample`.
    pub fn discard_before(&mut self, sample: u64) {
        let count = (sample.saturating_sub(self.first_sample) as usize).min(self.len());
        match &mut self.planes {
            Planes::Bytes(plane) => plane.discard(count),
            Planes::Words(plane) => plane.discard(count),
        }
        self.first_sample += count as u64;
    }

    /// Index in the stream of the first sample held.
    pub fn first_sample(&self) -> u64 {
        self.first_sample
    }

    /// Index in the stream one past the last sample held.
    pub fn end(&self) -> u64 {
        self.first_sample + self.len() as u64
    }

    /// Samples `start..end` (stream indices), if all are held.
    pub fn window(&self, start: u64, end: u64) -> Option<Window<'_>> {
        if start < self.first_sample || end > self.end() || start > end {
            return None;
        }
        let (from, to) = ((start - self.first_sample) as usize, (end - self.first_sample) as usize);
        Some(match &self.planes {
            Planes::Bytes(plane) => Window::Bytes(plane.window(from, to)),
            Planes::Words(plane) => Window::Words(plane.window(from, to)),
        })
    }
}

/// Root mean square of an eighth of the samples, 64 of each 512.
fn rms(samples: &[Complex32]) -> f32 {
    let some = || samples.chunks(512).flat_map(|run| &run[..run.len().min(64)]);
    let power: f64 = some().map(|s| f64::from(s.norm_sqr())).sum();
    (power / some().count().max(1) as f64).sqrt() as f32
}

/// Samples converted at a time, which stay in the first-level cache.
const RUN: usize = 1024;
/// Added to a float below 2^22 it leaves the rounded integer in the low bits (ties to even), which vectorises where a
/// conversion with saturation does not.
const ROUNDING: f32 = 12_582_912.0;

/// 8 bytes read, 4 written per sample. Values beyond the range of `i16` saturate.
#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "x86_64+avx2+fma",
    "aarch64+neon"
))]
fn append_words(samples: &[Complex32], scale: f32, parts: &mut [Vec<i16>; 2]) {
    let word = |x: f32| ((x * scale).clamp(-32_767.0, 32_767.0) + ROUNDING).to_bits() as i16;
    for run in samples.chunks(RUN) {
        parts[0].extend(run.iter().map(|s| word(s.re)));
        parts[1].extend(run.iter().map(|s| word(s.im)));
    }
}

/// 8 bytes read, 2 written per sample. Values beyond the range saturate.
#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "x86_64+avx2+fma",
    "aarch64+neon"
))]
fn append_bytes(samples: &[Complex32], scale: f32, parts: &mut [Vec<u8>; 2]) {
    let byte = |x: f32| ((x * scale + 127.5).clamp(0.0, 255.0) + ROUNDING).to_bits() as u8;
    for run in samples.chunks(RUN) {
        parts[0].extend(run.iter().map(|s| byte(s.re)));
        parts[1].extend(run.iter().map(|s| byte(s.im)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(count: usize, amplitude: f32) -> Vec<Complex32> {
        let value = |n: usize| (n * 37 % 101) as f32 - 50.0;
        (0..count).map(|n| Complex32::new(value(n), -value(3 * n)) * amplitude).collect()
    }

    /// Samples come back to half a step of what they are held in, at their index, whatever the depth and its changes.
    #[test]
    fn samples_keep_their_ratio_and_index() {
        use Depth::{Bytes, Words};
        let all = samples(8000, 1.0);
        let scale = TARGET_RMS / rms(&all[..1000]);
        for depths in
            [[Words; 8], [Bytes; 8], [Words, Words, Bytes, Bytes, Bytes, Bytes, Words, Bytes]]
        {
            let mut buffer = SampleBuffer::starting_at(10);
            for (k, (part, depth)) in all.chunks(1000).zip(depths).enumerate() {
                buffer.push_at(part, depth);
                buffer.discard_before(10 + 1000 * (k as u64).saturating_sub(1) + 300);
                let (first, end) = (buffer.first_sample(), buffer.end());
                let kept = &depths[k.saturating_sub(1)..=k];
                let window = buffer.window(first, end).unwrap();
                assert_eq!(end, 10 + 1000 * (k as u64 + 1));
                // Bytes once more as soon as no word is left.
                assert!(matches!(window, Window::Bytes(_)) <= !kept.contains(&Words));
                let step = 16.0 * f64::from(u8::from(depths.contains(&Bytes))).max(1.0 / 16.0);
                for n in 0..window.len() {
                    let x = all[(first - 10) as usize + n] * scale;
                    let difference =
                        window.sample(n) - num_complex::Complex64::new(x.re.into(), x.im.into());
                    let bound = 0.5 * step + 0.51;
                    assert!(
                        difference.re.abs() <= bound && difference.im.abs() <= bound,
                        "{difference}"
                    );
                }
            }
            assert!(buffer.window(9, 40).is_none() && buffer.window(7000, 8011).is_none());
        }
    }

    /// A level eight times that of the start does not fit bytes: its samples are words, and bytes come back after it.
    #[test]
    fn samples_of_another_level_are_words() {
        let mut buffer = SampleBuffer::default();
        let kind = |buffer: &SampleBuffer| {
            matches!(buffer.window(buffer.first_sample(), buffer.end()), Some(Window::Bytes(_)))
        };
        buffer.push_at(&samples(1000, 1.0), Depth::Bytes);
        assert!(kind(&buffer));
        buffer.push_at(&samples(1000, 8.0), Depth::Bytes);
        assert!(!kind(&buffer));
        buffer.discard_before(2000);
        buffer.push_at(&samples(1000, 1.2), Depth::Bytes);
        buffer.push_at(&vec![Complex32::ZERO; 1000], Depth::Bytes);
        assert!(kind(&buffer));
    }
}
