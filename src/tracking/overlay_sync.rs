//! Synchronisation with the secondary code of a pilot.
//!
//! The product of the prompts of neighbouring code periods has the sign of the product of their secondary chips,
//! whatever the carrier's phase. Each place in the code is scored by the products that it predicts. Where it is wrong,
//! signs are as good as random, and the score exceeds t with probability below exp(-t^2 / (2 sum d^2)) (Hoeffding 1963,
//! theorem 2), d the products. Scores forget, so that a wrong place is contradicted for as long as the track lives.

use num_complex::Complex64;

/// Logarithm of the probability that a wrong place is taken, in one test: 1e-9, and that for each of the places.
const LN_WRONG: f64 = -20.7;
/// Code periods after which products are forgotten, and wiped prompts, of which the newest tell the polarity.
const PRODUCTS: f64 = 250.0;
const PROMPTS: f64 = 25.0;

/// The place of a pilot in its secondary code.
#[derive(Clone, Debug)]
pub(super) struct OverlaySynchroniser {
    chips: Box<[i8]>,
    /// Correlation intervals in a code period.
    intervals: u64,
    /// Of the code period under way.
    sum: Complex64,
    last: Option<Complex64>,
    /// By the chip of code period 0: sums of the products, and of the in-phase prompts, that it explains.
    scores: Vec<f64>,
    wiped: Vec<f64>,
    squares: f64,
    /// The chip of code period 0, and the sign of the prompts after the chips are wiped.
    found: Option<(usize, f64)>,
}

impl OverlaySynchroniser {
    pub(super) fn new(chips: Box<[i8]>, intervals: usize) -> Self {
        let zeros = vec![0.0; chips.len()];
        Self {
            intervals: intervals as u64,
            sum: Complex64::ZERO,
            last: None,
            scores: zeros.clone(),
            wiped: zeros,
            squares: 0.0,
            found: None,
            chips,
        }
    }

    /// Correlation intervals in the secondary code.
    pub(super) fn cycle(&self) -> usize {
        self.chips.len() * self.intervals as usize
    }

    /// Place of a correlation interval in the secondary code, once it is known.
    pub(super) fn position(&self, interval: u64) -> Option<u64> {
        let (first, _) = self.found?;
        Some((interval + first as u64 * self.intervals) % self.cycle() as u64)
    }

    /// What the prompt of a correlation interval is multiplied by to be positive.
    pub(super) fn sign(&self, interval: u64) -> f64 {
        match self.found {
            Some((first, polarity)) => self.chip(first, interval / self.intervals) * polarity,
            None => 1.0,
        }
    }

    /// The sign of the carrier's phase, of two half a cycle apart.
    pub(super) fn polarity(&self) -> f64 {
        self.found.map_or(1.0, |(_, polarity)| polarity)
    }

    fn chip(&self, first: usize, period: u64) -> f64 {
        f64::from(self.chips[(period as usize + first) % self.chips.len()])
    }

    /// Takes the prompt of a correlation interval (consecutive, counted from a code period), as it is. Cost: two
    /// multiplications a code period for each chip.
    pub(super) fn push(&mut self, interval: u64, prompt: Complex64) {
        self.sum += prompt;
        if !(interval + 1).is_multiple_of(self.intervals) {
            return;
        }
        let now = std::mem::take(&mut self.sum);
        let Some(last) = self.last.replace(now) else { return };
        let (period, product) = (interval / self.intervals, (now * last.conj()).re);
        let (keep, keep_prompt) = (1.0 - 1.0 / PRODUCTS, 1.0 - 1.0 / PROMPTS);
        self.squares = keep * keep * self.squares + product * product;
        for first in 0..self.chips.len() {
            let (chip, before) = (self.chip(first, period), self.chip(first, period - 1));
            self.scores[first] = keep * self.scores[first] + product * chip * before;
            self.wiped[first] = keep_prompt * self.wiped[first] + now.re * chip;
        }
        let ln_places = (self.chips.len() as f64).ln();
        let limit = (2.0 * self.squares * (ln_places - LN_WRONG)).sqrt();
        let own = self.found.map_or(0.0, |(first, _)| self.scores[first].max(0.0));
        let best = self.scores.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        if let Some((first, _)) = best.filter(|(_, score)| *score - own > limit)
            && self.found.is_none_or(|(before, _)| before != first)
        {
            self.found = Some((first, self.wiped[first].signum()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::signal::GALILEO_E1C;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Prompts of 1 ms of unit noise at a C/N0, the carrier off by `turn` cycles, from a chip of the code on.
    fn run(cn0_dbhz: f64, turn: f64, first: usize, seed: u64) -> (OverlaySynchroniser, u64) {
        let chips = GALILEO_E1C.overlay.chips(11).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut sync = OverlaySynchroniser::new(chips.clone(), 4);
        let amplitude = Complex64::cis(turn * std::f64::consts::TAU)
            * (10f64.powf(cn0_dbhz / 10.0) * 1e-3).sqrt();
        let mut found = 0;
        for k in 0..2000u64 {
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let noise = Complex64::new(normal(), normal()) / 2f64.sqrt();
            let chip = f64::from(chips[(k as usize / 4 + first) % 25]);
            sync.push(k, amplitude * chip + noise);
            if sync.position(0) != Some(4 * first as u64) {
                found = k + 1;
            }
        }
        (sync, found)
    }

    /// At 27 dB-Hz products of 4 ms have a mean of 2 and a standard deviation of 1.6: by the threshold, 80 of them.
    #[test]
    fn the_place_in_the_code_and_the_polarity_are_found_at_27_dbhz() {
        for seed in 0..25 {
            for (turn, polarity) in [(0.05, 1.0), (0.45, -1.0)] {
                let (sync, found) = run(27.0, turn, seed as usize, seed);
                assert!(found < 900, "seed {seed}: after {found} ms");
                assert_eq!(sync.polarity(), polarity);
            }
        }
    }

    #[test]
    fn noise_has_no_place() {
        for seed in 0..50 {
            assert_eq!(run(-100.0, 0.0, 0, seed).0.position(0), None);
        }
    }
}
