//! The convolutional code of rate 1/2 and constraint length K = 7 with generators G1 = 171 and G2 = 133
//! (octal), G1 first, of SBAS, GPS CNAV and Galileo: encoder and soft-decision Viterbi decoders.
//!
//! **Metric.** A symbol is +1 for logical 0 and -1 for logical 1. In white Gaussian noise the most likely
//! path is the one whose symbols correlate best with the received ones, whatever their amplitude, so the
//! metric of a path is the sum of received symbol times expected symbol, and the largest survives. Both
//! generators contain the newest and the oldest bit, so the two branches into a state have opposite
//! symbols: one product serves both.
//!
//! **Decision depth.** Without a tail no end state is known. [`Viterbi`] follows the best of the 64 paths
//! back over [`Viterbi::DELAY`] = 64 bits, 9 K, where the survivors have merged but for rare cases:
//! against the decision over the whole block it costs 2 % more bit errors at Eb/N0 = 2 dB (below 0.01 dB)
//! and none that could be measured at 4 dB. Beyond 5 K the loss falls exponentially with the depth.
//!
//! **Cost.** Per bit 64 additions, comparisons and selections and 64 steps back, below 1 us; no
//! allocation.
//!
//! The code is transparent: inverted symbols (both) decode to inverted bits. Its free distance is 10.

const STATES: usize = 64;
/// Bits of memory, K - 1.
const MEMORY: usize = 6;
/// The register holds the newest bit as its highest of 7.
const GENERATORS: [usize; 2] = [0o171, 0o133];
/// Larger symbols are cut, so that no sum of metrics overflows.
const LARGEST_SYMBOL: f32 = 1e30;

/// The two symbols (+1 or -1) that a register of 7 bits sends.
const fn symbols_of(register: usize) -> [i8; 2] {
    let mut symbols = [0; 2];
    let mut k = 0;
    while k < 2 {
        symbols[k] = 1 - 2 * ((register & GENERATORS[k]).count_ones() % 2) as i8;
        k += 1;
    }
    symbols
}

/// Symbols of the branch into each state from its predecessor whose oldest bit is 0.
const BRANCHES: [[i8; 2]; STATES] = {
    let mut branches = [[0; 2]; STATES];
    let mut state = 0;
    while state < STATES {
        branches[state] = symbols_of(state << 1);
        state += 1;
    }
    branches
};

/// Polarity of the output of G2, which differs between systems.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SecondOutput {
    /// Sent as it is: SBAS, GPS CNAV.
    Upright,
    /// Inverted: Galileo.
    Inverted,
}

impl SecondOutput {
    fn is_inverted(self) -> bool {
        self == Self::Inverted
    }
}

/// The encoder. Its state carries on from bit to bit; a block ends with six zeros as tail.
#[derive(Clone, Debug)]
pub struct Encoder {
    second: SecondOutput,
    state: usize,
}

impl Encoder {
    /// An encoder in state 0.
    pub fn new(second: SecondOutput) -> Self {
        Self { second, state: 0 }
    }

    /// The two symbols of the next bit: +1 for logical 0, -1 for logical 1.
    pub fn push(&mut self, bit: bool) -> [i8; 2] {
        let register = usize::from(bit) << MEMORY | self.state;
        self.state = register >> 1;
        let [first, second] = symbols_of(register);
        [first, if self.second.is_inverted() { -second } else { second }]
    }

    /// The symbols of many bits, two a bit.
    pub fn encode(&mut self, bits: &[bool]) -> Vec<i8> {
        bits.iter().flat_map(|&bit| self.push(bit)).collect()
    }
}

/// One step of all 64 paths. A state is its last six bits, the newest as the highest. Bit s of the result
/// is the oldest bit of the surviving predecessor of state s.
fn step(metrics: &mut [f32; STATES], symbols: [f32; 2], second: SecondOutput) -> u64 {
    let usable =
        |s: f32| if s.is_finite() { s.clamp(-LARGEST_SYMBOL, LARGEST_SYMBOL) } else { 0.0 };
    let first = usable(symbols[0]);
    let second = if second.is_inverted() { -usable(symbols[1]) } else { usable(symbols[1]) };
    let before = *metrics;
    let mut survivors = 0;
    for (state, metric) in metrics.iter_mut().enumerate() {
        let [a, b] = BRANCHES[state];
        let branch = f32::from(a) * first + f32::from(b) * second;
        let from = state << 1 & (STATES - 1);
        let (zero, one) = (before[from] + branch, before[from | 1] - branch);
        *metric = zero.max(one);
        survivors |= u64::from(one > zero) << state;
    }
    // Only differences count: the best stays at zero.
    let best = metrics.iter().copied().fold(f32::MIN, f32::max);
    metrics.iter_mut().for_each(|m| *m -= best);
    survivors
}

