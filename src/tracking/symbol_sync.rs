//! Symbol synchronisation and symbols.
//!
//! The maximum-likelihood edge is searched together with the remaining Doppler ([`estimate_carrier`]): it
//! needs neither phase lock nor an exact frequency.

use crate::correlator::carrier::{CarrierSpan, estimate_carrier};
use crate::gnss::signal::SymbolTiming;
use num_complex::Complex64;

/// Minimum signal-to-noise ratio of a prompt at which an edge is accepted (24.5 dB-Hz of 1 ms): in noise
/// alone the ratio is 0.05 at most (one standard deviation, 400 prompts), and so a false edge a six-sigma
/// event.
const MIN_SNR: f64 = 0.28;

/// Number of prompts used first, and the steps by which it grows until the edge is certain.
const FIRST: usize = 400;
const STEP: usize = 100;

/// Maximum number of prompts used, the latest.
const RUN: usize = 600;

/// Maximum error of the carrier loop, Hz: false locks lie at multiples of 25 with symbols of 20 ms.
const SPAN_HZ: f64 = 60.0;

/// Prompts after which the search restarts: the loops may have been unlocked.
const RESTART: usize = 4000;

/// A data symbol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Symbol {
    /// In-phase sum of its prompts: the sign is the symbol (up to the polarity of the whole track), the size
    /// its reliability.
    pub value: f32,
    /// Index of its first code period, counted from the start of the track.
    pub first_period: u64,
}

/// Searches the symbol edge in a run of prompts, then sums symbols.
#[derive(Clone, Debug)]
pub struct SymbolSynchroniser {
    timing: SymbolTiming,
    /// Prompts since the start (or the last restart) until the edge is known.
    history: Vec<Complex64>,
    first: u64,
    edge: Option<u64>,
    sum: Complex64,
    count: usize,
}

impl SymbolSynchroniser {
    /// For symbols of this timing, with an edge (index of a code period) if it is known already.
    pub fn new(timing: SymbolTiming, edge: Option<u64>) -> Self {
        let edge = edge.map(|e| e % timing.cycle as u64);
        let (history, first) = (Vec::new(), 0);
        Self { timing, history, first, edge, sum: Complex64::ZERO, count: 0 }
    }

    /// Timing of the symbols.
    pub fn timing(&self) -> SymbolTiming {
        self.timing
    }

    /// The position of a code period in its symbol, 0 to below the cycle, once the edge is known.
    pub fn position(&self, period: u64) -> Option<u64> {
        let cycle = self.timing.cycle as u64;
        self.edge.map(|edge| (period + cycle - edge) % cycle)
    }

    /// The edge: index of the code periods that start a symbol, modulo the cycle.
    pub fn edge(&self) -> Option<u64> {
        self.edge
    }

    /// Takes the prompt of code period `period` (consecutive) and appends the symbols that it completes.
    pub fn push(&mut self, period: u64, prompt: Complex64, symbols: &mut Vec<Symbol>) {
        if let Some(position) = self.position(period) {
            return self.add(period, position, prompt, symbols);
        }
        if self.history.is_empty() {
            self.first = period;
        }
        self.history.push(prompt);
        let count = self.history.len();
        if count >= FIRST && count.is_multiple_of(STEP) {
            if let Some(edge) = self.decide() {
                self.edge = Some(edge);
                let (history, first) = (std::mem::take(&mut self.history), self.first);
                for (k, &prompt) in (first..).zip(&history) {
                    self.push(k, prompt, symbols);
                }
            } else if count >= RESTART {
                self.history.clear();
            }
        }
    }

    fn add(&mut self, period: u64, position: u64, prompt: Complex64, symbols: &mut Vec<Symbol>) {
        if position == 0 {
            (self.sum, self.count) = (Complex64::ZERO, 0);
        }
        self.sum += prompt;
        self.count += 1;
        // The first symbol may have begun before the track.
        let cycle = self.timing.cycle;
        if position + 1 == cycle as u64 && self.count == cycle {
            let first_period = period + 1 - cycle as u64;
            symbols.push(Symbol { value: self.sum.re as f32, first_period });
        }
    }

    /// Edge (modulo the cycle), once certain.
    fn decide(&self) -> Option<u64> {
        let count = self.history.len();
        let skipped = count.saturating_sub(RUN);
        let run = &self.history[skipped..];
        let total: f64 = run.iter().map(|p| p.norm_sqr()).sum();
        let neighbours: Complex64 = run.windows(2).map(|w| w[1] * w[0].conj()).sum();
        if neighbours.norm() < MIN_SNR * (total - neighbours.norm()) {
            return None;
        }
        let span = CarrierSpan { frequency_hz: SPAN_HZ, rate_hz_s: 0.0 };
        let carrier = estimate_carrier(run, self.timing, span)?;
        let first = self.first + skipped as u64;
        Some((first + carrier.symbol_edge? as u64) % self.timing.cycle as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const TIMING: SymbolTiming = SymbolTiming { period_s: 1e-3, cycle: 20 };

    #[test]
    fn edges_are_found_and_all_symbols_given_at_thirty_dbhz() {
        for seed in 0..100u64 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let data: Vec<f64> =
                (0..300).map(|_| if rng.next_u32() & 1 == 0 { 1.0 } else { -1.0 }).collect();
            let edge = seed % 20;
            let mut sync = SymbolSynchroniser::new(TIMING, None);
            let mut bits = Vec::new();
            for k in 0..5000u64 {
                let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
                let noise = Complex64::new(normal(), normal()) / 2f64.sqrt();
                sync.push(k, noise + data[((k + 20 - edge) / 20) as usize], &mut bits);
            }
            assert_eq!(sync.edge(), Some(edge), "seed {seed}");
            assert_eq!(bits.len(), (5000 - edge as usize) / 20);
            assert_eq!(bits[0].first_period, edge);
            // The bit that starts at the edge is data[1].
            let errors =
                bits.iter().zip(&data[1..]).filter(|(b, d)| f64::from(b.value) * *d < 0.0).count();
            // Eb/N0 = 20: an error in 10^9 bits.
            assert_eq!(errors, 0);
        }
    }

    #[test]
    fn noise_gives_no_edge() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut sync = SymbolSynchroniser::new(TIMING, None);
        let mut bits = Vec::new();
        for k in 0..20_000 {
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            sync.push(k, Complex64::new(normal(), normal()), &mut bits);
        }
        assert!(bits.is_empty());
    }
}
