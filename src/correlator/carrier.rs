//! Maximum-likelihood estimation of the carrier and the data symbols from prompts of one code period each.

use crate::gnss::signal::SymbolTiming;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Log-likelihood ratio of the best symbol edge to the second best from which it is accepted: a ratio of
/// 10 000.
const MIN_EDGE_LOG_RATIO: f64 = 9.2;

/// The carrier of a run of prompts, relative to the replica's.
#[derive(Clone, Debug)]
pub struct CarrierEstimate {
    /// Frequency in the middle of the run, Hz.
    pub frequency_hz: f64,
    /// Its rate, Hz/s; 0 where none was searched.
    pub rate_hz_s: f64,
    /// Phase at the middle of the run, rad.
    pub phase: f64,
    /// Index of the first prompt that starts a data symbol, where the data determine it.
    pub symbol_edge: Option<usize>,
    /// Factors that remove data and carrier, one per period.
    pub wipe_off: Vec<Complex64>,
}

/// Intervals of frequency and rate, relative to the replica's, that are searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarrierSpan {
    /// Frequency, Hz, either way.
    pub frequency_hz: f64,
    /// Rate of the frequency, Hz/s, either way: 0 for satellites in high orbits and runs below a second.
    pub rate_hz_s: f64,
}

/// Frequency and its rate within `span`, symbol edge and data of a run of prompts; where the code tells the edge, the
/// run starts with a symbol.
///
/// With at most two symbols the signs are searched and the whole run is coherent; with more, the symbols are
/// first summed non-coherently for edge, frequency and rate, and then squared, which removes the data.
pub fn estimate_carrier(
    prompts: &[Complex64],
    timing: SymbolTiming,
    span: CarrierSpan,
) -> Option<CarrierEstimate> {
    let SymbolTiming { interval_s, cycle, .. } = timing;
    let count = prompts.len();
    let power: f64 = prompts.iter().map(|p| p.norm_sqr()).sum();
    if !power.is_finite() || power <= 0.0 {
        return None;
    }
    let short = count <= 2 * cycle;
    let half_s = 0.5 * count as f64 * interval_s;
    // Half a step changes the phase at the ends of a short run by 0.3 rad, and the frequency of a long one by
    // 8 Hz, a sixth of the width of a symbol's spectrum.
    let step = if short { 0.2 / (half_s * half_s) } else { 16.0 / half_s };
    let steps = (span.rate_hz_s / step).round() as i64;
    let best = (-steps..=steps)
        .map(|k| Search::new(prompts, timing, span.frequency_hz, k as f64 * step, short))
        .max_by(|a, b| a.score.total_cmp(&b.score))?;
    let Search { run, edge, edges, mut frequency, mut rate, .. } = best;

    if !short {
        let symbols = symbol_sums(&run, timing, frequency, edge);
        let squared = |f: f64, r: f64| squared_sum(&symbols, timing, edge, count, f, r).norm();
        let fine = 1.0 / interval_s / (16.0 * count as f64);
        // A quarter of a cycle of the squares between the middle and the ends.
        let fine_rate = 0.25 / (half_s * half_s);
        let reach = |step: f64, fine: f64| (step / fine).ceil() as i64;
        let rates = if steps > 0 { reach(step, fine_rate) } else { 0 };
        let (f, r) = (-rates..=rates)
            .flat_map(|r| {
                let reach = reach(resolution(count, timing), fine);
                (-reach..=reach).map(move |f| (f as f64 * fine, r as f64 * fine_rate))
            })
            .max_by(|a, b| squared(a.0, a.1).total_cmp(&squared(b.0, b.1)))
            .unwrap_or((0.0, 0.0));
        // Estimates of frequency and rate in the middle of the run are almost uncorrelated.
        let r = if steps > 0 { climb(r, fine_rate, |r| squared(f, r)) } else { r };
        frequency += climb(f, fine, |f| squared(f, r));
        rate += r;
    }

    let run = without_rate(prompts, interval_s, rate);
    let symbols_of = |edge: usize| symbol_sums(&run, timing, frequency, edge);
    let phase_of = |symbols: &[Complex64], edge: usize| {
        squared_sum(symbols, timing, edge, count, 0.0, 0.0).arg() / 2.0
    };
    let wipe_off = |edge: usize, signs: &[f64]| -> Vec<Complex64> {
        let factor = |k: usize| {
            let t = from_the_middle(k, count, interval_s);
            let carrier = Complex64::cis(-TAU * (frequency + 0.5 * rate * t) * t);
            carrier * signs[symbol_of(k, edge, cycle)]
        };
        (0..count).map(factor).collect()
    };
    let symbols = symbols_of(edge);
    if short {
        let (signs, sum) = best_signs(&symbols);
        let wipe_off = wipe_off(edge, &signs);
        let (frequency_hz, rate_hz_s, phase) = (frequency, rate, sum.arg());
        return Some(CarrierEstimate {
            frequency_hz,
            rate_hz_s,
            phase,
            symbol_edge: None,
            wipe_off,
        });
    }
    let signs = |symbols: &[Complex64], phase: f64| -> Vec<f64> {
        let axis = Complex64::cis(-phase);
        symbols.iter().map(|b| (b * axis).re.signum()).collect()
    };
    let phase = phase_of(&symbols, edge);
    let (signal, noise) = signal_and_noise(prompts, &wipe_off(edge, &signs(&symbols, phase)));
    // Every edge with the carrier's phase that suits it best.
    let likelihoods: Vec<f64> = (0..edges)
        .map(|edge| {
            let symbols = symbols_of(edge);
            let axis = Complex64::cis(-phase_of(&symbols, edge));
            let certainty = |b: &Complex64| log_cosh(2.0 * signal * (b * axis).re / noise);
            symbols.iter().map(certainty).sum()
        })
        .collect();
    let best = |but: Option<usize>| {
        let others = (0..edges).filter(|&e| Some(e) != but);
        others.max_by(|&a, &b| likelihoods[a].total_cmp(&likelihoods[b]))
    };
    let edge = best(None)?;
    let ratio = best(Some(edge)).map_or(f64::INFINITY, |e| likelihoods[edge] - likelihoods[e]);
    let symbols = symbols_of(edge);
    let phase = phase_of(&symbols, edge);
    Some(CarrierEstimate {
        frequency_hz: frequency,
        rate_hz_s: rate,
        phase,
        symbol_edge: (ratio > MIN_EDGE_LOG_RATIO).then_some(edge),
        wipe_off: wipe_off(edge, &signs(&symbols, phase)),
    })
}

