//! Statistics of the samples, which show a faulty front end or a wrong sample type.

use num_complex::{Complex32, Complex64};
use serde::Serialize;

/// Maximum number of distinct values that are counted one by one.
const MAX_LEVELS: usize = 16;

/// Statistics of the samples of one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Number of samples.
    pub samples: u64,
    /// Mean of I (the offset of a converter).
    pub mean_i: f64,
    /// Mean of Q.
    pub mean_q: f64,
    /// Root mean square of the samples about their mean.
    pub rms: f64,
    /// Maximum magnitude of I or Q.
    pub peak: f64,
    /// Fraction of the numbers (I and Q) that have the maximum magnitude: above 1 % a converter of many
    /// levels clips.
    pub at_peak: f64,
    /// Mean square of I over that of Q about their means, dB; 0 is right. Absent for real samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iq_gain_db: Option<f64>,
    /// Correlation of I and Q as the error of their quadrature, degrees; 0 is right.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iq_phase_deg: Option<f64>,
    /// Fourth moment of the numbers over the squared second: 3 for Gaussian noise, 1.8 for uniform,
    /// 1 for two values, more than 3 for impulses.
    pub kurtosis: f64,
    /// Values with their frequencies (fractions of all numbers), where there are at most 16.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values: Option<Vec<(f32, f64)>>,
}

/// Accumulates the [`Level`] of a channel, slice by slice.
#[derive(Clone, Debug, Default)]
pub struct LevelMeter {
    samples: u64,
    sums: [f64; 2],
    squares: [f64; 2],
    cubes: [f64; 2],
    fourths: [f64; 2],
    product: f64,
    peak: f32,
    peak_count: u64,
    values: Vec<(f32, u64)>,
    too_many: bool,
}

impl LevelMeter {
    /// Adds samples.
    pub fn add(&mut self, samples: &[Complex32]) {
        for x in samples {
            let z = Complex64::new(x.re.into(), x.im.into());
            for (k, v) in [z.re, z.im].into_iter().enumerate() {
                let v2 = v * v;
                self.sums[k] += v;
                self.squares[k] += v2;
                self.cubes[k] += v2 * v;
                self.fourths[k] += v2 * v2;
            }
            self.product += z.re * z.im;
        }
        self.samples += samples.len() as u64;
        for value in samples.iter().flat_map(|x| [x.re, x.im]) {
            self.count(value);
        }
    }

    fn count(&mut self, value: f32) {
        let magnitude = value.abs();
        if magnitude > self.peak {
            (self.peak, self.peak_count) = (magnitude, 0);
        }
        self.peak_count += u64::from(magnitude == self.peak);
        if !self.too_many {
            match self.values.iter_mut().find(|(known, _)| *known == value) {
                Some((_, count)) => *count += 1,
                None => self.values.push((value, 1)),
            }
            self.too_many = self.values.len() > MAX_LEVELS;
        }
    }

    /// The level of what was added; `real` samples have no Q. `None` when nothing was added.
    pub fn level(&self, real: bool) -> Option<Level> {
        if self.samples == 0 {
            return None;
        }
        let n = self.samples as f64;
        let mean = self.sums.map(|s| s / n);
        let variance = [0, 1].map(|k| (self.squares[k] / n - mean[k] * mean[k]).max(0.0));
        let central_fourth = [0, 1].map(|k| {
            let (m, m2, m3, m4) =
                (mean[k], self.squares[k] / n, self.cubes[k] / n, self.fourths[k] / n);
            m4 - 4.0 * m * m3 + 6.0 * m * m * m2 - 3.0 * m.powi(4)
        });
        let power = variance[0] + variance[1];
        let correlation =
            (self.product / n - mean[0] * mean[1]) / (variance[0] * variance[1]).sqrt();
        let parts = if real { 1 } else { 2 };
        let fourth: f64 = central_fourth[..parts].iter().sum::<f64>() / parts as f64;
        let second = power / parts as f64;
        let numbers = n * parts as f64;
        // The zeros in place of Q of real samples are not counted.
        let zero_q = if real { self.samples } else { 0 };
        let frequency = |&(value, count): &(f32, u64)| {
            let count = if value == 0.0 { count.saturating_sub(zero_q) } else { count };
            (count > 0).then_some((value, count as f64 / numbers))
        };
        let mut values: Vec<(f32, f64)> = self.values.iter().filter_map(frequency).collect();
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        Some(Level {
            samples: self.samples,
            mean_i: mean[0],
            mean_q: mean[1],
            rms: power.sqrt(),
            peak: f64::from(self.peak),
            at_peak: self.peak_count.saturating_sub(if self.peak == 0.0 { zero_q } else { 0 })
                as f64
                / numbers,
            iq_gain_db: (!real && variance[1] > 0.0)
                .then(|| 10.0 * (variance[0] / variance[1]).log10()),
            iq_phase_deg: (!real && correlation.is_finite())
                .then(|| correlation.clamp(-1.0, 1.0).asin().to_degrees()),
            kurtosis: if second > 0.0 { fourth / (second * second) } else { 0.0 },
            values: (!self.too_many).then_some(values),
        })
    }
}

