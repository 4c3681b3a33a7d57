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
//! Words 3 to 10 count one by one where a subframe is not whole. Of the one before the first whole subframe, or of one that
//! was refused, those are given that keep parity from the end backwards, in the polarity of the whole one, but for the
//! two earliest: of words that the start of a track spoiled one in 64 keeps parity, so one of 3e5 is given. Of the subframe
//! under way each word is given as it comes, once its first two have continued the time of the one before; where it then
//! ends without being whole, that is told, as a slip shows at its end alone.
//!
//! Each subframe has its own polarity, so a half-cycle slip costs the subframe that it falls into and no
//! other. That subframe is refused: of words that a slip corrupts one in 64 keeps parity, but the slip turns
//! the 00 at the end of word 10 into 11. Weak bits are not corrected: the code detects three errors a word, and
//! correction would weaken that.

use super::fields::Fields;
use super::parity::decode_word;
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

/// Words of a subframe that is not whole, or not yet.
#[derive(Clone, Debug, PartialEq)]
pub struct LooseWords {
    /// Subframe number, 1 to 5.
    pub id: u8,
    /// Time of week of the transmission of its first bit, s, by the satellite's clock.
    pub tow: f64,
    /// What became of it.
    pub state: WordsState,
    /// Source bits of words 3 to 10, of those that are known.
    pub words: [Option<u32>; 8],
}

/// Why words are loose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordsState {
    /// The subframe before a whole one, which was not whole.
    Torn,
    /// The subframe is under way.
    UnderWay,
    /// The subframe has ended, and is not whole: its words, given before, are not to be believed.
    Refused,
}

impl LooseWords {
    fn new(header: &Header, state: WordsState) -> Self {
        Self { id: header.id, tow: header.tow(), state, words: [None; 8] }
    }

    /// Whether they are of the same subframe.
    pub fn is_of(&self, other: &Self) -> bool {
        (self.id, self.tow) == (other.id, other.tow)
    }

    /// The message, if all words are known.
    pub fn message(&self) -> Option<LnavMessage> {
        let mut words = Header::new(self.id, self.tow).write([0; 10]).ok()?;
        for (word, known) in words[2..].iter_mut().zip(self.words) {
            *word = known?;
        }
        Some(LnavMessage::decode(&words))
    }
}

/// Of the words before the first whole subframe, the earliest that are not believed.
const DOUBTFUL_WORDS: usize = 2;

/// The subframe after this one.
fn after(header: &Header) -> Header {
    let tow_count = (header.tow_count + 1) % TOW_COUNTS;
    Header { id: header.id % 5 + 1, tow_count, ..header.clone() }
}

/// The subframe before this one.
fn before(header: &Header) -> Header {
    let tow_count = (header.tow_count + TOW_COUNTS - 1) % TOW_COUNTS;
    Header { id: (header.id + 3) % 5 + 1, tow_count, ..header.clone() }
}

