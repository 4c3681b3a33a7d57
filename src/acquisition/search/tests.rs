//! Satellites found at their cells, false alarms as rare as stated, impossible searches.

use super::*;
use crate::correlator::test_signal::{TestSignal, four_valued_noise};

#[test]
fn a_satellite_is_found_at_its_code_phase_and_doppler_at_every_kind_of_rate() {
    for (rate, doppler, delay) in [
        (2.6e6, 1234.0, 0.123e-3),
        (4e6, -4321.0, 0.9e-3),
        (5.456e6, 2500.0, 0.5e-3),
        (20e6, -10.0, 0.4444e-3),
        (2.048e6, 4987.0, 0.0),
    ] {
        let sv = "G17".parse().unwrap();
        let satellites = vec![signal::of(sv)];
        let plan =
            SearchPlan::new(rate, SearchOptions { satellites, ..Default::default() }).unwrap();
        let len = (rate * 20e-3) as usize;
        // A symbol edge in the middle of the first window must not hide it.
        let signal = TestSignal {
            rate,
            doppler,
            delay_s: delay,
            cn0_dbhz: 44.0,
            fade_db: 0.0,
            fade_s: 0.0,
            symbol_edge: 5,
            seed: 1,
        };
        let found = plan.search(&signal.samples(sv, len)).unwrap();
        assert_eq!(found.len(), 1, "{rate}");
        assert!((found[0].doppler_hz - doppler).abs() <= 100.0, "{rate}: {}", found[0].doppler_hz);
        let error = (found[0].code_offset_s() - delay + 0.5e-3).rem_euclid(1e-3) - 0.5e-3;
        assert!((error * 1.023e6).abs() < 0.5, "{rate}: {} chips", error * 1.023e6);
    }
}

#[test]
fn false_alarms_occur_with_the_requested_probability() {
    // 10^5 searches of pure noise: one satellite, +-500 Hz, one window of 1 ms, 1 % requested.
    const SEARCHES: usize = 100_000;
    let rate = 2.048e6;
    let options = SearchOptions {
        satellites: vec![signal::of("G05".parse().unwrap())],
        doppler_hz: (-500.0, 500.0),
        doppler_rate_hz_s: 0.0,
        coherent_ms: 1,
        max_windows: 1,
        false_alarm: 0.01,
    };
    let plan = SearchPlan::new(rate, options).unwrap();
    let alarms: usize = (0..SEARCHES as u64)
        .into_par_iter()
        .map(|seed| plan.search(&four_valued_noise(plan.window_len(), seed)).unwrap().len())
        .sum();
    // 1000 expected if all cells were independent, standard deviation 32; neighbours that exceed
    // together lower it by at most a tenth (see the module `statistics`).
    assert!((800..=1100).contains(&alarms), "{alarms} false alarms in {SEARCHES} searches");
}

