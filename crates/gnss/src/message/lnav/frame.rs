//! Frame synchronisation: from the bits of one satellite to subframes whose parity holds.
//!
//! A Costas loop leaves the polarity of the bits open. The decoder looks at the last 300 bits after each
//! new one. They are a subframe if, in one polarity or the other,
//!
//! 1. they begin with the preamble,
//! 2. all ten words keep parity, the first after D29* = D30* = 0,
//! 3. words 2 and 10 end in D29 = D30 = 0, as they do in every subframe,
//! 4. the subframe number is 1 to 5 and the TOW count below 100 800, and
//! 5. the TOW count continues that of the subframe before, as far as bits without a gap lead back to one.
//!
//! So the first complete subframe is found, without a second preamble to confirm it. A window
//! of random bits passes with probability 2 x 2^-8 (1) x 2^-60 (2) x 2^-4 (3) x 5/8 x 0.77 (4) = 2e-22:
//! at 50 bit/s once in 3e12 years a channel.
//!
//! Each subframe has its own polarity, so a half-cycle slip costs the subframe that it falls into and no
//! other. That subframe is refused: of words that a slip corrupts one in 64 keeps parity, but the slip turns
//! the 00 at the end of word 10 into 11. Weak bits are not corrected: the code detects three errors a word, and
//! correction would weaken that.

use super::{
    DataWords, Header, LnavMessage, PREAMBLE, SUBFRAME_BITS, SUBFRAME_SECONDS, TOW_COUNTS,
    decode_subframe, decode_words,
};
use crate::message::{Content, MessageDecoder, Page};

/// One subframe as received.
#[derive(Clone, Debug, PartialEq)]
pub struct Subframe {
    /// Index of its first bit, as the caller counts.
    pub start_index: u64,
    /// Whether the received bits were inverted.
    pub inverted: bool,
    /// Telemetry and handover words: subframe number, flags, time.
    pub header: Header,
    /// Source bits of the ten words, not inverted.
    pub words: DataWords,
}

impl Subframe {
    /// Subframe number, 1 to 5.
    pub fn id(&self) -> u8 {
        self.header.id
    }

    /// Time of week of the transmission of its first bit, s, by the satellite's clock.
    pub fn tow(&self) -> f64 {
        self.header.tow()
    }

    /// Its message.
    pub fn message(&self) -> LnavMessage {
        LnavMessage::decode(&self.words)
    }

    /// Whether `next` has the time of week that follows from this one's.
    fn leads_to(&self, next: &Self) -> bool {
        let bits = next.start_index - self.start_index;
        let counts = bits / SUBFRAME_BITS as u64 % u64::from(TOW_COUNTS);
        let expected = self.tow() / SUBFRAME_SECONDS + counts as f64;
        bits.is_multiple_of(SUBFRAME_BITS as u64)
            && next.tow() / SUBFRAME_SECONDS == expected % f64::from(TOW_COUNTS)
    }
}

/// Finds subframes in the bits of one satellite; their polarity is open. Cost: a shift of five words and a
/// comparison per bit;
/// parity is computed only where a preamble stands.
#[derive(Clone, Debug, Default)]
pub struct FrameDecoder {
    window: Window,
    /// Bits in the window, up to 300.
    received: usize,
    last_index: Option<u64>,
    last_subframe: Option<Subframe>,
}

impl FrameDecoder {
    /// A decoder without bits.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the next bit and its index, and gives the subframe that it completes.
    fn next_subframe(&mut self, bit: f32, index: u64) -> Option<Subframe> {
        if self.last_index.is_some_and(|last| last.wrapping_add(1) != index) {
            *self = Self::new();
        }
        self.last_index = Some(index);
        self.window.push(bit < 0.0);
        self.received = (self.received + 1).min(SUBFRAME_BITS);
        if self.received < SUBFRAME_BITS {
            return None;
        }
        let inverted = match self.window.bits(0, 8) {
            PREAMBLE => false,
            first if first ^ 0xFF == PREAMBLE => true,
            _ => return None,
        };
        let flip = if inverted { 0x3FFF_FFFF } else { 0 };
        let received: [u32; 10] = std::array::from_fn(|k| self.window.bits(30 * k, 30) ^ flip);
        if (received[1] | received[9]) & 3 != 0 {
            return None;
        }
        let words = decode_words(&received, 0).filter(Header::is_plausible)?;
        let (header, _) = decode_subframe(&words);
        let start_index = (index + 1).saturating_sub(SUBFRAME_BITS as u64);
        let found = Subframe { start_index, inverted, header, words };
        // Of two inconsistent subframes neither is used as a reference any longer.
        match self.last_subframe.take() {
            Some(last) if !last.leads_to(&found) => None,
            _ => {
                self.last_subframe = Some(found.clone());
                Some(found)
            }
        }
    }
}

impl MessageDecoder for FrameDecoder {
    fn push(&mut self, symbol: f32, index: u64) -> Option<Page> {
        let subframe = self.next_subframe(symbol, index)?;
        let (start_index, tow_s) = (subframe.start_index, Some(subframe.tow()));
        Some(Page { start_index, tow_s, content: Content::Lnav(subframe) })
    }
}

