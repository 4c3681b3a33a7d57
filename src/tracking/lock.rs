//! Estimation of C/N0 and detection of lock from the correlation of neighbouring prompts.
//!
//! With p\[k\] the prompts of code periods T inside a data symbol, R0 = E|p\[k\]|^2 = S + N and R1 = E
//! p\[k+1\] p\[k\]* = S exp(j 2 pi df T): white noise does not contribute to R1, whatever its power, and C/N0
//! = |R1| / (R0 - |R1|) / T. Neither needs carrier phase. Where the symbol edge is known, the product of the
//! second half of a symbol and its first, summed over ten bits of LNAV or as many periods, has the phase 2 pi
//! df half a symbol, which reveals a false lock of the carrier loop.

use crate::gnss::signal::SymbolTiming;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Periods averaged for one decision, and summed for one estimate of the frequency error. At 30 dB-Hz and 1
/// ms R1/N is 1 +- sqrt(3/200) = 0.12.
const BLOCK: usize = 200;

/// A block below this C/N0 (of all components) indicates loss of lock, dB-Hz: six standard deviations from a satellite at 30.
const LOSS_DBHZ: f64 = 24.5;

/// Number of consecutive blocks below it that mean loss of lock.
const BAD_BLOCKS: usize = 3;

/// Blocks in the running average of the reported C/N0 (1 s).
const AVERAGED: f64 = 5.0;

/// State of the lock detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LockState {
    /// Not enough data yet.
    PullingIn,
    /// The signal is present.
    Locked,
    /// The signal is lost.
    Lost,
}

/// Powers in a prompt.
#[derive(Clone, Copy, Debug)]
pub struct PromptPowers {
    /// Of the signal.
    pub signal: f64,
    /// Of the noise.
    pub noise: f64,
}

/// Running correlation of neighbouring prompts.
#[derive(Clone, Debug)]
pub struct LockDetector {
    timing: SymbolTiming,
    loss_dbhz: f64,
    last: Option<Complex64>,
    r0: f64,
    r1: Complex64,
    pairs: usize,
    signal: f64,
    noise: f64,
    blocks: usize,
    bad: usize,
    /// Sums of the first and the second half of the current symbol.
    halves: [Complex64; 2],
    turn: Complex64,
    symbols: usize,
}

impl LockDetector {
    /// For symbols of this timing, of a component with this fraction of the signal's power.
    pub fn new(timing: SymbolTiming, power_fraction: f64) -> Self {
        Self {
            timing,
            loss_dbhz: LOSS_DBHZ + 10.0 * power_fraction.log10(),
            last: None,
            r0: 0.0,
            r1: Complex64::ZERO,
            pairs: 0,
            signal: 0.0,
            noise: 0.0,
            blocks: 0,
            bad: 0,
            halves: [Complex64::ZERO; 2],
            turn: Complex64::ZERO,
            symbols: 0,
        }
    }

    /// Takes a prompt and its position in the data symbol where that is known. Returns, once in 200 periods,
    /// the frequency error in Hz if it is significant (five standard deviations).
    pub fn push(&mut self, prompt: Complex64, position: Option<u64>) -> Option<f64> {
        if let Some(last) = self.last.replace(prompt).filter(|_| position != Some(0)) {
            self.r0 += 0.5 * (prompt.norm_sqr() + last.norm_sqr());
            self.r1 += prompt * last.conj();
            self.pairs += 1;
        }
        if self.pairs >= BLOCK {
            self.end_block();
        }
        let position = position?;
        if position == 0 {
            self.halves = [Complex64::ZERO; 2];
        }
        let cycle = self.timing.cycle as u64;
        self.halves[usize::from(position >= cycle / 2)] += prompt;
        if position + 1 == cycle { self.end_symbol() } else { None }
    }

    fn end_symbol(&mut self) -> Option<f64> {
        let [first, second] = self.halves;
        self.turn += second * first.conj();
        self.symbols += 1;
        if self.symbols * self.timing.cycle < BLOCK {
            return None;
        }
        let (angle, count) = (self.turn.arg(), self.symbols as f64);
        (self.turn, self.symbols) = (Complex64::ZERO, 0);
        let half = 0.5 * self.timing.cycle as f64;
        // Phase noise of a product of two halves of power ratio N/S each: sqrt(N/S (1 + N/2S)).
        let ratio = self.noise / (half * self.signal).max(f64::MIN_POSITIVE);
        let sigma = (ratio * (1.0 + 0.5 * ratio) / count).sqrt();
        (self.blocks > 0 && angle.abs() > 5.0 * sigma)
            .then_some(angle / TAU * (1.0 / (half * self.timing.interval_s)))
    }

