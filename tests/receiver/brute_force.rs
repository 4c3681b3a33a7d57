//! A straightforward measurement of a satellite in samples: a replica, a carrier, a sum. It uses nothing of the
//! receiver but the C/A codes.

use num_complex::{Complex32, Complex64};
use sdr_rx::gnss::signal::{GPS_L1_CA, L1_CENTRE_HZ};
use sdr_rx::gnss::{Sv, signal};
use std::f64::consts::TAU;

/// Code periods summed coherently.
const BLOCK: usize = 10;

/// Samples and their format.
pub struct Signal {
    pub samples: Vec<Complex32>,
    pub rate_hz: f64,
    pub if_hz: f64,
}

/// Result of the scan.
#[derive(Clone, Copy, Debug)]
pub struct Peak {
    /// Doppler, Hz.
    pub doppler_hz: f64,
    /// Power there over the mean power 200 Hz and more away from it.
    pub ratio: f64,
}

impl Signal {
    /// Doppler of a satellite whose codes start `offset_s` after the first sample: the maximum power
    /// of sums over 10 ms. Even or odd blocks of 10 ms hold no edge of a data bit: the better half counts.
    pub fn doppler(&self, sv: Sv, offset_s: f64) -> Peak {
        let code = signal::of(sv).code().iter().map(|&c| f32::from(c)).collect::<Vec<f32>>();
        let around = |ms: usize, list: &mut dyn Iterator<Item = f64>| {
            let power = |f: f64| block_power(&self.prompts(&code, offset_s, f, ms), 0.0);
            list.map(|f| (f, power(f)))
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .map_or(0.0, |best| best.0)
        };
        // 10 ms sums are 100 Hz wide: 50 Hz steps miss no peak.
        let coarse = around(20, &mut (-100..=100).map(|k| 50.0 * f64::from(k)));
        let prompts = self.prompts(&code, offset_s, coarse, usize::MAX);
        let power = |f: f64| block_power(&prompts, f);
        let fine = (-400..=400).map(|k| 0.25 * f64::from(k));
        let best =
            fine.map(|f| (f, power(f))).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
        let away: Vec<f64> = (8..20)
            .flat_map(|k| [-1.0, 1.0].map(|s| power(best.0 + s * 25.0 * f64::from(k))))
            .collect();
        let ratio = best.1 / (away.iter().sum::<f64>() / away.len() as f64);
        Peak { doppler_hz: coarse + best.0, ratio }
    }

    /// Sums over each of the first `count` code periods, after a carrier of this Doppler is removed.
    fn prompts(
        &self,
        code: &[f32],
        offset_s: f64,
        doppler_hz: f64,
        count: usize,
    ) -> Vec<Complex64> {
        let chip_rate = GPS_L1_CA.chip_rate_hz * (1.0 + doppler_hz / L1_CENTRE_HZ);
        let turn = Complex64::cis(-TAU * (self.if_hz + doppler_hz) / self.rate_hz);
        let period =
            |k: usize| (offset_s + (k * GPS_L1_CA.chips) as f64 / chip_rate) * self.rate_hz;
        let step = chip_rate / self.rate_hz;
        (0..count)
            .take_while(|&k| period(k + 1) < self.samples.len() as f64)
            .map(|k| {
                let (first, last) = (period(k).ceil() as usize, period(k + 1).ceil() as usize);
                let cycles = (self.if_hz + doppler_hz) / self.rate_hz * first as f64;
                let mut carrier = Complex64::cis(-TAU * cycles.fract());
                let mut chips = (first as f64 - period(k)) * step;
                let mut sum = Complex64::ZERO;
                for sample in &self.samples[first..last] {
                    let chip = f64::from(code[(chips as usize).min(GPS_L1_CA.chips - 1)]);
                    sum += Complex64::new(sample.re.into(), sample.im.into()) * carrier * chip;
                    carrier *= turn;
                    chips += step;
                }
                sum
            })
            .collect()
    }
}

/// Power of the prompts at a frequency, in sums of ten: the larger of even and odd blocks.
fn block_power(prompts: &[Complex64], frequency_hz: f64) -> f64 {
    let turn = Complex64::cis(-TAU * frequency_hz * 1e-3);
    let mut halves = [0.0; 2];
    for (k, block) in prompts.chunks_exact(BLOCK).enumerate() {
        halves[k % 2] +=
            block.iter().rev().fold(Complex64::ZERO, |sum, p| sum * turn + p).norm_sqr();
    }
    halves[0].max(halves[1])
}