/// `ln cosh x`: the log-likelihood of a symbol of either sign with equal probability, where `x` is twice its
/// in-phase sum times the amplitude over the noise power of a prompt. Without a transition at it, an edge is worth
/// no more than any other.
pub fn log_cosh(x: f64) -> f64 {
    x.abs() + (-2.0 * x.abs()).exp().ln_1p() - std::f64::consts::LN_2
}

/// Search of frequency and symbol edge under one rate.
struct Search {
    /// The prompts without that rate.
    run: Vec<Complex64>,
    edge: usize,
    edges: usize,
    frequency: f64,
    rate: f64,
    score: f64,
}

impl Search {
    fn new(
        prompts: &[Complex64],
        timing: SymbolTiming,
        span_hz: f64,
        rate: f64,
        short: bool,
    ) -> Self {
        let run = without_rate(prompts, timing.interval_s, rate);
        let resolution = resolution(run.len(), timing);
        let edges = match timing.is_aligned {
            true => 1,
            false if short => run.len().min(timing.cycle),
            false => timing.cycle,
        };
        let steps = (span_hz / resolution).ceil() as i64;
        let (mut frequency, mut edge, mut best) = (0.0, 0, -1.0);
        for step in -steps..=steps {
            let f = step as f64 * resolution;
            for e in 0..edges {
                let s = score(&run, timing, f, e, short);
                if s > best {
                    (frequency, edge, best) = (f, e, s);
                }
            }
        }
        frequency = climb(frequency, resolution, |f| score(&run, timing, f, edge, short));
        let score = score(&run, timing, frequency, edge, short);
        Self { run, edge, edges, frequency, rate, score }
    }
}

/// Step of the frequency search over a run of `count` prompts, Hz.
fn resolution(count: usize, timing: SymbolTiming) -> f64 {
    1.0 / timing.interval_s / (8.0 * count.min(timing.cycle) as f64)
}

/// Power of the run under a frequency and a symbol edge.
fn score(
    run: &[Complex64],
    timing: SymbolTiming,
    frequency_hz: f64,
    edge: usize,
    short: bool,
) -> f64 {
    let symbols = symbol_sums(run, timing, frequency_hz, edge);
    if short {
        best_signs(&symbols).1.norm_sqr()
    } else {
        symbols.iter().map(|s| s.norm_sqr()).sum()
    }
}