/// Kinds of noise: samples of index n at `rate` of one draw, white noise `w` of power 1 per sample given.
type Noise = (&'static str, fn(f64, &mut [Complex32], f64));

const NOISES: [Noise; 10] = [
    ("a carrier 20 dB over the noise", |rate, x, u| {
        add(x, |n| 10.0 * cis(12_300.0 / rate * n + u))
    }),
    ("a carrier 40 dB over it, on a line of the codes", |rate, x, u| {
        add(x, |n| 100.0 * cis(3000.0 / rate * n + u));
    }),
    ("a carrier 10 dB over it at the centre", |_, x, u| add(x, |_| 3.16 * cis(u))),
    ("sweeps of 1.2 to 2 MHz in 1 ms", |rate, x, u| {
        // Each draw its own width: equal ones would show the same pattern in all draws.
        let t = move |n: f64| (n / rate * 1e3 + u).fract() - 0.5;
        let width = 600.0 + 400.0 * (u * 97.0).fract();
        add(x, move |n| 10.0 * cis(t(n).powi(2) * width));
    }),
    ("narrow noise", |rate, x, _| {
        // 50 kHz wide, 20 dB over the rest.
        let keep = 1.0 - (TAU * 25e3 / rate) as f32;
        let mut low = Complex32::ZERO;
        for x in x {
            low = low * keep + *x * (1.0 - keep);
            *x += low * 87.0;
        }
    }),
    ("noise of a slope", |_, x, _| {
        let mut last = Complex32::ZERO;
        for x in x {
            last = last * 0.6 + *x;
            *x = last;
        }
    }),
    ("a gain step of 20 dB", |_, x, u| {
        let at = (u * x.len() as f64) as usize;
        x[at..].iter_mut().for_each(|x| *x *= 10.0);
    }),
    ("silence at the start", |_, x, u| {
        let until = (0.95 * u * x.len() as f64) as usize;
        x[..until].fill(Complex32::ZERO);
    }),
    ("bursts of 30 dB, a tenth of the time", |rate, x, u| {
        let is_on = |n: usize| (n as f64 / rate * 170.0 + u).fract() < 0.1;
        for (_, x) in x.iter_mut().enumerate().filter(|x| is_on(x.0)) {
            *x *= 31.6;
        }
    }),
    ("a few impulses", |_, x, u| {
        let apart = x.len() / 7;
        for x in x.iter_mut().skip((u * apart as f64) as usize).step_by(apart) {
            *x *= 3e3;
        }
    }),
];

fn cis(cycles: f64) -> Complex32 {
    phasor(-cycles)
}

fn add(x: &mut [Complex32], value: impl Fn(f64) -> Complex32) {
    x.iter_mut().enumerate().for_each(|(n, x)| *x += value(n as f64));
}

#[test]
fn false_alarms_are_as_rare_as_stated_in_noise_of_any_colour_and_law() {
    const SEARCHES: usize = 1000;
    const STATED: f64 = 0.02;
    let rate = 2.048e6;
    for (coherent_ms, max_windows) in [(10, 2), (1, 20)] {
        let options = SearchOptions {
            satellites: ["G05", "G19"].map(|sv| signal::of(sv.parse().unwrap())).to_vec(),
            doppler_hz: (-500.0, 500.0),
            doppler_rate_hz_s: 0.0,
            coherent_ms,
            max_windows,
            false_alarm: STATED,
        };
        let plan = SearchPlan::new(rate, options).unwrap();
        for (name, noise) in NOISES {
            let alarms: usize = (0..SEARCHES as u64)
                .into_par_iter()
                .map(|seed| {
                    let mut samples = four_valued_noise(20 * 2048, seed);
                    noise(rate, &mut samples, (seed as f64 * 0.618_034).fract());
                    usize::from(!plan.search(&samples).unwrap().is_empty())
                })
                .sum();
            // At most twice the stated probability; three standard deviations of a binomial count.
            let most = 2.0 * STATED * SEARCHES as f64;
            println!("{coherent_ms} ms x {max_windows}, {name}: {alarms} of {SEARCHES}");
            assert!((alarms as f64) < most + 3.0 * most.sqrt(), "{name}: {alarms} of {SEARCHES}");
        }
    }
}

#[test]
fn impossible_searches_are_errors() {
    let with = |change: fn(&mut SearchOptions)| {
        let mut options = SearchOptions::default();
        change(&mut options);
        SearchPlan::new(4e6, options).err()
    };
    assert!(matches!(
        SearchPlan::new(1e6, SearchOptions::default()).err(),
        Some(AcquisitionError::Rate { .. })
    ));
    assert!(with(|o| o.satellites.clear()).is_some());
    assert!(with(|o| o.doppler_hz = (1.0, -1.0)).is_some());
    assert!(with(|o| o.doppler_hz = (-3e6, 3e6)).is_some());
    assert!(with(|o| o.coherent_ms = 0).is_some());
    assert!(with(|o| o.false_alarm = 0.0).is_some());
    let plan = SearchPlan::new(4e6, SearchOptions::default()).unwrap();
    assert!(matches!(plan.search(&[Complex32::ZERO; 100]), Err(AcquisitionError::TooShort { .. })));
    assert!(plan.search(&vec![Complex32::ZERO; 40_000]).unwrap().is_empty());
}
