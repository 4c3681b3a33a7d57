use super::*;
use crate::gnss::constants::SPEED_OF_LIGHT;
use crate::gnss::signal;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const SATELLITES: u8 = 8;
const WINDOW_S: f64 = 50.0;
/// Code noise that is white at 1 s.
const SMOOTHING: Smoothing = Smoothing { window_s: WINDOW_S, correlation_s: 1e-3 };

fn range_m(prn: u8, t: f64) -> f64 {
    2.2e7 + 1e5 * f64::from(prn) + (60.0 * f64::from(prn) - 300.0) * t + 0.03 * t * t
}

/// Epochs of so many seconds, code noise of 1 m; carrier cycles of satellite 3 slip by `slip_m` at 120 s, of which no lock
/// is lost.
fn epochs(seconds: usize, slip_m: f64, seed: u64) -> Vec<ObservationEpoch> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let start = GpsTime::from_week_tow(2190, 1000.0);
    let mut observation = |prn: u8, t: f64| {
        let transmission = signal::of(format!("G{prn:02}").parse().unwrap());
        let noise: f64 = StandardNormal.sample(&mut rng);
        let wavelength_m = SPEED_OF_LIGHT / transmission.carrier_hz();
        let slipped_m = if prn == 3 && t >= 120.0 { slip_m } else { 0.0 };
        let rate_mps = range_m(prn, t + 0.5) - range_m(prn, t - 0.5);
        Observation {
            transmission,
            range: Some(CodeRange::Pseudorange(range_m(prn, t) + noise)),
            range_sigma_m: 1.0,
            doppler_hz: Some(-rate_mps / wavelength_m),
            doppler_sigma_hz: 0.1,
            carrier_phase_cycles: Some((range_m(prn, t) + slipped_m) / wavelength_m + 1234.5),
            lost_lock: t == 0.0,
            cn0_dbhz: Some(45.0),
        }
    };
    (0..seconds)
        .map(|k| ObservationEpoch {
            receive_time: start + k as f64,
            sample: k as f64,
            observations: (1..=SATELLITES).map(|prn| observation(prn, k as f64)).collect(),
        })
        .collect()
}

/// Errors of smoothed pseudoranges and their standard deviations, m, of the epochs from `first` on.
fn errors(smoothed: &[ObservationEpoch], first: usize) -> Vec<(f64, f64)> {
    let error = |epoch: &ObservationEpoch, o: &Observation| {
        let expected = range_m(o.sv().number(), epoch.sample);
        (o.pseudorange_m().unwrap() - expected, o.range_sigma_m)
    };
    smoothed[first..]
        .iter()
        .flat_map(|epoch| epoch.observations.iter().map(move |o| error(epoch, o)))
        .collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v * v, n + 1.0));
    (sum / count).sqrt()
}

/// White noise of 1 m: an average of gain 1/W leaves 1 / sqrt(2 W - 1), that from both sides half of the variance. Errors
/// of one run and satellite are correlated over the window, so that 20 runs of 8 satellites count: rms to 1 / sqrt(320),
/// four of them. Stated is what a divergence up to 2 mm/s may add, too.
#[test]
fn smoothed_pseudoranges_have_the_noise_of_theory_and_state_no_less() {
    let (mut one, mut both) = (Vec::new(), Vec::new());
    for seed in 0..20 {
        let epochs = epochs(200, 0.0, seed);
        let mut smoother = Smoother::new(SMOOTHING);
        let forwards: Vec<_> = epochs.iter().map(|e| smoother.smooth(e)).collect();
        one.extend(errors(&forwards[..150], 149));
        both.extend(errors(&smooth_recording(&epochs, &SMOOTHING)[..101], 100));
    }
    let theory = (2.0 * WINDOW_S - 1.0).sqrt().recip();
    for (list, expected) in [(one, theory), (both, theory / 2f64.sqrt())] {
        let found = rms(list.iter().map(|e| e.0));
        let normalised = rms(list.iter().map(|(error, sigma)| error / sigma));
        println!("{found:.4} m, theory {expected:.4} m; over what is stated {normalised:.2}");
        assert!((found / expected - 1.0).abs() < 4.0 / 320f64.sqrt(), "{found} {expected}");
        assert!(normalised < 1.0 + 4.0 / 320f64.sqrt(), "{normalised}");
    }
}

/// Ten cycles are 1.9 m, within the noise of the code: the phase itself does not fit the Dopplers. Afterwards errors are
/// those of an average that began there.
#[test]
fn a_cycle_slip_leaves_no_bias() {
    let epochs = epochs(200, 10.0 * 0.1903, 7);
    let mut smoother = Smoother::new(SMOOTHING);
    let forwards: Vec<_> = epochs.iter().map(|e| smoother.smooth(e)).collect();
    for smoothed in [forwards, smooth_recording(&epochs, &SMOOTHING)] {
        let all = errors(&smoothed, 121);
        assert!(all.iter().all(|(error, sigma)| error.abs() < 5.0 * sigma), "{all:?}");
    }
}
