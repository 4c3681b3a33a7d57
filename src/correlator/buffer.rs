//! Buffer of one channel's samples for the correlators.

use num_complex::Complex32;

/// Root mean square that the first samples are scaled to: 40 dB above the quantisation noise of
/// 1/12, and 36 dB below the clipping level of 32767.
const TARGET_RMS: f32 = 512.0;

/// A window of consecutive samples of one channel, planar `i16`, that moves along the stream.
#[derive(Clone, Debug, Default)]
pub struct SampleBuffer {
    i: Vec<i16>,
    q: Vec<i16>,
    first_sample: u64,
    scale: Option<f32>,
}

impl SampleBuffer {
    /// An empty buffer whose first sample will have this index in the stream.
    pub fn starting_at(first_sample: u64) -> Self {
        Self { first_sample, ..Self::default() }
    }

    /// Appends samples. The first non-zero samples fix the scale from floating point to `i16` permanently.
    pub fn push(&mut self, samples: &[Complex32]) {
        let scale = match self.scale {
            Some(scale) => scale,
            None => {
                let power: f64 = samples.iter().map(|s| f64::from(s.norm_sqr())).sum();
                let rms = (power / samples.len().max(1) as f64).sqrt() as f32;
                if rms > 0.0 && rms.is_finite() {
                    *self.scale.insert(TARGET_RMS / rms)
                } else {
                    1.0
                }
            }
        };
        let start = self.i.len();
        self.i.resize(start + samples.len(), 0);
        self.q.resize(start + samples.len(), 0);
        quantise(samples, scale, &mut self.i[start..], &mut self.q[start..]);
    }

    /// Removes all samples before the stream index `sample`.
    pub fn discard_before(&mut self, sample: u64) {
        let count = (sample.saturating_sub(self.first_sample) as usize).min(self.i.len());
        self.i.drain(..count);
        self.q.drain(..count);
        self.first_sample += count as u64;
    }

    /// Index in the stream of the first sample held.
    pub fn first_sample(&self) -> u64 {
        self.first_sample
    }

    /// Index in the stream one past the last sample held.
    pub fn end(&self) -> u64 {
        self.first_sample + self.i.len() as u64
    }

    /// In-phase and quadrature samples `start..end` (stream indices), if all are held.
    pub fn window(&self, start: u64, end: u64) -> Option<(&[i16], &[i16])> {
        if start < self.first_sample || end > self.end() || start > end {
            return None;
        }
        let range = (start - self.first_sample) as usize..(end - self.first_sample) as usize;
        Some((&self.i[range.clone()], &self.q[range]))
    }
}

/// One pass: 8 bytes read, 4 written per sample. Values beyond the range of `i16` saturate.
///
/// Adding 3 x 2^22 leaves the rounded integer in the low bits of a float (ties to even), which vectorises
/// where a conversion with saturation does not.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "x86_64+avx2+fma",
    "aarch64+neon"
))]
fn quantise(samples: &[Complex32], scale: f32, i: &mut [i16], q: &mut [i16]) {
    const ROUNDING: f32 = 12_582_912.0;
    let round = |x: f32| ((x * scale).clamp(-32_767.0, 32_767.0) + ROUNDING).to_bits() as i16;
    for ((s, i), q) in samples.iter().zip(i).zip(q) {
        *i = round(s.re);
        *q = round(s.im);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_keep_their_ratio_and_index() {
        let mut buffer = SampleBuffer::starting_at(10);
        let samples: Vec<_> = (0..100).map(|n| Complex32::new(n as f32, -2.0 * n as f32)).collect();
        buffer.push(&samples[..60]);
        buffer.push(&samples[60..]);
        buffer.discard_before(30);
        assert_eq!((buffer.first_sample(), buffer.end()), (30, 110));
        let (i, q) = buffer.window(40, 110).unwrap();
        let scale = 512.0 / (samples[..60].iter().map(|s| s.norm_sqr()).sum::<f32>() / 60.0).sqrt();
        for (n, (&i, &q)) in i.iter().zip(q).enumerate() {
            assert!((f32::from(i) - (n + 30) as f32 * scale).abs() <= 0.51);
            assert!((f32::from(q) + 2.0 * (n + 30) as f32 * scale).abs() <= 0.51);
        }
        assert!(buffer.window(29, 40).is_none() && buffer.window(100, 111).is_none());
    }
}