/// Finds subframes in the bits of one satellite; their polarity is open. Cost: a shift of five words and a
/// comparison per bit;
/// parity is computed only where a preamble stands.
#[derive(Clone, Debug, Default)]
pub struct FrameDecoder {
    window: Window,
    /// Bits in the window, up to all that it holds.
    received: usize,
    last_index: Option<u64>,
    last_subframe: Option<Subframe>,
    /// The subframe under way, and whether its bits are inverted.
    current: Option<(Header, bool)>,
    /// Words of the subframe before the last one, which was not whole.
    torn: Option<LooseWords>,
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
        self.received = (self.received + 1).min(2 * SUBFRAME_BITS);
        if self.received < SUBFRAME_BITS {
            return None;
        }
        let inverted = self.preamble(SUBFRAME_BITS)?;
        let received: [u32; 10] = std::array::from_fn(|k| self.word(10 - k, inverted));
        if (received[1] | received[9]) & 3 != 0 {
            return None;
        }
        let words = decode_words(&received, 0).filter(Header::is_plausible)?;
        let (header, _) = decode_subframe(&words);
        let start_index = (index + 1).saturating_sub(SUBFRAME_BITS as u64);
        let found = Subframe { start_index, inverted, header, words };
        // Of two inconsistent subframes neither is used as a reference any longer.
        let follows = match self.last_subframe.take() {
            Some(last) if !last.leads_to(&found) => return None,
            Some(last) => found.start_index - last.start_index == SUBFRAME_BITS as u64,
            None => false,
        };
        if !follows {
            self.torn = self.torn_words(&found);
        }
        self.last_subframe = Some(found.clone());
        Some(found)
    }

    /// Whether the bits are inverted, if a preamble stands so many bits back.
    fn preamble(&self, back: usize) -> Option<bool> {
        match self.window.bits(back, 8) {
            PREAMBLE => Some(false),
            first if first ^ 0xFF == PREAMBLE => Some(true),
            _ => None,
        }
    }

    /// The word that starts so many words back.
    fn word(&self, back: usize, inverted: bool) -> u32 {
        self.window.bits(30 * back, 30) ^ if inverted { 0x3FFF_FFFF } else { 0 }
    }

    /// The source bits of the word that starts so many words back, if parity holds.
    fn source_bits(&self, back: usize, inverted: bool) -> Option<u32> {
        let tail = self.window.bits(30 * back + 2, 2) ^ if inverted { 3 } else { 0 };
        decode_word(self.word(back, inverted), tail)
    }

    /// What is left of the subframe before one that was found at the end of the window.
    fn torn_words(&self, found: &Subframe) -> Option<LooseWords> {
        let mut loose = LooseWords::new(&before(&found.header), WordsState::Torn);
        // Word 10 ends in 00, whatever came before.
        if self.received < SUBFRAME_BITS + 32 || self.word(11, found.inverted) & 3 != 0 {
            return None;
        }
        let whole = (self.received - SUBFRAME_BITS - 2) / 30;
        let keeps_parity = |k: &usize| self.source_bits(18 - k, found.inverted).is_some();
        let earliest = (0..8).rev().take(whole).take_while(keeps_parity).last()?;
        for k in earliest + DOUBTFUL_WORDS..8 {
            loose.words[k] = self.source_bits(18 - k, found.inverted);
        }
        loose.words.iter().any(Option::is_some).then_some(loose)
    }

    /// The word that the newest bit completes in the subframe after the last whole one; at its end, that it was not whole.
    fn word_under_way(&mut self, index: u64) -> Option<LooseWords> {
        let last = self.last_subframe.as_ref()?;
        let bits = (index + 1).checked_sub(last.start_index + SUBFRAME_BITS as u64)? as usize;
        let (count, is_whole) = (bits / 30, bits.is_multiple_of(30));
        if !is_whole || !(2..=10).contains(&count) {
            return None;
        }
        if count == 10 {
            return Some(LooseWords::new(&after(&last.header), WordsState::Refused));
        }
        if count == 2 {
            self.current = self.header_under_way(&last.header);
            return None;
        }
        let (header, inverted) = self.current.clone()?;
        let Some(word) = self.source_bits(1, inverted) else {
            // What follows is doubtful too.
            self.current = None;
            return None;
        };
        let mut loose = LooseWords::new(&header, WordsState::UnderWay);
        loose.words[count - 3] = Some(word);
        Some(loose)
    }

    /// The header that the last two words are, if they follow those of the subframe before.
    fn header_under_way(&self, last: &Header) -> Option<(Header, bool)> {
        let inverted = self.preamble(60)?;
        let first = decode_word(self.word(2, inverted), 0)?;
        let second = self.source_bits(1, inverted).filter(|_| self.word(1, inverted) & 3 == 0)?;
        let (header, _) = decode_subframe(&[first, second, 0, 0, 0, 0, 0, 0, 0, 0]);
        let Header { id, tow_count, .. } = after(last);
        ((header.id, header.tow_count) == (id, tow_count)).then_some((header, inverted))
    }
}

impl MessageDecoder for FrameDecoder {
    fn push(&mut self, symbol: f32, index: u64) -> Option<Page> {
        let loose =
            |words| Page { start_index: index, tow_s: None, content: Content::LnavWords(words) };
        if let Some(subframe) = self.next_subframe(symbol, index) {
            let (start_index, tow_s) = (subframe.start_index, Some(subframe.tow()));
            return Some(Page { start_index, tow_s, content: Content::Lnav(subframe) });
        }
        self.torn.take().or_else(|| self.word_under_way(index)).map(loose)
    }
}

/// The last 640 bits.
#[derive(Clone, Debug, Default)]
struct Window([u64; 10]);

impl Window {
    fn push(&mut self, bit: bool) {
        let mut carry = u64::from(bit);
        for word in self.0.iter_mut().rev() {
            let out = *word >> 63;
            *word = *word << 1 | carry;
            carry = out;
        }
    }

    /// `count` bits (at most 32) of which the first is `back` bits before the end, the first as the most significant.
    fn bits(&self, back: usize, count: usize) -> u32 {
        let end = 640 - back + count;
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
