//! Symbol synchronisation and symbols.
//!
//! The maximum-likelihood edge is searched together with the remaining Doppler ([`estimate_carrier`]): it
//! needs neither phase lock nor an exact frequency. From then on, for as long as the track lives, each other edge is
//! tested against it by a cumulative sum of log-likelihood ratios (Page 1954): one that more transitions speak for
//! takes its place.

use super::lock::PromptPowers;
use crate::correlator::carrier::{CarrierSpan, estimate_carrier, log_cosh};
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

/// Log-likelihood ratio from which another edge takes the place of the one in use: a false alarm once in e^32 symbols
/// of each other edge. Of one symbol no more than a quarter counts, as a slip of the carrier's phase by half a
/// cycle looks like a transition: four are needed, without one at the edge in use.
const CONTRADICTED: f64 = 32.0;

/// Code periods over which the phase lock of the carrier loop is averaged: at 28 dB-Hz a standard deviation of 0.2 of
/// the signal's power.
const LOCK_PERIODS: f64 = 100.0;

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
    rivals: Rivals,
}

/// The other edges, tested against the one in use.
#[derive(Clone, Debug)]
struct Rivals {
    /// In-phase sums of the symbols under way, by their edge.
    sums: Vec<f64>,
    /// Log-likelihoods of the symbols that were completed.
    complete: Vec<f64>,
    /// Log-likelihood ratios of all prompts so far, of each edge against the one in use.
    ratios: Vec<f64>,
    /// Cumulative sums of their steps.
    evidence: Vec<f64>,
    /// Power in phase less power in quadrature, averaged: the signal's where the carrier loop is locked in phase.
    locked_power: f64,
}

impl Rivals {
    fn new(cycle: usize) -> Self {
        let zeros = || vec![0.0; cycle];
        let (sums, complete, ratios, evidence) = (zeros(), zeros(), zeros(), zeros());
        Self { sums, complete, ratios, evidence, locked_power: 0.0 }
    }

    /// Takes the prompt of a code period. Gives the edge that contradicts `edge`, if one does. Cost: as many additions
    /// as a symbol has periods.
    fn push(
        &mut self,
        period: u64,
        edge: u64,
        prompt: Complex64,
        powers: PromptPowers,
    ) -> Option<u64> {
        const MOST: f64 = CONTRADICTED / 4.0;
        let cycle = self.sums.len();
        self.locked_power += ((prompt * prompt).re - self.locked_power) / LOCK_PERIODS;
        let in_phase = 2.0 * powers.signal.sqrt() / powers.noise * prompt.re;
        self.sums.iter_mut().for_each(|sum| *sum += in_phase);
        let ended = ((period + 1) % cycle as u64) as usize;
        self.complete[ended] += log_cosh(std::mem::take(&mut self.sums[ended]));
        if ended as u64 != edge {
            return None;
        }
        let own = self.complete[ended];
        if self.locked_power < 0.5 * powers.signal {
            // Symbols are in phase only once the loop is: what was summed before says nothing.
            self.evidence.fill(0.0);
        }
        for k in 0..cycle {
            let ratio = self.complete[k] + log_cosh(self.sums[k]) - own;
            let step = ratio - std::mem::replace(&mut self.ratios[k], ratio);
            self.evidence[k] = (self.evidence[k] + step.clamp(-MOST, MOST)).max(0.0);
        }
        let (best, evidence) =
            self.evidence.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        (*evidence >= CONTRADICTED).then_some(best as u64)
    }
}

impl SymbolSynchroniser {
    /// For symbols of this timing, with an edge (index of an interval) if it is known already; interval 0 starts a code
    /// period.
    pub fn new(timing: SymbolTiming, edge: Option<u64>) -> Self {
        let edge = edge.filter(|_| !timing.is_aligned).map(|e| e % timing.cycle as u64);
        let edge = edge.or(timing.is_aligned.then_some(0));
        let (history, first) = (Vec::new(), 0);
        let rivals = Rivals::new(timing.cycle);
        Self { timing, history, first, edge, sum: Complex64::ZERO, count: 0, rivals }
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

    /// Takes the prompt of code period `period` (consecutive) and appends the symbols that it completes. `powers` in a
    /// prompt, where they are known.
    pub fn push(
        &mut self,
        period: u64,
        prompt: Complex64,
        powers: Option<PromptPowers>,
        symbols: &mut Vec<Symbol>,
    ) {
        if let (Some(edge), Some(position)) = (self.edge, self.position(period)) {
            self.add(period, position, prompt, symbols);
            let powers = powers.filter(|_| !self.timing.is_aligned);
            let contradicted = powers.and_then(|p| self.rivals.push(period, edge, prompt, p));
            if let Some(other) = contradicted {
                self.edge = Some(other);
                self.rivals = Rivals::new(self.timing.cycle);
                (self.sum, self.count) = (Complex64::ZERO, 0);
            }
            return;
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
                    self.push(k, prompt, None, symbols);
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

    const TIMING: SymbolTiming = SymbolTiming { interval_s: 1e-3, cycle: 20, is_aligned: false };

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
                sync.push(k, noise + data[((k + 20 - edge) / 20) as usize], None, &mut bits);
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

    /// At 30 dB-Hz a symbol has a ratio of 20 to the noise, a transition speaks with e^(4 ms of it) at least; four count.
    #[test]
    fn a_wrong_edge_is_taken_back_and_slips_of_the_carrier_move_none() {
        for seed in 0..40u64 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let data: Vec<f64> =
                (0..1000).map(|_| if rng.next_u32() & 1 == 0 { 1.0 } else { -1.0 }).collect();
            let (edge, wrong) = (seed % 20, (seed + 1 + seed / 2 % 19) % 20);
            let mut sync = SymbolSynchroniser::new(TIMING, Some(wrong));
            let (mut bits, mut settled) = (Vec::new(), 0);
            let powers = PromptPowers { signal: 1.0, noise: 1.0 };
            for k in 0..15_000u64 {
                let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
                let noise = Complex64::new(normal(), normal()) / 2f64.sqrt();
                // Half a cycle is lost every 1.37 s.
                let slip = if k / 1370 % 2 == 0 { 1.0 } else { -1.0 };
                let prompt = noise + slip * data[((k + 20 - edge) / 20) as usize];
                sync.push(k, prompt, Some(powers), &mut bits);
                if sync.edge() != Some(edge) {
                    settled = k + 1;
                }
            }
            // Each symbol has a transition with probability one half, so that 1.5 s have 37 +- 4.
            assert!(settled < 1500, "seed {seed}: from {wrong} to {edge} at {settled}");
        }
    }

    #[test]
    fn noise_gives_no_edge() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut sync = SymbolSynchroniser::new(TIMING, None);
        let mut bits = Vec::new();
        for k in 0..20_000 {
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            sync.push(k, Complex64::new(normal(), normal()), None, &mut bits);
        }
        assert!(bits.is_empty());
    }
}
