//! From the symbols of E1-B of one satellite to pages.
//!
//! Whenever 500 symbols end, the places of both synchronisation patterns in them are compared with the pattern, each in
//! the polarity that fits it better; where at most [`MAX_SYNC_ERRORS`] of the 20 symbols differ, and also one page
//! after the last that was found, both parts are decoded, and the page is given if its parity holds.
//!
//! **Missed pages.** At a C/N0 of 28 dB-Hz, the threshold of the message, a symbol is wrong with probability 6 %
//! (Es/N0 = 1 dB) and more than 3 of 20 with probability 2 %; after the first page the pattern is not needed.
//!
//! **False pages.** Random symbols fit with probability 0.5 % (two polarities a part), the parity, the flags of the
//! parts and their equal types with 2^-27: at 250 places a second one page in 3 years of a channel that tracks noise.
//! Its word is one of 64 types by chance, and an ephemeris needs four of one issue of data.
//!
//! **No state of lock.** A symbol that is lost or a half-cycle slip costs the page that it falls into.
//!
//! A page is given with its last symbol.

use super::PAGE_SYMBOLS;
use super::page::{InavPage, PART_SYMBOLS, SYNC, page_bits};
use super::words::InavWord;
use crate::message::{Content, MessageDecoder, Page};

/// Symbols of two patterns that may differ.
const MAX_SYNC_ERRORS: usize = 3;

/// Finds pages in the symbols of E1-B of one satellite. Cost: 20 comparisons a symbol; where the patterns fit, two
/// Viterbi decoders over 120 bits.
#[derive(Clone, Debug)]
pub struct InavDecoder {
    /// Index of the last symbol.
    last_index: Option<u64>,
    /// The last symbols; that of index n is at n modulo the length.
    window: [f32; PAGE_SYMBOLS],
    /// Symbols since the stream began.
    received: usize,
    /// Where the next page ends if it follows the last.
    next_end: Option<u64>,
}

impl InavDecoder {
    /// A decoder without symbols.
    pub fn new() -> Self {
        Self { last_index: None, window: [0.0; PAGE_SYMBOLS], received: 0, next_end: None }
    }

    /// The symbol `k` of the window, the oldest first.
    fn symbol(&self, end: u64, k: usize) -> f32 {
        self.window[((end + 1) as usize + k) % PAGE_SYMBOLS]
    }

    /// Symbols of the pattern of a part that differ, in the better polarity.
    fn sync_errors(&self, end: u64, part: usize) -> usize {
        let differs = |k: usize| (self.symbol(end, part + k) < 0.0) != (SYNC[k] < 0);
        let errors = (0..SYNC.len()).filter(|&k| differs(k)).count();
        errors.min(SYNC.len() - errors)
    }

    /// The page that ends with the symbol of this index.
    fn page(&self, end: u64) -> Option<InavPage> {
        let errors = self.sync_errors(end, 0) + self.sync_errors(end, PART_SYMBOLS);
        if errors > MAX_SYNC_ERRORS && self.next_end != Some(end) {
            return None;
        }
        InavPage::decode(&page_bits(&std::array::from_fn(|k| self.symbol(end, k))))
    }
}

impl Default for InavDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl MessageDecoder for InavDecoder {
    fn push(&mut self, symbol: f32, index: u64) -> Option<Page> {
        if self.last_index.and_then(|last| last.checked_add(1)) != Some(index) {
            *self = Self::new();
        }
        self.last_index = Some(index);
        self.window[index as usize % PAGE_SYMBOLS] = symbol;
        self.received = (self.received + 1).min(PAGE_SYMBOLS);
        if self.received < PAGE_SYMBOLS {
            return None;
        }
        let page = self.page(index);
        let length = PAGE_SYMBOLS as u64;
        if page.is_some() || self.next_end == Some(index) {
            self.next_end = index.checked_add(length);
        }
        let page = page?;
        let start_index = index + 1 - length;
        let tow_s = page.word.as_ref().and_then(InavWord::tow_s);
        Some(Page { start_index, tow_s, content: Content::Inav(Box::new(page)) })
    }
}