/// The newest bit of a state, and the state before it.
fn step_back(state: usize, survivors: u64) -> (bool, usize) {
    let oldest = (survivors >> state & 1) as usize;
    (state >> (MEMORY - 1) == 1, state << 1 & (STATES - 1) | oldest)
}

/// Decodes a block that starts in state 0 and ends there by a tail of six zeros. Gives the bits without
/// the tail; a block that is not longer than its tail gives none. Allocates 8 bytes a bit.
pub fn decode_block(symbols: &[f32], second: SecondOutput) -> Vec<bool> {
    let mut metrics = [f32::MIN / 4.0; STATES];
    metrics[0] = 0.0;
    let survivors: Vec<u64> =
        symbols.chunks_exact(2).map(|s| step(&mut metrics, [s[0], s[1]], second)).collect();
    let mut bits = vec![false; survivors.len()];
    let mut state = 0;
    for (bit, &survivors) in bits.iter_mut().zip(&survivors).rev() {
        (*bit, state) = step_back(state, survivors);
    }
    bits.truncate(survivors.len().saturating_sub(MEMORY));
    bits
}

/// Decodes a stream without blocks, each bit [`Viterbi::DELAY`] bits after it was received.
#[derive(Clone, Debug)]
pub struct Viterbi {
    second: SecondOutput,
    metrics: [f32; STATES],
    /// Survivors of the last steps; that of step n is at n modulo the length.
    survivors: [u64; Self::DELAY],
    steps: usize,
}

impl Viterbi {
    /// Decision depth, bits.
    pub const DELAY: usize = 64;

    /// A decoder without symbols: every state is equally likely.
    pub fn new(second: SecondOutput) -> Self {
        Self { second, metrics: [0.0; STATES], survivors: [0; Self::DELAY], steps: 0 }
    }

    /// Takes the symbols of the next bit and gives the bit that was received [`Viterbi::DELAY`] bits
    /// before it. A symbol that is no finite number counts as erased.
    pub fn push(&mut self, symbols: [f32; 2]) -> Option<bool> {
        let delayed = (self.steps >= Self::DELAY).then(|| self.oldest_bit());
        let slot = self.steps % Self::DELAY;
        self.survivors[slot] = step(&mut self.metrics, symbols, self.second);
        self.steps += 1;
        delayed
    }

