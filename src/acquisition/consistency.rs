//! Tests of a recording by a set of acquired satellites: mirrored spectrum, missing samples.

use super::{Acquisition, Refined, SearchOptions, SearchPlan};
use num_complex::Complex32;

/// Log-likelihood ratio from which the spectrum counts as mirrored: a likelihood ratio of 20 000.
const MIN_MIRROR_LOG_RATIO: f64 = 10.0;

/// Maximum number of satellites whose code phases are followed to find missing samples.
const MAX_SATELLITES: usize = 6;

/// Length of one search for missing samples: coherent ms, number of windows.
const SEARCH_MS: (usize, usize) = (1, 3);

/// Jumps smaller than this are noise, chips.
const MIN_JUMP_CHIPS: f64 = 0.5;

/// Whether code drifts and Dopplers disagree in sign, as they do when the spectrum is mirrored.
///
/// A code runs faster than nominal by D over the carrier cycles in a chip, n (1540 on L1); mirrored, the
/// measured Doppler is -D and the code rate's excess over its prediction is -2 D/n. Both hypotheses allow a
/// common excess (a wrong sampling rate), which is eliminated.
pub fn is_mirrored(refined: &[Refined]) -> bool {
    let cost = |slope: f64| {
        let weight = |r: &Refined| r.code_rate_sigma.powi(-2);
        let excess = |r: &Refined| {
            let Acquisition { transmission, doppler_hz, .. } = r.acquisition;
            r.code_rate_excess - slope * doppler_hz / transmission.cycles_per_chip()
        };
        let total: f64 = refined.iter().map(weight).sum();
        let mean = refined.iter().map(|r| weight(r) * excess(r)).sum::<f64>() / total;
        refined.iter().map(|r| weight(r) * (excess(r) - mean).powi(2)).sum::<f64>()
    };
    refined.len() >= 2 && 0.5 * (cost(0.0) - cost(-2.0)) > MIN_MIRROR_LOG_RATIO
}

/// By which fraction of the chip rate all codes run faster than their carriers say, beyond what was assumed, and its
/// standard deviation: not 0 where mixer and sampler have clocks of their own. None where no code was measured.
pub fn common_code_offset(refined: &[Refined]) -> Option<(f64, f64)> {
    let chips = |r: &Refined| r.acquisition.transmission.signal.chip_rate_hz;
    let weight = |r: &Refined| (r.code_rate_sigma / chips(r)).powi(-2);
    let total: f64 = refined.iter().map(weight).sum();
    let sum: f64 = refined.iter().map(|r| weight(r) * r.code_rate_excess / chips(r)).sum();
    (total > 0.0).then(|| (sum / total, total.recip().sqrt()))
}

/// A jump of all code phases: samples are missing from or repeated in a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissingSamples {
    /// The jump lies after this sample.
    pub after: u64,
    /// And before this one.
    pub before: u64,
    /// Increase of the code delay at the jump, s: negative when samples are missing, modulo a code period.
    pub jump_s: f64,
}

