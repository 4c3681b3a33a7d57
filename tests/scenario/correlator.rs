//! An open-loop correlator that measures a capture against the truth of a scenario.

use num_complex::{Complex32, Complex64};
use sdr_rx::gnss::{Sv, signal};
use sdr_rx::scenario::{SatelliteTruth, ScenarioSource};
use std::f64::consts::{PI, TAU};

/// Spacing of early and late, chips.
const SPACING: f64 = 0.5;

/// One code period: early, prompt and late sums per sample.
#[derive(Clone, Copy)]
pub struct Period {
    /// Code periods since the GPS epoch modulo a day, by the satellite's clock.
    pub index: i64,
    pub early: Complex64,
    pub prompt: Complex64,
    pub late: Complex64,
}

/// Measurements of a capture against the truth.
pub struct Measured {
    /// Code phase minus truth, chips.
    pub code_chips: f64,
    /// Doppler minus truth, Hz.
    pub doppler_hz: f64,
    /// Carrier phase of the signal minus truth, cycles, modulo half a cycle, at the first period.
    pub phase_cycles: f64,
    /// Carrier-to-noise density, dB-Hz.
    pub cn0_dbhz: f64,
    /// Sign of each code period, +1 or -1, up to a common one.
    pub signs: Vec<f64>,
}

fn truth_of(source: &ScenarioSource, sv: Sv, sample: u64) -> SatelliteTruth {
    source.truth_at(sample).satellites.into_iter().find(|s| s.sv == sv).expect("simulated")
}

/// Correlates whole code periods of `samples` (baseband, at the source's rate) with replicas that follow
/// the source's truth, anew every 20 periods.
pub fn periods(source: &ScenarioSource, samples: &[Complex32], rate: f64, sv: Sv) -> Vec<Period> {
    let code = signal::of(sv).code().iter().map(|&c| f64::from(c)).collect::<Vec<f64>>();
    let mut list = Vec::new();
    let mut sample = 0u64;
    while sample + (0.025 * rate) as u64 <= samples.len() as u64 {
        let truth = truth_of(source, sv, sample);
        let chip_step = (1.023e6 + truth.doppler_hz / 1540.0) / rate;
        // From the first sample of the next period on.
        let mut offset = ((1023.0 - truth.code_phase_chips) / chip_step).ceil();
        for k in 0..20 {
            let chip = truth.code_phase_chips + offset * chip_step - 1023.0 * f64::from(k + 1);
            let len = ((1023.0 - chip) / chip_step).ceil() as usize;
            let first = sample as usize + offset as usize;
            let cycles = truth.doppler_hz / rate;
            let mut carrier =
                Complex64::cis(TAU * (truth.carrier_phase_cycles.fract() - cycles * offset));
            let turn = Complex64::cis(-TAU * cycles);
            let [mut early, mut prompt, mut late] = [Complex64::ZERO; 3];
            for (n, x) in samples[first..first + len].iter().enumerate() {
                let z = Complex64::new(x.re.into(), x.im.into()) * carrier;
                carrier *= turn;
                let at = |shift: f64| {
                    code[(chip + n as f64 * chip_step + shift + 1023.0) as usize % 1023]
                };
                early += z * at(SPACING / 2.0);
                prompt += z * at(0.0);
                late += z * at(-SPACING / 2.0);
            }
            let scale = 1.0 / len as f64;
            let index = (truth.transmit_tow_s * 1e3).floor() as i64 + 1 + i64::from(k);
            list.push(Period {
                index,
                early: early * scale,
                prompt: prompt * scale,
                late: late * scale,
            });
            offset += len as f64;
        }
        sample += (0.02 * rate) as u64;
    }
    list
}

/// Estimates from code periods: Doppler from the squared prompts (data bits squared away), then signs
/// and phase, then the code phase from coherent early and late sums.
pub fn measure(periods: &[Period]) -> Measured {
    let period_s = 1e-3;
    let squares = |f: f64| -> Complex64 {
        let turned = |(k, p): (usize, &Period)| {
            p.prompt * p.prompt * Complex64::cis(-2.0 * TAU * f * k as f64 * period_s)
        };
        periods.iter().enumerate().map(turned).sum()
    };
    // Resolution 1 / (2 T): steps of a fifth of it, and a parabola through the best three.
    let step = 0.1 / (periods.len() as f64 * period_s);
    let grid = |k: i32| squares(f64::from(k) * step).norm();
    let half = (20.0 / step) as i32;
    let best = (-half..=half).max_by(|&a, &b| grid(a).total_cmp(&grid(b))).unwrap_or(0);
    let (a, b, c) = (grid(best - 1), grid(best), grid(best + 1));
    let doppler_hz = step * (f64::from(best) + 0.5 * (a - c) / (a - 2.0 * b + c));
    let half_phase = squares(doppler_hz).arg() / 2.0;
    let straight = |k: usize, z: Complex64| {
        z * Complex64::cis(-half_phase - TAU * doppler_hz * k as f64 * period_s)
    };
    let signs: Vec<f64> =
        periods.iter().enumerate().map(|(k, p)| straight(k, p.prompt).re.signum()).collect();
    let sum = |get: fn(&Period) -> Complex64| -> Complex64 {
        periods.iter().enumerate().map(|(k, p)| straight(k, get(p)) * signs[k]).sum()
    };
    let (early, prompt, late) = (sum(|p| p.early).re, sum(|p| p.prompt).re, sum(|p| p.late).re);
    let n = periods.len() as f64;
    let noise: f64 =
        periods.iter().enumerate().map(|(k, p)| straight(k, p.prompt).im.powi(2)).sum::<f64>() / n;
    Measured {
        // Triangle: (E - L) / (E + L) = 2 tau / (2 - d), tau > 0 when the replica lags the signal.
        code_chips: (1.0 - SPACING / 2.0) * (early - late) / (early + late),
        doppler_hz,
        phase_cycles: half_phase / TAU,
        cn0_dbhz: 10.0 * ((prompt / n).powi(2) / (2.0 * noise) / period_s).log10(),
        signs,
    }
}

/// Standard deviation of [`Measured::code_chips`] by thermal noise: early minus late of correlated noise
/// has variance 2 sigma^2 d, the sum E + L = 2 - d, so tau has d / (4 C/N0 T).
pub fn code_sigma(cn0_dbhz: f64, seconds: f64) -> f64 {
    (SPACING / (4.0 * 10f64.powf(cn0_dbhz / 10.0) * seconds)).sqrt()
}

/// Cramer-Rao bound of a frequency: sqrt(6 / (C/N0 T)) / (2 pi T) for a known phase.
pub fn doppler_sigma(cn0_dbhz: f64, seconds: f64) -> f64 {
    (6.0 / (10f64.powf(cn0_dbhz / 10.0) * seconds)).sqrt() / (2.0 * PI * seconds)
}
