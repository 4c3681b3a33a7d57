//! What a set of acquired satellites says of the recording itself: a mirrored spectrum, missing samples.

use super::{Acquisition, Refined, SearchOptions, SearchPlan};
use num_complex::Complex32;

/// Log-likelihood by which a mirrored spectrum must explain the code rates better: odds of 20 000.
const MIRROR_ODDS: f64 = 10.0;

/// Satellites whose code phases are followed to find missing samples.
const WITNESSES: usize = 6;

/// Length of one look for missing samples, coherent ms and number.
const LOOK_MS: (usize, usize) = (1, 3);

/// Jumps smaller than this are noise, chips.
const LEAST_JUMP_CHIPS: f64 = 0.5;

/// Whether code drifts and Dopplers disagree in sign, as they do when the spectrum is mirrored.
///
/// A code runs faster than nominal by D over the carrier cycles in a chip, n (1540 on L1); mirrored, the measured
/// Doppler is -D and the code rate's excess over its prediction is -2 D/n. Both hypotheses allow a common excess (a wrong sampling
/// rate), which is eliminated.
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
    refined.len() >= 2 && 0.5 * (cost(0.0) - cost(-2.0)) > MIRROR_ODDS
}

/// Samples lost or doubled inside a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slip {
    /// The slip lies after this sample.
    pub after: u64,
    /// And before this one.
    pub before: u64,
    /// By how much later the codes start afterwards than they should, s: negative when samples are
    /// missing, modulo a code period.
    pub jump_s: f64,
}

/// Looks for samples missing between the start of `samples`, for which `found` holds, and their end: all
/// satellites' code phases then jump alike. Work: a bisection of some ten looks, each one narrow search
/// for up to six satellites.
pub fn find_slip(samples: &[Complex32], rate_hz: f64, found: &[Acquisition]) -> Option<Slip> {
    let witnesses = &found[..found.len().min(WITNESSES)];
    let plans: Vec<SearchPlan> = witnesses
        .iter()
        .map(|a| {
            SearchPlan::new(
                rate_hz,
                SearchOptions {
                    satellites: vec![a.transmission],
                    doppler_hz: (a.doppler_hz - 100.0, a.doppler_hz + 100.0),
                    doppler_rate_hz_s: 0.0,
                    coherent_ms: LOOK_MS.0,
                    max_windows: LOOK_MS.1,
                    false_alarm: 1e-4,
                },
            )
            .ok()
        })
        .collect::<Option<_>>()?;
    let least_jump_s = LEAST_JUMP_CHIPS / witnesses.first()?.transmission.signal.chip_rate_hz;
    let look = (rate_hz * 1e-3 * (LOOK_MS.0 * LOOK_MS.1) as f64).ceil() as usize + 1;
    // The jump that most witnesses agree on at a sample, if at least three see one.
    let jump_at = |at: usize| -> Option<f64> {
        let window = samples.get(at..at + look)?;
        let seen = plans.iter().zip(witnesses).filter_map(|(plan, a)| {
            let now = plan.search(window).ok()?.into_iter().next()?;
            let elapsed = at as f64 / rate_hz * (1.0 + a.doppler_hz / a.transmission.carrier_hz());
            let period_s = a.transmission.signal.period_s();
            let expected = (a.code_offset_s() - elapsed).rem_euclid(period_s);
            let jump = now.code_offset_s() - expected;
            Some((jump / period_s - (jump / period_s).round()) * period_s)
        });
        let mut jumps: Vec<f64> = seen.collect();
        jumps.sort_by(f64::total_cmp);
        let median = *jumps.get(jumps.len() / 2)?;
        let agreeing = jumps.iter().filter(|j| (*j - median).abs() < 2.0 * least_jump_s).count();
        (agreeing >= 3 && 2 * agreeing > jumps.len()).then_some(median)
    };
    let is_jump = |jump: f64| jump.abs() > least_jump_s;
    let mut high = samples.len().checked_sub(look)?;
    let jump_s = jump_at(high).filter(|&j| is_jump(j))?;
    let mut low = 0;
    while high - low > look / 4 {
        let middle = low + (high - low) / 2;
        // A look across the slip sees one side or the other, or nothing: that is near enough.
        if jump_at(middle).is_some_and(is_jump) { high = middle } else { low = middle }
    }
    Some(Slip { after: low as u64, before: (high + look) as u64, jump_s })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::correlator::test_signal::TestSignal;
    use crate::gnss::Sv;

    const RATE: f64 = 2.048e6;

    fn sky(len: usize) -> Vec<Complex32> {
        let mut sum = vec![Complex32::ZERO; len];
        for (k, prn) in [3u8, 8, 17, 29].into_iter().enumerate() {
            let signal = TestSignal {
                rate: RATE,
                doppler: 900.0 * k as f64 - 1500.0,
                delay_s: 0.2e-3 * k as f64,
                cn0_dbhz: 48.0,
                fade_db: 0.0,
                fade_s: 0.0,
                bit_edge: 4,
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
        let mut samples = sky(204_800 + missing);
        let plan = SearchPlan::new(RATE, SearchOptions::default()).unwrap();
        let found = plan.search(&samples).unwrap();
        assert_eq!(found.len(), 4);
        assert_eq!(find_slip(&samples, RATE, &found), None);
        samples.drain(at..at + missing);
        let slip = find_slip(&samples, RATE, &found).unwrap();
        assert!((slip.after..=slip.before).contains(&(at as u64)), "{slip:?}");
        assert!(slip.before - slip.after < 10_000);
        // To half a sample of the search's grid and the Doppler's bin.
        assert!((slip.jump_s + missing as f64 / RATE).abs() < 0.5e-6, "{slip:?}");
    }
}