impl Level {
    /// Properties of this level that do not fit thermal noise, which dominates the samples of a GNSS front
    /// end, and their possible causes.
    pub fn warnings(&self) -> Vec<String> {
        let Self { rms, peak, kurtosis, .. } = *self;
        let varies = rms > 0.0;
        let offset = self.mean_i.hypot(self.mean_q);
        let gain = self.iq_gain_db.unwrap_or(0.0);
        let magnitudes = self.values.iter().flatten().map(|(value, _)| f64::from(value.abs()));
        let lowest = magnitudes.fold(f64::INFINITY, f64::min);
        let many_levels = self.values.as_ref().is_none_or(|v| v.len() > 8);
        let warnings = [
            (rms == 0.0, "all samples are equal: there is no signal in them".to_owned()),
            (
                varies && offset > 0.7 * rms,
                format!(
                    "the mean {offset:.3} is large against the rms {rms:.3}: the sample type may be \
                     wrong (signed for unsigned, or 8 for 16 bits)"
                ),
            ),
            (
                gain.abs() > 3.0,
                format!(
                    "I and Q differ by {gain:.1} dB: the sample type may be wrong (16 bits read as 8, \
                     real read as complex, or a wrong number of channels)"
                ),
            ),
            // The levels of a coarse converter, symmetric about 0, have a ratio of 1 to 3 at least.
            (
                lowest > 0.6 * peak && lowest < peak,
                format!(
                    "all numbers lie between {lowest} and {peak} in magnitude, none near 0: the sample \
                     type may be wrong (signed for unsigned)"
                ),
            ),
            // Uniformly distributed numbers have 1.8.
            (
                varies && many_levels && kurtosis < 1.7,
                format!(
                    "the numbers crowd at their extremes (kurtosis {kurtosis:.2}, Gaussian noise has \
                     3): the sample type may be wrong (signed for unsigned), or the front end is \
                     overdriven"
                ),
            ),
            (
                kurtosis > 1e3 || !rms.is_finite() || peak > 1e12,
                format!(
                    "the numbers span an impossible range (peak {peak:.3e}, rms {rms:.3e}): integers may \
                     have been read as floating-point numbers"
                ),
            ),
        ];
        warnings.into_iter().filter_map(|(is, text)| is.then_some(text)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn noise(n: usize, level: f64) -> Vec<Complex32> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        (0..n).map(|_| Complex32::new((level * draw()) as f32, (level * draw()) as f32)).collect()
    }

    fn level(samples: &[Complex32]) -> Level {
        let mut meter = LevelMeter::default();
        meter.add(samples);
        meter.level(false).unwrap()
    }

    #[test]
    fn gaussian_noise_has_its_moments() {
        let n = 100_000;
        let l = level(&noise(n, 20.0));
        // Five standard deviations of each estimate: mean sigma/sqrt n, power 1/sqrt n of itself,
        // kurtosis sqrt(24/2n), gain 2/sqrt n in power, correlation 1/sqrt n.
        let root = (n as f64).sqrt();
        assert!(l.mean_i.abs() < 5.0 * 20.0 / root && l.mean_q.abs() < 5.0 * 20.0 / root);
        assert!((l.rms / (20.0 * 2f64.sqrt()) - 1.0).abs() < 2.5 / root);
        assert!((l.kurtosis - 3.0).abs() < 5.0 * (12.0 / n as f64).sqrt());
        assert!(l.iq_gain_db.unwrap().abs() < 5.0 * 4.343 * 2.0 / root);
        assert!(l.iq_phase_deg.unwrap().abs() < (5.0 / root).to_degrees());
        assert_eq!(l.values, None);
        assert!(l.warnings().is_empty());
    }

    #[test]
    fn wrong_sample_types_give_warnings() {
        let integers: Vec<i8> = noise(50_000, 20.0)
            .iter()
            .flat_map(|x| [x.re.round() as i8, x.im.round() as i8])
            .collect();
        let pairs = |f: &dyn Fn(i8) -> f32| -> Vec<Complex32> {
            integers.chunks(2).map(|c| Complex32::new(f(c[0]), f(c[1]))).collect()
        };
        assert!(level(&pairs(&|v| f32::from(v))).warnings().is_empty());
        // cs8 read as cu8: small numbers go to both ends.
        assert!(!level(&pairs(&|v| f32::from(v as u8) - 127.5)).warnings().is_empty());
        // A few levels of a coarse converter, likewise.
        let coarse = |v: i8| f32::from((if v < 0 { 2 * v.signum() + 1 } else { 3 }) as u8) - 127.5;
        assert!(!level(&pairs(&coarse)).warnings().is_empty());
        // cs16 read as cs8: low bytes in I, high bytes in Q.
        let halves: Vec<Complex32> = integers
            .iter()
            .map(|&v| (i16::from(v) * 9).to_le_bytes())
            .map(|[low, high]| Complex32::new(f32::from(low as i8), f32::from(high as i8)))
            .collect();
        assert!(!level(&halves).warnings().is_empty());
        assert!(!level(&[Complex32::ONE; 10]).warnings().is_empty());
    }

    #[test]
    fn few_values_are_counted_and_zero_q_of_real_samples_is_not() {
        let mut meter = LevelMeter::default();
        meter.add(&[1.0, 3.0, -3.0, 1.0].map(|x| Complex32::new(x, 0.0)));
        let l = meter.level(true).unwrap();
        assert_eq!(l.values, Some(vec![(-3.0, 0.25), (1.0, 0.5), (3.0, 0.25)]));
        assert_eq!((l.peak, l.at_peak, l.mean_i, l.iq_gain_db), (3.0, 0.5, 0.5, None));
    }
}