/// The last 320 bits, of which the newest 300 are looked at.
#[derive(Clone, Debug, Default)]
struct Window([u64; 5]);

impl Window {
    fn push(&mut self, bit: bool) {
        let mut carry = u64::from(bit);
        for word in self.0.iter_mut().rev() {
            let out = *word >> 63;
            *word = *word << 1 | carry;
            carry = out;
        }
    }

    /// Bits `from..from + count` (count at most 32) of the newest 300, the first as the most significant.
    fn bits(&self, from: usize, count: usize) -> u32 {
        let end = 20 + from + count;
        let (word, offset) = ((end - 1) / 64, (end - 1) % 64 + 1);
        let before = if word > 0 { self.0[word - 1] } else { 0 };
        let both = u128::from(before) << 64 | u128::from(self.0[word]);
        ((both >> (64 - offset)) & ((1 << count) - 1)) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Subframe1, encode_subframe};
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Soft bits of `count` subframes from time of week `tow`, with various contents.
    fn frames(count: u32, tow: f64) -> Vec<f32> {
        let mut bits = Vec::new();
        for k in 0..count {
            let header = Header::new((k % 5 + 1) as u8, tow + 6.0 * f64::from(k));
            let message = match k % 5 {
                0 => LnavMessage::Clock(Subframe1 { week: 142, iodc: 39, ..Subframe1::default() }),
                id => LnavMessage::Other(id as u8),
            };
            for word in encode_subframe(&header, &message).unwrap() {
                bits.extend((0..30).rev().map(|b| if word >> b & 1 == 1 { -1.0f32 } else { 1.0 }));
            }
        }
        bits
    }

    fn decode(bits: &[f32]) -> Vec<Subframe> {
        let mut decoder = FrameDecoder::new();
        bits.iter().zip(0..).filter_map(|(&bit, k)| decoder.next_subframe(bit, k)).collect()
    }

    #[test]
    fn the_first_whole_subframe_is_found_wherever_it_starts_and_whatever_the_polarity() {
        let all = frames(4, 604_788.0);
        for cut in [0, 1, 2, 5, 29, 150, 299, 300] {
            for sign in [1.0, -1.0] {
                let bits: Vec<f32> = all[cut..].iter().map(|b| b * sign).collect();
                let found = decode(&bits);
                let first = cut.div_ceil(300);
                assert_eq!(found.len(), 4 - first, "cut {cut}");
                assert_eq!(found[0].start_index as usize, 300 * first - cut);
                assert_eq!(found[0].inverted, sign < 0.0);
                // The second subframe is the last of its week.
                let tows: Vec<f64> = found.iter().map(Subframe::tow).collect();
                assert_eq!(tows, [604_788.0, 604_794.0, 0.0, 6.0][first..]);
                assert_eq!(usize::from(found[0].id()), first + 1);
            }
        }
    }

    #[test]
    fn a_half_cycle_slip_costs_the_subframe_it_falls_into_and_no_other() {
        let all = frames(4, 0.0);
        for slip in 0..=1200 {
            let bits: Vec<f32> =
                all.iter().enumerate().map(|(k, b)| if k < slip { *b } else { -b }).collect();
            let starts: Vec<u64> = decode(&bits).iter().map(|s| s.start_index / 300).collect();
            let hit = (slip % 300 != 0).then_some(slip as u64 / 300);
            let expected: Vec<u64> = (0..4).filter(|k| Some(*k) != hit).collect();
            assert_eq!(starts, expected, "slip at bit {slip}");
        }
    }

    #[test]
    fn no_wrong_bit_passes_and_lost_bits_start_afresh() {
        let all = frames(2, 12.0);
        for wrong in 0..300 {
            let mut bits = all.clone();
            bits[wrong] = -bits[wrong];
            assert_eq!(decode(&bits).iter().map(|s| s.start_index).collect::<Vec<_>>(), [300]);
        }
        let mut decoder = FrameDecoder::new();
        let indices = (0..200).chain(201..700);
        let found = indices.zip(&all).filter_map(|(k, bit)| decoder.next_subframe(*bit, k)).count();
        assert_eq!(found, 1, "the first is torn, the second whole");
    }

    /// 10^7 windows x 2e-22: a single subframe would refute the false-lock probability of the module's doc.
    #[test]
    fn ten_million_random_bits_give_no_subframe() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut decoder = FrameDecoder::new();
        for index in 0..10_000_000 {
            let bit = if rng.random::<bool>() { 1.0 } else { -1.0 };
            assert_eq!(decoder.next_subframe(bit, index), None);
        }
    }

    #[test]
    fn a_subframe_inconsistent_with_the_time_of_the_one_before_is_refused() {
        let bits = [frames(1, 600.0), frames(2, 900.0)].concat();
        let tows: Vec<f64> = decode(&bits).iter().map(Subframe::tow).collect();
        assert_eq!(tows, [600.0, 906.0]);
    }
}
