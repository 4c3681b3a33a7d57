//! A simple signal generator for the unit tests of acquisition and tracking.

use crate::gnss::{Sv, signal};
use num_complex::{Complex32, Complex64};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// A satellite's signal in noise of unit variance.
pub struct TestSignal {
    pub rate: f64,
    pub doppler: f64,
    /// Start of the first code period after the first sample, s.
    pub delay_s: f64,
    pub cn0_dbhz: f64,
    /// Attenuation that is reached, linearly in dB, after `fade_s` seconds.
    pub fade_db: f64,
    pub fade_s: f64,
    /// Code period (after the first sample) at which a data symbol starts.
    pub symbol_edge: i64,
    pub seed: u64,
}

/// The data bits of every test signal.
pub fn data_bit(bit: i64) -> f64 {
    let hash = (bit.wrapping_mul(0x9E37_79B9_7F4A_7C15u64 as i64) >> 40) ^ bit;
    if hash & 1 == 0 { 1.0 } else { -1.0 }
}

impl TestSignal {
    pub fn samples(&self, sv: Sv, len: usize) -> Vec<Complex32> {
        let transmission = signal::of(sv);
        let (chips, clock) = (transmission.code(), transmission.clock(self.doppler));
        let amplitude = (10f64.powf(self.cn0_dbhz / 10.0) / self.rate).sqrt();
        let mut samples = four_valued_noise(len, self.seed);
        for (n, sample) in samples.iter_mut().enumerate() {
            let t = n as f64 / self.rate;
            let phase = (t - self.delay_s) * clock.chip_rate_hz;
            let chip = f64::from(chips[(phase.floor() as i64).rem_euclid(1023) as usize]);
            let bit = ((phase / 1023.0).floor() as i64 - self.symbol_edge).div_euclid(20);
            let amplitude =
                amplitude * 10f64.powf(-self.fade_db * (t / self.fade_s.max(1e-9)).min(1.0) / 20.0);
            let s = Complex64::cis(TAU * self.doppler * t) * amplitude * chip * data_bit(bit);
            *sample += Complex32::new(s.re as f32, s.im as f32);
        }
        samples
    }
}

/// (+-1 +-j)/sqrt(2): unit variance, and Gaussian after the sums of a correlation.
pub fn four_valued_noise(len: usize, seed: u64) -> Vec<Complex32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let level = std::f32::consts::FRAC_1_SQRT_2;
    let mut noise = Vec::with_capacity(len + 32);
    while noise.len() < len {
        let word = rng.next_u64();
        let sign = |bit: u32| if word >> bit & 1 == 0 { level } else { -level };
        noise.extend((0..32).map(|k| Complex32::new(sign(2 * k), sign(2 * k + 1))));
    }
    noise.truncate(len);
    noise
}