/// Time of prompt `k` of `count` from the middle of the run, s.
fn from_the_middle(k: usize, count: usize, interval_s: f64) -> f64 {
    (k as f64 + 0.5 - 0.5 * count as f64) * interval_s
}

/// The prompts after a rate of the frequency (Hz/s) is removed.
fn without_rate(prompts: &[Complex64], interval_s: f64, rate_hz_s: f64) -> Vec<Complex64> {
    let turned = |(k, prompt): (usize, &Complex64)| {
        let t = from_the_middle(k, prompts.len(), interval_s);
        prompt * Complex64::cis(-0.5 * TAU * rate_hz_s * t * t)
    };
    prompts.iter().enumerate().map(turned).collect()
}

/// Symbol that period `k` belongs to when symbols of `cycle` periods start at `edge` (the part before it is
/// symbol 0).
fn symbol_of(k: usize, edge: usize, cycle: usize) -> usize {
    if edge == 0 { k / cycle } else { (k + cycle - edge) / cycle }
}

/// Prompts summed over each symbol after a carrier (phase zero in the middle of the run) is removed.
fn symbol_sums(
    prompts: &[Complex64],
    timing: SymbolTiming,
    frequency_hz: f64,
    edge: usize,
) -> Vec<Complex64> {
    let SymbolTiming { interval_s, cycle, .. } = timing;
    let count = prompts.len();
    let mut symbols = vec![Complex64::ZERO; symbol_of(count - 1, edge, cycle) + 1];
    let turn = Complex64::cis(-TAU * frequency_hz * interval_s);
    let mut carrier = Complex64::cis(-TAU * frequency_hz * interval_s * (0.5 - count as f64 / 2.0));
    for (k, prompt) in prompts.iter().enumerate() {
        symbols[symbol_of(k, edge, cycle)] += prompt * carrier;
        carrier *= turn;
    }
    symbols
}

/// The signs of a few symbols that maximise the magnitude of their sum, and that sum.
fn best_signs(symbols: &[Complex64]) -> (Vec<f64>, Complex64) {
    let mut best = (vec![1.0; symbols.len()], Complex64::ZERO);
    for pattern in 0..1u32 << (symbols.len() - 1) {
        let sign = |j: usize| if pattern >> j & 1 == 0 { 1.0 } else { -1.0 };
        let sum: Complex64 = symbols.iter().enumerate().map(|(j, s)| s * sign(j)).sum();
        if sum.norm_sqr() > best.1.norm_sqr() {
            best = ((0..symbols.len()).map(sign).collect(), sum);
        }
    }
    best
}

/// Middle of symbol `j` within a run of `count` prompts, from the run's middle, s.
fn symbol_middle_s(j: usize, timing: SymbolTiming, edge: usize, count: usize) -> f64 {
    let SymbolTiming { interval_s, cycle, .. } = timing;
    let begin = (j * cycle + edge).saturating_sub(if edge == 0 { 0 } else { cycle });
    let end = if edge == 0 { (j + 1) * cycle } else { j * cycle + edge };
    0.5 * (begin as f64 + end.min(count) as f64 - count as f64) * interval_s
}

/// Sum of the squares of the symbols of a run of `count` prompts after a further frequency in its middle and a
/// further rate are removed.
fn squared_sum(
    symbols: &[Complex64],
    timing: SymbolTiming,
    edge: usize,
    count: usize,
    frequency_hz: f64,
    rate_hz_s: f64,
) -> Complex64 {
    let turned = |(j, b): (usize, &Complex64)| {
        let t = symbol_middle_s(j, timing, edge, count);
        b * b * Complex64::cis(-2.0 * TAU * (frequency_hz + 0.5 * rate_hz_s * t) * t)
    };
    symbols.iter().enumerate().map(turned).sum()
}

/// Amplitude of the signal in a prompt, and noise power of one after the signal is subtracted.
fn signal_and_noise(prompts: &[Complex64], wipe_off: &[Complex64]) -> (f64, f64) {
    let count = prompts.len() as f64;
    let mean = prompts.iter().zip(wipe_off).map(|(p, w)| p * w).sum::<Complex64>() / count;
    let residual: f64 = prompts.iter().zip(wipe_off).map(|(p, w)| (p * w - mean).norm_sqr()).sum();
    (mean.norm(), (residual / (count - 1.0)).max(f64::MIN_POSITIVE))
}

