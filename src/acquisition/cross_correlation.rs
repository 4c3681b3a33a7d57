//! Removal of detections that are only the cross-correlation with a stronger satellite.
//!
//! Two C/A codes correlate to up to -23.9 dB at equal Dopplers, and to about -21 dB where the Dopplers
//! differ by a multiple of 1 kHz (Kaplan & Hegarty, 3rd ed., 8.7.2). The fraction of a weak detection's power
//! that a given strong satellite explains follows from the two codes, phases and Dopplers, and is computed.

use super::Acquisition;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Steps per chip of the correlation integral.
const STEPS: usize = 4;

/// A detection can be cross-correlation only where a stronger satellite explains this fraction of its power.
const MIN_EXPLAINED: f64 = 0.2;

/// Maximum loss of a satellite's power between the bins of the search: a quarter chip (2.5 dB) and half a
/// Doppler bin (0.9 dB). The stronger satellite may be that much stronger than measured.
const SCALLOPING: f64 = 2.2;

/// Standard deviations by which noise may raise a cross-correlation: the maximum over the many cells that
/// show it.
const NOISE_SIGMAS: f64 = 5.0;

/// Removes detections that a stronger one explains, and returns each removed one with the satellite that
/// causes it. All come from one search of `windows` windows of `coherent_ms`.
pub fn remove_cross_correlations(
    found: &mut Vec<Acquisition>,
    coherent_ms: usize,
    windows: usize,
) -> Vec<(Acquisition, Acquisition)> {
    found.sort_by(|a, b| b.cn0_dbhz.total_cmp(&a.cn0_dbhz));
    let mut removed = Vec::new();
    let mut kept: Vec<Acquisition> = Vec::new();
    for weak in found.drain(..) {
        // Powers in units of the noise of one window; noise raises their mean over the windows by
        // sqrt((1 + 2 power) / windows).
        let snr = |a: &Acquisition| 10f64.powf(a.cn0_dbhz / 10.0) * coherent_ms as f64 * 1e-3;
        let measured = snr(&weak);
        let explained = |strong: &&Acquisition| {
            // No two C/A codes correlate to more than -19 dB at any Doppler.
            let maximum = SCALLOPING * snr(strong) / 80.0;
            maximum > MIN_EXPLAINED * measured && {
                let explained = SCALLOPING * snr(strong) * cross_power(strong, &weak, coherent_ms);
                let raise = NOISE_SIGMAS * ((1.0 + 2.0 * explained) / windows as f64).sqrt();
                explained > MIN_EXPLAINED * measured && measured < explained + raise
            }
        };
        match kept.iter().find(explained) {
            Some(strong) => removed.push((weak, *strong)),
            None => kept.push(weak),
        }
    }
    *found = kept;
    removed
}

/// Power of `strong`'s signal of unit power in a correlator set to `weak`, the maximum within half a chip of
/// its code phase; none between codes of different lengths or rates.
fn cross_power(strong: &Acquisition, weak: &Acquisition, coherent_ms: usize) -> f64 {
    let signal = strong.transmission.signal;
    let other = weak.transmission.signal;
    if (signal.chips, signal.chip_rate_hz) != (other.chips, other.chip_rate_hz) {
        return 0.0;
    }
    let periods = (coherent_ms as f64 * 1e-3 / signal.period_s()).round().max(1.0);
    // Cycles in a code period.
    let turns = (strong.doppler_hz - weak.doppler_hz) * signal.period_s();
    let beat = turns - turns.round();
    let dirichlet = if beat.abs() < 1e-9 {
        1.0
    } else {
        ((TAU / 2.0 * beat * periods).sin() / (periods * (TAU / 2.0 * beat).sin())).powi(2)
    };
    let (a, b) = (strong.transmission.code(), weak.transmission.code());
    let chip = |code: &[i8], phase: f64| {
        f64::from(code[(phase.floor() as i64).rem_euclid(code.len() as i64) as usize])
    };
    let total = signal.chips * STEPS;
    let power = |shift: f64| {
        let sum: Complex64 = (0..total)
            .map(|n| {
                let chips = (n as f64 + 0.5) / STEPS as f64;
                let product = chip(&a, strong.code_phase_chips + chips)
                    * chip(&b, weak.code_phase_chips + shift + chips);
                Complex64::cis(TAU * turns * n as f64 / total as f64) * product
            })
            .sum();
        (sum / total as f64).norm_sqr()
    };
    [-0.5, -0.25, 0.0, 0.25, 0.5].into_iter().map(power).fold(0.0, f64::max) * dirichlet
}

#[cfg(test)]
mod tests {
    use super::super::{SearchOptions, SearchPlan};
    use super::*;
    use crate::correlator::test_signal::TestSignal;
    use crate::gnss::Sv;

    #[test]
    fn cross_correlations_of_a_strong_satellite_are_removed_and_a_weak_satellite_stays() {
        let (rate, len) = (2.048e6, 655_360);
        let strong: Sv = "G07".parse().unwrap();
        let weak: Sv = "G21".parse().unwrap();
        let signal = |sv, cn0_dbhz, doppler, seed| {
            TestSignal {
                rate,
                doppler,
                delay_s: 0.3e-3,
                cn0_dbhz,
                fade_db: 0.0,
                fade_s: 0.0,
                symbol_edge: 3,
                seed,
            }
            .samples(sv, len)
        };
        // 53 dB-Hz: its cross-correlations reach 32 dB-Hz, over the threshold after 32 windows of 10 ms.
        let mixed: Vec<_> = signal(strong, 53.0, 500.0, 1)
            .iter()
            .zip(signal(weak, 38.0, -1730.0, 2))
            .map(|(a, b)| a + b)
            .collect();
        let plan =
            SearchPlan::new(rate, SearchOptions { max_windows: 32, ..Default::default() }).unwrap();
        let mut found = plan.search(&mixed).unwrap();
        assert!(found.len() > 3, "no cross-correlation was detected: the test proves nothing");
        let removed = remove_cross_correlations(&mut found, 10, 32);
        assert!(removed.iter().all(|(_, by)| by.sv() == strong));
        let left: Vec<Sv> = found.iter().map(Acquisition::sv).collect();
        assert_eq!(left, [strong, weak], "{found:.1?}");
    }
}
