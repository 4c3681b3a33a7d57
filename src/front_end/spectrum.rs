//! Power spectra.

use num_complex::Complex32;
use sdr_rx_linalg::forward_transform;
use std::f64::consts::TAU;

/// Welch's estimate of the power spectrum (Welch 1967): the mean over half-overlapping segments of
/// `bins` samples under a Hann window. Bin k stands for frequency (k - `bins`/2) / `bins` x rate; white
/// noise of unit power gives 1 in every bin. Empty when there are fewer than `bins` samples.
pub fn power_spectrum(samples: &[Complex32], bins: usize) -> Vec<f64> {
    if bins == 0 || samples.len() < bins {
        return Vec::new();
    }
    let window: Vec<f32> =
        (0..bins).map(|k| (0.5 - 0.5 * (TAU * k as f64 / bins as f64).cos()) as f32).collect();
    let window_power: f64 = window.iter().map(|w| f64::from(*w).powi(2)).sum();
    let fft = forward_transform(bins);
    let mut scratch = vec![Complex32::ZERO; fft.get_inplace_scratch_len()];
    let mut segment = vec![Complex32::ZERO; bins];
    let mut power = vec![0.0; bins];
    let mut segments = 0.0;
    for start in (0..=samples.len() - bins).step_by((bins / 2).max(1)) {
        for ((s, x), w) in segment.iter_mut().zip(&samples[start..]).zip(&window) {
            *s = x * w;
        }
        fft.process_with_scratch(&mut segment, &mut scratch);
        for (k, x) in segment.iter().enumerate() {
            power[(k + bins / 2) % bins] += f64::from(x.norm_sqr());
        }
        segments += 1.0;
    }
    power.iter().map(|p| p / (segments * window_power)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tone_appears_at_its_frequency_with_the_power_of_the_window() {
        let tone: Vec<Complex32> =
            (0..4096).map(|n| Complex32::cis((TAU * 5.0 / 64.0 * n as f64) as f32)).collect();
        let spectrum = power_spectrum(&tone, 64);
        let largest = (0..64).max_by(|a, b| spectrum[*a].total_cmp(&spectrum[*b]));
        assert_eq!(largest, Some(32 + 5));
        // (sum w)^2 / sum w^2 = N (1/2)^2 / (3/8) for Hann; f32 phases are accurate to 1e-4 here.
        assert!((spectrum[37] - 64.0 * 0.25 / 0.375).abs() < 0.01);
        assert!(power_spectrum(&tone[..10], 64).is_empty());
    }
}
