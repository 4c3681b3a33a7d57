//! A linear-phase low-pass filter for complex streams.

use multiversion::multiversion;
use num_complex::Complex32;

/// Taps on either side of the centre.
const HALF: usize = 32;

/// Taps of a windowed-sinc low-pass (Hamming) with its two-sided -6 dB `bandwidth` as a fraction of the
/// sampling rate, 0 to 1; unit gain at zero, stop band below -50 dB beyond 0.026 of the rate from
/// the edge.
pub fn low_pass_taps(bandwidth: f64) -> Vec<f32> {
    use std::f64::consts::PI;
    let taps: Vec<f64> = (0..=2 * HALF)
        .map(|i| {
            let n = i as f64 - HALF as f64;
            let sinc = if n == 0.0 { bandwidth } else { (PI * bandwidth * n).sin() / (PI * n) };
            sinc * (0.54 + 0.46 * (PI * n / HALF as f64).cos())
        })
        .collect();
    let sum: f64 = taps.iter().sum();
    taps.iter().map(|h| (h / sum) as f32).collect()
}

/// The filter and its state.
#[derive(Clone, Debug)]
pub struct LowPass {
    taps: Vec<f32>,
    input: Vec<Complex32>,
}

impl LowPass {
    /// A filter with symmetric `taps`, whose past is zero.
    pub fn new(taps: Vec<f32>) -> Self {
        let input = vec![Complex32::ZERO; taps.len() - 1];
        Self { taps, input }
    }

    /// Delay of the output, samples.
    pub fn delay(&self) -> usize {
        self.taps.len() / 2
    }

    /// Filters the next samples in place: 2 x taps multiplications per complex sample.
    pub fn process(&mut self, samples: &mut [Complex32]) {
        let past = self.taps.len() - 1;
        self.input.extend_from_slice(samples);
        convolve(&self.taps, bytemuck::cast_slice(&self.input), bytemuck::cast_slice_mut(samples));
        self.input.drain(..self.input.len() - past);
    }
}

/// `output`[k] = sum over t of `taps`[t] `input`[k + 2t], k over interleaved I and Q.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "aarch64+neon"))]
fn convolve(taps: &[f32], input: &[f32], output: &mut [f32]) {
    const LANES: usize = 64;
    for (start, out) in (0..).step_by(LANES).zip(output.chunks_mut(LANES)) {
        let mut sum = [0.0f32; LANES];
        if out.len() == LANES {
            for (t, h) in taps.iter().enumerate() {
                let window = &input[start + 2 * t..start + 2 * t + LANES];
                for l in 0..LANES {
                    sum[l] += h * window[l];
                }
            }
        } else {
            for (t, h) in taps.iter().enumerate() {
                for (l, s) in sum[..out.len()].iter_mut().enumerate() {
                    *s += h * input[start + 2 * t + l];
                }
            }
        }
        out.copy_from_slice(&sum[..out.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;

    #[test]
    fn tones_pass_inside_the_band_and_stop_outside_whatever_the_blocks() {
        let taps = low_pass_taps(0.5);
        for (cycles, low, high) in
            [(0.0, 0.999_99, 1.000_01), (0.2, 0.99, 1.01), (0.25, 0.49, 0.51), (0.3, 0.0, 0.004)]
        {
            let tone = |k: usize| {
                let z = Complex64::cis(std::f64::consts::TAU * cycles * k as f64);
                Complex32::new(z.re as f32, z.im as f32)
            };
            let mut whole: Vec<Complex32> = (0..1000).map(tone).collect();
            let mut parts = whole.clone();
            LowPass::new(taps.clone()).process(&mut whole);
            let mut filter = LowPass::new(taps.clone());
            let (a, b) = parts.split_at_mut(333);
            filter.process(a);
            filter.process(b);
            assert_eq!(whole, parts);
            // Linear phase: after the delay the tone comes out in phase.
            let ratio = whole[900] * tone(900 - filter.delay()).conj();
            assert!((low..high).contains(&ratio.norm()), "{cycles}: {ratio}");
            assert!(ratio.re > -0.01 && ratio.im.abs() < 0.01);
        }
    }

    #[test]
    fn the_convolution_agrees_with_its_scalar_version() {
        let taps: Vec<f32> = (0..9).map(|t| 0.1 * t as f32 - 0.3).collect();
        let input: Vec<f32> = (0..2 * (100 + 8)).map(|k| ((k * 37) % 101) as f32 / 101.0).collect();
        let mut output = vec![0.0; 200];
        convolve(&taps, &input, &mut output);
        for (k, &got) in output.iter().enumerate() {
            let plain: f64 = (0..9).map(|t| f64::from(taps[t]) * f64::from(input[k + 2 * t])).sum();
            // Nine roundings of values below 1.
            assert!((f64::from(got) - plain).abs() < 9.0 * 2f64.powi(-24));
        }
    }
}
