//! Losses of a front end by theory.

use crate::gnss::signal::GPS_L1_CA;
use crate::scenario::fir::low_pass_taps;
use crate::scenario::quantiser::Quantiser;
use std::f64::consts::PI;

/// Loss of a quantiser of `bits` with Gaussian input, dB: with y = Q(x), a weak signal's power against the
/// noise's is E\[x y\]^2 / E\[y^2\] of that before (Bussgang 1952). 1.96 dB for one bit, 0.55 dB for two at
/// their best.
pub fn quantiser_loss_db(bits: u32, rms_steps: Option<f64>) -> f64 {
    // Midpoints of 2^15 steps from -8 to 8: the jumps of the quantiser, and the tails, are below 0.001 dB.
    const STEPS: usize = 1 << 15;
    let x: Vec<f32> = (0..STEPS).map(|k| (16.0 * (k as f32 + 0.5) / STEPS as f32) - 8.0).collect();
    let mut y = x.clone();
    Quantiser::new(bits, rms_steps).apply(&mut y);
    let (mut mass, mut cross, mut power) = (0.0, 0.0, 0.0);
    for (&x, &y) in x.iter().zip(&y) {
        let (x, y) = (f64::from(x), f64::from(y));
        let density = (-x * x / 2.0).exp();
        mass += density;
        cross += density * x * y;
        power += density * y * y;
    }
    -10.0 * (cross * cross / (mass * power)).log10()
}

/// Loss of the front end's low-pass of a two-sided bandwidth, dB, where noise and code are sampled at
/// `rate_hz` and correlated with a code of unlimited bandwidth: (integral S H)^2 / integral S H^2, S the
/// spectrum of the code with its aliases, of unit power, and H the filter.
pub fn band_loss_db(bandwidth_hz: f64, rate_hz: f64) -> f64 {
    const STEPS: usize = 2048;
    let taps = low_pass_taps(bandwidth_hz / rate_hz);
    let middle = (taps.len() / 2) as f64;
    let (mut whole, mut signal, mut noise) = (0.0, 0.0, 0.0);
    for k in 0..STEPS {
        let f = (k as f64 + 0.5) / STEPS as f64 - 0.5;
        let tap =
            |(n, &h): (usize, &f32)| f64::from(h) * (2.0 * PI * f * (n as f64 - middle)).cos();
        let gain: f64 = taps.iter().enumerate().map(tap).sum();
        let density = folded_code_density(f * rate_hz, rate_hz);
        whole += density;
        signal += density * gain;
        noise += density * gain * gain;
    }
    -10.0 * (signal * signal / (noise * whole)).log10()
}

/// Power of another satellite's code after the correlator over that of white noise, per dB-Hz of its C/N0 as a
/// ratio, s: integral S^2, the spectral separation of the code from itself (2/3 of a chip without aliasing).
pub fn code_separation_s(rate_hz: f64) -> f64 {
    const STEPS: usize = 2048;
    let step = rate_hz / STEPS as f64;
    let f = (0..STEPS).map(|k| (k as f64 + 0.5) * step - rate_hz / 2.0);
    let (sum, squares) = f.fold((0.0, 0.0), |(sum, squares), f| {
        let density = folded_code_density(f, rate_hz);
        (sum + density * step, squares + density * density * step)
    });
    squares / (sum * sum)
}

/// Density of a code of random chips after sampling, up to a factor: sinc^2 and its aliases.
fn folded_code_density(f_hz: f64, rate_hz: f64) -> f64 {
    let sinc2 = |x: f64| if x == 0.0 { 1.0 } else { ((PI * x).sin() / (PI * x)).powi(2) };
    (-50..=50).map(|k| sinc2((f_hz + f64::from(k) * rate_hz) / GPS_L1_CA.chip_rate_hz)).sum()
}

/// Noise of a front end over that of the antenna alone, dB: (T_A + T_0 (F - 1)) / T_A with the antenna temperature
/// of the sky and some ground, T_A = 130 K, and T_0 = 290 K (Kaplan and Hegarty, 3rd ed., 8.3).
pub fn noise_figure_loss_db(noise_figure_db: f64) -> f64 {
    const ANTENNA_K: f64 = 130.0;
    const REFERENCE_K: f64 = 290.0;
    let factor = 10f64.powf(noise_figure_db / 10.0);
    10.0 * (1.0 + REFERENCE_K * (factor - 1.0) / ANTENNA_K).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantisers_lose_the_published_amounts() {
        // pi / 2; Max (1960), table II: 1 / (1 - 0.1175), 1 / (1 - 0.03744) for the best uniform 2 and 3 bits
        // (0.1188 with a step of 0.9957 rms).
        assert!((quantiser_loss_db(1, None) - 10.0 * (PI / 2.0).log10()).abs() < 1e-3);
        assert!((quantiser_loss_db(2, None) + 10.0 * (1f64 - 0.1188).log10()).abs() < 2e-3);
        assert!((quantiser_loss_db(3, None) + 10.0 * (1f64 - 0.03744).log10()).abs() < 2e-3);
        assert!(quantiser_loss_db(8, None) < 0.002);
    }

    #[test]
    fn the_main_lobe_holds_nine_tenths_of_the_codes_power() {
        // Integral of sinc^2 from -1 to 1: 0.9028 (Kaplan and Hegarty, 3rd ed., 3.2.3); the filter's edges are
        // not vertical, and what lies beyond 20 MHz is folded back.
        assert!((band_loss_db(2.046e6, 40e6) + 10.0 * 0.9028f64.log10()).abs() < 0.05);
        assert!(band_loss_db(20e6, 40e6) < 0.1);
        assert!((code_separation_s(40e6) * 1.023e6 - 2.0 / 3.0).abs() < 0.01);
        assert_eq!(noise_figure_loss_db(0.0), 0.0);
    }
}