/// Refines the maximum next to the best point of a grid of spacing `step` (golden section, to a thousandth of
/// the step).
fn climb(start: f64, step: f64, f: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let (mut low, mut high) = (start - step, start + step);
    while high - low > 1e-3 * step {
        let (a, b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
        if f(a) > f(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    const TIMING: SymbolTiming = SymbolTiming { interval_s: 1e-3, cycle: 20, is_aligned: false };

    /// 0.2 s without a transition say nothing of the symbol edge; one transition, by 1 ms of 45 dB-Hz, has a likelihood
    /// ratio of e^(4 snr) = e^126 against its neighbours.
    #[test]
    fn an_edge_is_believed_by_transitions_alone() {
        let snr = 10f64.powf(4.5) * TIMING.interval_s;
        for seed in 0..200u64 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let turn = rng.random_range(0..400);
            let (f, edge) = (rng.random_range(-20.0..20.0), turn % TIMING.cycle);
            let prompts: Vec<Complex64> = (0..200)
                .map(|k| {
                    let sign = if k < turn { 1.0 } else { -1.0 };
                    let t = from_the_middle(k, 200, TIMING.interval_s);
                    let noise =
                        Complex64::new(rng.sample(StandardNormal), rng.sample(StandardNormal));
                    Complex64::cis(TAU * f * t) * sign + noise * (0.5 / snr).sqrt()
                })
                .collect();
            let span = CarrierSpan { frequency_hz: 30.0, rate_hz_s: 0.0 };
            let found = estimate_carrier(&prompts, TIMING, span).unwrap().symbol_edge;
            match turn {
                // Near an end of the run half a symbol of noise may speak for either side.
                20..180 => assert_eq!(found, Some(edge), "seed {seed}"),
                200.. => assert_eq!(found, None, "seed {seed}"),
                _ => assert!(found.is_none_or(|e| e == edge), "seed {seed}"),
            }
        }
    }

    /// A run of 200 prompts at 45 dB-Hz under data symbols, with any frequency within 40 Hz and any rate
    /// within 600 Hz/s: both are found to their Cramer-Rao bounds (Kay, Estimation Theory, 3.11, for a
    /// quadratic phase: var f = 6 / ((2 pi)^2 snr N^3 T^2), var of the rate 360 / ((2 pi)^2 snr N^5 T^4)).
    #[test]
    fn rates_of_low_orbits_reach_the_cramer_rao_bound() {
        const COUNT: usize = 200;
        const RUNS: u64 = 60;
        let snr = 10f64.powf(4.5) * TIMING.interval_s;
        let duration = COUNT as f64 * TIMING.interval_s;
        let per_prompt = snr * COUNT as f64;
        let frequency_sigma = (6.0 / per_prompt).sqrt() / (TAU * duration);
        let rate_sigma = (360.0 / per_prompt).sqrt() / (TAU * duration * duration);
        let mut square = [0.0; 2];
        for seed in 0..RUNS {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let (f, r) = (rng.random_range(-40.0..40.0), rng.random_range(-600.0..600.0));
            let edge = rng.random_range(0..TIMING.cycle);
            let signs: Vec<f64> = (0..=COUNT / TIMING.cycle + 1)
                .map(|_| if rng.random() { 1.0 } else { -1.0 })
                .collect();
            let prompts: Vec<Complex64> = (0..COUNT)
                .map(|k| {
                    let t = from_the_middle(k, COUNT, TIMING.interval_s);
                    let signal = Complex64::cis(0.7 + TAU * (f + 0.5 * r * t) * t);
                    let noise =
                        Complex64::new(rng.sample(StandardNormal), rng.sample(StandardNormal));
                    signal * signs[symbol_of(k, edge, TIMING.cycle)] + noise * (0.5 / snr).sqrt()
                })
                .collect();
            let span = CarrierSpan { frequency_hz: 50.0, rate_hz_s: 600.0 };
            let carrier = estimate_carrier(&prompts, TIMING, span).unwrap();
            square[0] += ((carrier.frequency_hz - f) / frequency_sigma).powi(2) / RUNS as f64;
            square[1] += ((carrier.rate_hz_s - r) / rate_sigma).powi(2) / RUNS as f64;
        }
        // A mean of 60 squares has a standard deviation of sqrt(2/60) = 0.18; squaring bits of 28 dB costs
        // 0.1 %.
        for mean in square {
            assert!((0.45..1.55).contains(&mean), "{square:?}");
        }
    }
}