    fn end_block(&mut self) {
        let pairs = self.pairs as f64;
        let (signal, total) = (self.r1.norm() / pairs, self.r0 / pairs);
        let noise = (total - signal).max(1e-9 * total);
        (self.r0, self.r1, self.pairs) = (0.0, Complex64::ZERO, 0);
        self.blocks += 1;
        let weight = 1.0 / (self.blocks as f64).min(AVERAGED);
        self.signal += weight * (signal - self.signal);
        self.noise += weight * (noise - self.noise);
        self.bad = if self.dbhz(signal, noise) < self.loss_dbhz { self.bad + 1 } else { 0 };
    }

    /// C/N0 over the last second, dB-Hz; None before the first 0.2 s.
    pub fn cn0_dbhz(&self) -> Option<f64> {
        (self.blocks > 0).then(|| self.dbhz(self.signal, self.noise))
    }

    /// Powers in a prompt, averaged over a second, once known.
    pub fn powers(&self) -> Option<PromptPowers> {
        let (signal, noise) = (self.signal, self.noise);
        (self.blocks > 0).then_some(PromptPowers { signal, noise })
    }

    fn dbhz(&self, signal: f64, noise: f64) -> f64 {
        10.0 * (signal / noise * (1.0 / self.timing.interval_s)).max(1.0).log10()
    }

    /// The current state.
    pub fn state(&self) -> LockState {
        match self {
            _ if self.bad >= BAD_BLOCKS => LockState::Lost,
            _ if self.blocks == 0 || self.bad == self.blocks => LockState::PullingIn,
            _ => LockState::Locked,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const TIMING: SymbolTiming = SymbolTiming { interval_s: 1e-3, cycle: 20, is_aligned: false };

    /// Prompts of a C/N0 with unit noise power, rotating by `df` Hz.
    fn run(cn0: f64, df: f64, count: usize, seed: u64) -> (LockDetector, Vec<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let amplitude = (10f64.powf(cn0 / 10.0) * 1e-3).sqrt();
        let mut detector = LockDetector::new(TIMING, 1.0);
        let mut errors = Vec::new();
        for k in 0..count {
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let noise = Complex64::new(normal(), normal()) / 2f64.sqrt();
            let bit = if k / 20 * 7 % 3 == 0 { -1.0 } else { 1.0 };
            let prompt = Complex64::cis(TAU * df * k as f64 * 1e-3) * amplitude * bit + noise;
            errors.extend(detector.push(prompt, Some(k as u64 % 20)));
        }
        (detector, errors)
    }

    #[test]
    fn cn0_is_measured_and_thirty_dbhz_is_never_reported_lost() {
        for cn0 in [30.0, 35.0, 45.0] {
            for seed in 0..50 {
                let (detector, errors) = run(cn0, 0.0, 5000, seed);
                // 1000 pairs: relative standard deviation of S/N sqrt((1 + 2 S/N)/1000) / (S/N), four of
                // them.
                let snr = 10f64.powf(cn0 / 10.0) * 1e-3;
                let sigma = 4.343 * ((1.0 + 2.0 * snr + snr * snr) / 1000.0).sqrt() / snr;
                assert!((detector.cn0_dbhz().unwrap() - cn0).abs() < 4.0 * sigma);
                assert_eq!(detector.state(), LockState::Locked);
                assert!(errors.is_empty(), "{cn0} {seed} {errors:?}");
            }
        }
    }

    #[test]
    fn noise_is_reported_lost_and_a_false_lock_is_detected() {
        for seed in 0..50 {
            assert_eq!(run(0.0, 0.0, 2000, seed).0.state(), LockState::Lost);
            let (_, errors) = run(40.0, 25.0, 2000, seed);
            assert!(
                errors.iter().all(|e| (e - 25.0).abs() < 10.0) && errors.len() == 9,
                "{errors:?}"
            );
        }
    }
}