    /// The first of the last `DELAY` bits, along the best path.
    fn oldest_bit(&self) -> bool {
        let best = (1..STATES).fold(0, |best, state| {
            if self.metrics[state] > self.metrics[best] { state } else { best }
        });
        let mut at = (false, best);
        for back in 1..=Self::DELAY {
            at = step_back(at.1, self.survivors[(self.steps - back) % Self::DELAY]);
        }
        at.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Random bits, and their symbols at amplitude 1 in white Gaussian noise (Box and Muller).
    fn noisy(count: usize, ebn0_db: f64, second: SecondOutput, seed: u64) -> (Vec<bool>, Vec<f32>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut bits: Vec<bool> = (0..count).map(|_| rng.random()).collect();
        bits.extend([false; MEMORY]);
        // A symbol has half the energy of a bit: variance N0 / 2 = 1 / (2 x Eb/N0 / 2).
        let sigma = 10f64.powf(-ebn0_db / 20.0);
        let symbols = Encoder::new(second).encode(&bits);
        let noise = symbols.iter().map(|_| {
            let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
            sigma * (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
        });
        let received = symbols.iter().zip(noise).map(|(&s, n)| (f64::from(s) + n) as f32).collect();
        bits.truncate(count);
        (bits, received)
    }

    /// Output of scikit-dsp-comm 2.1.2, `FECConv(('1111001', '1011011')).conv_encoder(bits, '000000')`.
    #[test]
    fn the_encoder_agrees_with_scikit_dsp_comm() {
        let bits = "10000001011001110100".chars().map(|c| c == '1').collect::<Vec<_>>();
        let logic = |second| -> String {
            Encoder::new(second)
                .encode(&bits)
                .iter()
                .map(|&s| if s < 0 { '1' } else { '0' })
                .collect()
        };
        assert_eq!(logic(SecondOutput::Upright), "1110111100011111100010010111000001110001");
        assert_eq!(logic(SecondOutput::Inverted), "1011101001001010110111000010010100100100");
    }

    /// Union bound of the bit error rate: sum of B_d Q(sqrt(2 d R Eb/N0)), with the bit weights B_d of
    /// this code: 36, 211, 1404, 11633, ... from d = 10 in steps of 2. At 4 dB it is 1.88e-5 (the terms up
    /// to d = 30), half of it from d = 10. Errors come in events of 3 and more bits: with the numbers of
    /// paths 11, 38, 193, 1331, ... the count has a variance of 9.7e-5 a bit. Hard decisions would give
    /// 2e-3.
    #[test]
    fn the_bit_error_rate_at_4_db_is_below_the_union_bound() {
        const COUNT: usize = 4_000_000;
        let bound = 1.88e-5 * COUNT as f64 + 3.0 * (9.7e-5 * COUNT as f64).sqrt();
        let (bits, symbols) = noisy(COUNT, 4.0, SecondOutput::Upright, 1);
        let mut viterbi = Viterbi::new(SecondOutput::Upright);
        let decoded = symbols.chunks(2).filter_map(|s| viterbi.push([s[0], s[1]]));
        let errors = decoded.zip(&bits).filter(|(decoded, bit)| decoded != *bit).count();
        assert!(errors > 0 && (errors as f64) < bound, "{errors} errors");
    }

    /// At 2 dB, below any threshold of use, one decision in 200 is wrong. There the window's 64 bits add
    /// 2 % to the errors of the whole block, and one decision in some 6000 differs.
    #[test]
    fn the_window_decides_as_the_block_does_and_polarity_passes_through() {
        for second in [SecondOutput::Upright, SecondOutput::Inverted] {
            let (bits, symbols) = noisy(200_000, 2.0, second, 2);
            let block = decode_block(&symbols, second);
            assert_eq!(block.len(), bits.len());
            let wrong =
                |decoded: &[bool]| decoded.iter().zip(&bits).filter(|(a, b)| a != b).count();
            for sign in [1.0, -1.0] {
                let mut viterbi = Viterbi::new(second);
                // Inverting both symbols is transparent for Galileo's code too.
                let window: Vec<bool> = symbols
                    .chunks(2)
                    .filter_map(|s| viterbi.push([sign * s[0], sign * s[1]]))
                    .map(|bit| bit != (sign < 0.0))
                    .collect();
                let differ = window.iter().zip(&block).filter(|(a, b)| a != b).count();
                assert!(differ <= 100, "{differ} decisions differ");
                let (window, block) = (wrong(&window), wrong(&block));
                assert!(
                    block < 1_500 && window <= block + block / 20,
                    "{window} and {block} errors"
                );
            }
        }
    }

    #[test]
    fn short_and_odd_blocks_and_symbols_that_are_no_numbers_are_harmless() {
        for length in 0..=13 {
            assert!(decode_block(&vec![1.0; length], SecondOutput::Upright).is_empty());
        }
        assert_eq!(decode_block(&[1.0; 15], SecondOutput::Upright), [false]);
        // A burst of the largest symbols has no effect beyond the depth.
        let (bits, symbols) = noisy(1_000, 8.0, SecondOutput::Upright, 3);
        let mut viterbi = Viterbi::new(SecondOutput::Upright);
        for symbol in [f32::INFINITY, f32::NAN, f32::MAX, f32::MIN, f32::MAX, 0.0] {
            viterbi.push([symbol, -symbol]);
        }
        let decoded = symbols.chunks(2).filter_map(|s| viterbi.push([s[0], s[1]])).skip(6);
        assert!(decoded.zip(&bits).skip(64).all(|(decoded, bit)| decoded == *bit));
    }
}
