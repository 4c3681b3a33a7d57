//! Detections that are only the cross-correlation with a stronger satellite.
//!
//! Two C/A codes correlate to up to -23.9 dB at equal Dopplers, and to about -21 dB where the Dopplers
//! differ by a multiple of 1 kHz (Kaplan & Hegarty, 3rd ed., 8.7.2). The fraction of a weak detection's power
//! that a given strong satellite explains follows from the two codes and phases, and is computed.

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

/// No two C/A codes correlate to more than -19 dB at any Doppler: only a satellite stronger by this can explain another
/// to the fraction above.
pub(super) const MIN_SUPPRESSION: f64 = 80.0 * MIN_EXPLAINED / SCALLOPING;

/// Standard deviations by which noise may raise a cross-correlation: the maximum over the many cells that
/// show it.
const NOISE_SIGMAS: f64 = 5.0;

/// Whether a detection of so much power is a cross-correlation measured as `there` (both over the noise of one of so
/// many looks).
pub(super) fn explains(there: f64, measured: f64, looks: usize) -> bool {
    let explained = SCALLOPING * there;
    // Noise raises the mean power of the looks by this.
    let raise = NOISE_SIGMAS * ((1.0 + 2.0 * explained) / looks as f64).sqrt();
    explained > MIN_EXPLAINED * measured && measured < explained + raise
}

/// Power of `strong`'s signal of unit power in a correlator set to `weak` with so many cycles per code period between
/// them, the maximum within half a chip of its code phase. Both codes have one length and rate.
pub(super) fn cross_power(strong: &Acquisition, weak: &Acquisition, cycles: i64) -> f64 {
    let (a, b) = (strong.transmission.code(), weak.transmission.code());
    let chip = |code: &[i8], phase: f64| {
        f64::from(code[(phase.floor() as i64).rem_euclid(code.len() as i64) as usize])
    };
    let total = strong.transmission.signal.chips * STEPS;
    let power = |shift: f64| {
        let sum: Complex64 = (0..total)
            .map(|n| {
                let chips = (n as f64 + 0.5) / STEPS as f64;
                let product = chip(&a, strong.code_phase_chips + chips)
                    * chip(&b, weak.code_phase_chips + shift + chips);
                Complex64::cis(TAU * cycles as f64 * n as f64 / total as f64) * product
            })
            .sum();
        (sum / total as f64).norm_sqr()
    };
    [-0.5, -0.25, 0.0, 0.25, 0.5].into_iter().map(power).fold(0.0, f64::max)
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
        let found = plan.search(&mixed).unwrap();
        let left: Vec<Sv> = found.iter().map(Acquisition::sv).collect();
        assert_eq!(left, [strong, weak], "{found:.1?}");
    }
}
