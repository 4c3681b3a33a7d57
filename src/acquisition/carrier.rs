//! Maximum likelihood for the carrier and the data bits of a run of 1 ms prompts.

use crate::gnss::constants::CA_CODE_PERIOD;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Code periods in a data bit.
const PERIODS_PER_BIT: usize = 20;

/// Log-likelihood by which the best bit edge must beat the second for it to be believed: odds of 1000.
const EDGE_ODDS: f64 = 6.9;

/// The carrier of a run of prompts, relative to the replica's.
#[derive(Clone, Debug)]
pub struct Carrier {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Phase at the middle of the run, rad.
    pub phase: f64,
    /// Index (0 to 19) of the first prompt that starts a data bit, where the run shows it.
    pub bit_edge: Option<usize>,
    /// Data wiped off and carrier removed: what each period is multiplied with.
    pub wipe_off: Vec<Complex64>,
}

/// Frequency within +-`span_hz`, bit edge and data of a run of 1 ms prompts.
///
/// With two bits or less the signs are searched and the whole run is coherent; with more, the bits are
/// first summed non-coherently for edge and frequency, and then squared, which removes the data.
pub fn estimate_carrier(prompts: &[Complex64], span_hz: f64) -> Option<Carrier> {
    let count = prompts.len();
    let power: f64 = prompts.iter().map(|p| p.norm_sqr()).sum();
    if !power.is_finite() || power <= 0.0 {
        return None;
    }
    let coherent_ms = count.min(PERIODS_PER_BIT) as f64;
    let resolution = 1e3 / (8.0 * coherent_ms);
    let short = count <= 2 * PERIODS_PER_BIT;
    let edges = if short { count.min(PERIODS_PER_BIT) } else { PERIODS_PER_BIT };
    let score = |frequency: f64, edge: usize| {
        let bits = bit_sums(prompts, frequency, edge);
        if short { best_signs(&bits).1.norm_sqr() } else { bits.iter().map(|b| b.norm_sqr()).sum() }
    };

    let steps = (span_hz / resolution).ceil() as i64;
    let (mut frequency, mut edge, mut best) = (0.0, 0, -1.0);
    for step in -steps..=steps {
        let f = step as f64 * resolution;
        for e in 0..edges {
            let s = score(f, e);
            if s > best {
                (frequency, edge, best) = (f, e, s);
            }
        }
    }
    frequency = climb(frequency, resolution, |f| score(f, edge));

    if !short {
        let bits = bit_sums(prompts, frequency, edge);
        let squared = |f: f64| squared_sum(&bits, edge, f).norm();
        let fine = 1e3 / (16.0 * count as f64);
        let steps = (resolution / fine).ceil() as i64;
        let start = (-steps..=steps)
            .map(|s| s as f64 * fine)
            .max_by(|a, b| squared(*a).total_cmp(&squared(*b)))
            .unwrap_or(0.0);
        frequency += climb(start, fine, squared);
    }

    let bits = bit_sums(prompts, frequency, edge);
    let (signs, phase) = if short {
        let (signs, sum) = best_signs(&bits);
        (signs, sum.arg())
    } else {
        let phase = squared_sum(&bits, edge, 0.0).arg() / 2.0;
        let axis = Complex64::cis(-phase);
        (bits.iter().map(|b| (b * axis).re.signum()).collect(), phase)
    };
    let middle = count as f64 / 2.0;
    let wipe_off: Vec<Complex64> = (0..count)
        .map(|k| {
            let turn = frequency * CA_CODE_PERIOD * (k as f64 + 0.5 - middle);
            Complex64::cis(-TAU * turn) * signs[bit_of(k, edge)]
        })
        .collect();
    let noise = residual_noise(prompts, &wipe_off);
    let second = (0..edges).filter(|&e| e != edge).map(|e| score(frequency, e)).fold(0.0, f64::max);
    let odds = (score(frequency, edge) - second) / (PERIODS_PER_BIT as f64 * noise);
    let bit_edge = (!short && odds > EDGE_ODDS).then_some(edge);
    Some(Carrier { frequency_hz: frequency, phase, bit_edge, wipe_off })
}

/// The bit that period `k` belongs to when bits start at `edge` (the part before it is bit 0).
fn bit_of(k: usize, edge: usize) -> usize {
    if edge == 0 { k / PERIODS_PER_BIT } else { (k + PERIODS_PER_BIT - edge) / PERIODS_PER_BIT }
}

/// Prompts summed over each bit after a carrier (phase zero in the middle of the run) is removed.
fn bit_sums(prompts: &[Complex64], frequency_hz: f64, edge: usize) -> Vec<Complex64> {
    let count = prompts.len();
    let mut bits = vec![Complex64::ZERO; bit_of(count - 1, edge) + 1];
    let turn = Complex64::cis(-TAU * frequency_hz * CA_CODE_PERIOD);
    let mut carrier =
        Complex64::cis(-TAU * frequency_hz * CA_CODE_PERIOD * (0.5 - count as f64 / 2.0));
    for (k, prompt) in prompts.iter().enumerate() {
        bits[bit_of(k, edge)] += prompt * carrier;
        carrier *= turn;
    }
    bits
}

/// The signs of up to a few bits that make their sum greatest, and that sum.
fn best_signs(bits: &[Complex64]) -> (Vec<f64>, Complex64) {
    let mut best = (vec![1.0; bits.len()], Complex64::ZERO);
    for pattern in 0..1u32 << (bits.len() - 1) {
        let sign = |j: usize| if pattern >> j & 1 == 0 { 1.0 } else { -1.0 };
        let sum: Complex64 = bits.iter().enumerate().map(|(j, b)| b * sign(j)).sum();
        if sum.norm_sqr() > best.1.norm_sqr() {
            best = ((0..bits.len()).map(sign).collect(), sum);
        }
    }
    best
}

/// Sum of the squares of the bits after a further frequency is removed.
fn squared_sum(bits: &[Complex64], edge: usize, frequency_hz: f64) -> Complex64 {
    let origin = if edge == 0 { 0.0 } else { edge as f64 - PERIODS_PER_BIT as f64 };
    let middle = bits.len() as f64 * PERIODS_PER_BIT as f64 / 2.0 + origin;
    bits.iter()
        .enumerate()
        .map(|(j, b)| {
            let ms = origin + (j as f64 + 0.5) * PERIODS_PER_BIT as f64 - middle;
            b * b * Complex64::cis(-2.0 * TAU * frequency_hz * ms * CA_CODE_PERIOD)
        })
        .sum()
}

/// Noise power of one prompt after the signal is subtracted.
fn residual_noise(prompts: &[Complex64], wipe_off: &[Complex64]) -> f64 {
    let count = prompts.len() as f64;
    let mean = prompts.iter().zip(wipe_off).map(|(p, w)| p * w).sum::<Complex64>() / count;
    let residual: f64 = prompts.iter().zip(wipe_off).map(|(p, w)| (p * w - mean).norm_sqr()).sum();
    (residual / (count - 1.0)).max(f64::MIN_POSITIVE)
}

/// Climbs from the best point of a grid of spacing `step` to the maximum beside it (golden section, to
/// a thousandth of the step).
fn climb(start: f64, step: f64, f: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let (mut low, mut high) = (start - step, start + step);
    while high - low > 1e-3 * step {
        let (a, b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
        if f(a) > f(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}
