//! Uniform quantisers.

use multiversion::multiversion;

/// A uniform quantiser of I and Q with unit rms.
///
/// With 1 to 4 bits it is symmetric without zero and gives the odd numbers -(2^b - 1) .. 2^b - 1
/// (units of half a step); with 8 and 16 bits it rounds to integers within +-(2^(b-1) - 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantiser {
    bits: u32,
    steps_per_rms: f32,
}

impl Quantiser {
    /// A quantiser of 1, 2, 3, 4, 8 or 16 bits with the given rms in steps, or by default the step of
    /// minimum loss for Gaussian input (Max 1960, table II: 0.9957, 0.5860, 0.3352 rms for 2, 3, 4
    /// bits; 8 bits clip at 3.9 rms, 16 bits at 8 rms).
    pub fn new(bits: u32, rms_steps: Option<f64>) -> Self {
        let best = match bits {
            1 => 1.0,
            2 => 1.0 / 0.9957,
            3 => 1.0 / 0.5860,
            4 => 1.0 / 0.3352,
            8 => 32.5,
            _ => 4096.0,
        };
        Self { bits, steps_per_rms: rms_steps.unwrap_or(best) as f32 }
    }

    /// Quantises I and Q in place.
    pub fn apply(&self, values: &mut [f32]) {
        if self.bits <= 4 {
            let limit = ((1 << self.bits) - 1) as f32;
            odd(self.steps_per_rms, limit, values);
        } else {
            let limit = ((1 << (self.bits - 1)) - 1) as f32;
            integer(self.steps_per_rms, limit, values);
        }
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "aarch64+neon"))]
fn odd(scale: f32, limit: f32, values: &mut [f32]) {
    for x in values {
        *x = (2.0 * (*x * scale).floor() + 1.0).max(-limit).min(limit);
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "aarch64+neon"))]
fn integer(scale: f32, limit: f32, values: &mut [f32]) {
    for x in values {
        *x = (*x * scale + 0.5).floor().max(-limit).min(limit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::noise::{GaussianMixture, NoiseSource};

    /// Loss of SNR of a weak signal in Gaussian noise: with y = Q(x), the output SNR over the input's is
    /// (E[x y])^2 / E[y^2] (Bussgang).
    fn loss_db(bits: u32, rms_steps: Option<f64>) -> f64 {
        let n = 1 << 20;
        let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
        NoiseSource::new(GaussianMixture { probability: 0.0, ratio: 1.0 }, 11, 0)
            .add(0, &mut x, &mut y);
        x.append(&mut y);
        x.iter_mut().for_each(|v| *v *= 2f32.sqrt());
        let mut q = x.clone();
        Quantiser::new(bits, rms_steps).apply(&mut q);
        let mean = |f: &dyn Fn(f64, f64) -> f64| {
            x.iter().zip(&q).map(|(&a, &b)| f(a.into(), b.into())).sum::<f64>() / x.len() as f64
        };
        let cross = mean(&|a, b| a * b);
        -10.0 * (cross * cross / mean(&|_, b| b * b) / mean(&|a, _| a * a)).log10()
    }

    #[test]
    fn quantisers_have_the_theoretical_loss() {
        // 1 bit: 2/pi. 2, 3, 4 bits at the best uniform step: -10 log10(1 - distortion) with Max's
        // distortions 0.1188, 0.03744, 0.01154. Standard deviation of the estimate of E[xy] over 2^21 draws:
        // below 1e-3, 0.005 dB.
        for (bits, loss) in [(1, 1.961), (2, 0.549), (3, 0.1657), (4, 0.0504), (8, 0.0), (16, 0.0)]
        {
            let got = loss_db(bits, None);
            assert!((got - loss).abs() < 0.015, "{bits} bits: {got} dB, not {loss}");
        }
        assert!(loss_db(2, Some(2.0)) > 0.6 && loss_db(2, Some(0.3)) > 0.8);
    }

    #[test]
    fn levels_are_odd_numbers_or_integers_within_the_limits() {
        for (bits, limit) in [(1, 1.0), (2, 3.0), (3, 7.0), (4, 15.0)] {
            let mut x: Vec<f32> = (-500..500).map(|k| k as f32 * 0.013 + 0.001).collect();
            Quantiser::new(bits, None).apply(&mut x);
            assert!(x.iter().all(|v| v.abs() <= limit && v.rem_euclid(2.0) == 1.0));
            assert_eq!((x[0], x[999]), (-limit, limit));
        }
        let mut x = [-9.0, -0.4 / 32.5, 0.6 / 32.5, 9.0];
        Quantiser::new(8, None).apply(&mut x);
        assert_eq!(x, [-127.0, 0.0, 1.0, 127.0]);
    }
}