/// Searches samples missing between the start of `samples`, for which `found` holds, and their end: all
/// satellites' code phases then jump alike. `code_offset`: by which fraction
/// codes run faster than their carriers say. Cost: a bisection of some ten steps, each a narrow search for up
/// to six satellites.
pub fn find_missing_samples(
    samples: &[Complex32],
    rate_hz: f64,
    found: &[Acquisition],
    code_offset: f64,
) -> Option<MissingSamples> {
    let followed = &found[..found.len().min(MAX_SATELLITES)];
    let plans: Vec<SearchPlan> = followed
        .iter()
        .map(|a| {
            SearchPlan::new(
                rate_hz,
                SearchOptions {
                    satellites: vec![a.transmission],
                    doppler_hz: (a.doppler_hz - 100.0, a.doppler_hz + 100.0),
                    doppler_rate_hz_s: 0.0,
                    coherent_ms: SEARCH_MS.0,
                    max_windows: SEARCH_MS.1,
                    false_alarm: 1e-4,
                },
            )
            .ok()
        })
        .collect::<Option<_>>()?;
    let min_jump_s = MIN_JUMP_CHIPS / followed.first()?.transmission.signal.chip_rate_hz;
    let search_len = (rate_hz * 1e-3 * (SEARCH_MS.0 * SEARCH_MS.1) as f64).ceil() as usize + 1;
    // The jump that most satellites agree on at a sample, if at least three show one.
    let jump_at = |at: usize| -> Option<f64> {
        let window = samples.get(at..at + search_len)?;
        let seen = plans.iter().zip(followed).filter_map(|(plan, a)| {
            let now = plan.search(window).ok()?.into_iter().next()?;
            let faster = a.doppler_hz / a.transmission.carrier_hz() + code_offset;
            let elapsed = at as f64 / rate_hz * (1.0 + faster);
            let period_s = a.transmission.signal.period_s();
            let expected = (a.code_offset_s() - elapsed).rem_euclid(period_s);
            let jump = now.code_offset_s() - expected;
            Some((jump / period_s - (jump / period_s).round()) * period_s)
        });
        let mut jumps: Vec<f64> = seen.collect();
        jumps.sort_by(f64::total_cmp);
        let median = *jumps.get(jumps.len() / 2)?;
        let agreeing = jumps.iter().filter(|j| (*j - median).abs() < 2.0 * min_jump_s).count();
        (agreeing >= 3 && 2 * agreeing > jumps.len()).then_some(median)
    };
    let is_jump = |jump: f64| jump.abs() > min_jump_s;
    let mut high = samples.len().checked_sub(search_len)?;
    let jump_s = jump_at(high).filter(|&j| is_jump(j))?;
    let mut low = 0;
    while high - low > search_len / 4 {
        let middle = low + (high - low) / 2;
        // A search across the jump finds one side or the other, or nothing: the bisection still ends near it.
        if jump_at(middle).is_some_and(is_jump) { high = middle } else { low = middle }
    }
    Some(MissingSamples { after: low as u64, before: (high + search_len) as u64, jump_s })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::correlator::test_signal::TestSignal;
    use crate::gnss::Sv;

    const RATE: f64 = 2.048e6;

    fn satellites(len: usize) -> Vec<Complex32> {
        let mut sum = vec![Complex32::ZERO; len];
        for (k, prn) in [3u8, 8, 17, 29].into_iter().enumerate() {
            let signal = TestSignal {
                rate: RATE,
                doppler: 900.0 * k as f64 - 1500.0,
                delay_s: 0.2e-3 * k as f64,
                cn0_dbhz: 48.0,
                fade_db: 0.0,
                fade_s: 0.0,
                symbol_edge: 4,
                seed: k as u64,
            };
            let samples = signal.samples(Sv::from_prn(prn).unwrap(), len);
            sum.iter_mut().zip(samples).for_each(|(s, x)| *s += x);
        }
        sum
    }

    #[test]
    fn missing_samples_are_found_where_they_are() {
        let (at, missing) = (143_000, 165);
        let mut samples = satellites(204_800 + missing);
        let plan = SearchPlan::new(RATE, SearchOptions::default()).unwrap();
        let found = plan.search(&samples).unwrap();
        assert_eq!(found.len(), 4);
        assert_eq!(find_missing_samples(&samples, RATE, &found, 0.0), None);
        samples.drain(at..at + missing);
        let jump = find_missing_samples(&samples, RATE, &found, 0.0).unwrap();
        assert!((jump.after..=jump.before).contains(&(at as u64)), "{jump:?}");
        assert!(jump.before - jump.after < 10_000);
        // To half a bin of code phase and of Doppler.
        assert!((jump.jump_s + missing as f64 / RATE).abs() < 0.5e-6, "{jump:?}");
    }
}
