//! Pages of I/NAV on E1-B: bits, parity and symbols (Galileo OS SIS ICD 2.1, 4.1.4, 4.3.2 and 5.1.9.4).

use super::words::InavWord;
use super::{PAGE_SYMBOLS, WORD_BITS};
use crate::message::convolutional::{Encoder, SecondOutput, decode_block};
use crate::message::crc24q;
use crate::message::fields::{OutOfRange, Walk};

/// Bits of a part of a page with its tail of six zeros.
const PART_BITS: usize = 120;
/// Symbols of a part: synchronisation and 240 coded ones; a second.
pub(super) const PART_SYMBOLS: usize = 250;
/// Synchronisation pattern, sent uncoded before each part (4.3.2.1).
pub(super) const SYNC: [i8; 10] = [1, -1, 1, -1, -1, 1, 1, 1, 1, 1];
/// Interleaver: written by columns of 8, sent by rows of 30.
const COLUMNS: usize = 30;
const ROWS: usize = 8;
/// Bits of the even part that the parity covers, and of the odd part.
const CHECKED_EVEN: usize = 114;
const CHECKED_ODD: usize = 82;

/// The bits of a page, even part before odd part, each with its tail of six zeros.
pub type InavPageBits = [bool; 2 * PART_BITS];

/// A page of E1-B.
#[derive(Clone, Debug, PartialEq)]
pub struct InavPage {
    /// The word; none of an alert page, whose contents are reserved. The parity of those goes over the parts that E1-B
    /// and E5b send at one time: from E1-B alone it holds where they send the same, and such a page is lost elsewhere.
    pub word: Option<InavWord>,
    /// Field of the navigation message authentication OSNMA, 40 bits.
    pub osnma: [u8; 5],
    /// Part of a return link message of search and rescue, 22 bits.
    pub sar: u32,
    /// Two spare bits.
    pub spare: u8,
    /// Secondary synchronisation pattern (OS SIS ICD 5.1.9.5): since 2023 it tells the time modulo 6 s.
    pub ssp: u8,
}

impl InavPage {
    /// A page of this word without messages to others.
    pub fn new(word: InavWord) -> Self {
        Self { word: Some(word), osnma: [0; 5], sar: 0, spare: 1, ssp: 0 }
    }

    /// Reads a page; none if its parts are not an even and an odd one of one type, or the parity does not hold.
    pub fn decode(bits: &InavPageBits) -> Option<Self> {
        let (even, odd) = bits.split_at(PART_BITS);
        if even[0] || !odd[0] || even[1] != odd[1] || parity(bits) != sent_parity(odd) {
            return None;
        }
        let mut page = Self { word: None, osnma: [0; 5], sar: 0, spare: 0, ssp: 0 };
        page.walk(&mut Walk::reader(odd, 18));
        if !even[1] {
            let word: Vec<bool> = [&even[2..CHECKED_EVEN], &odd[2..18]].concat();
            page.word = Some(InavWord::decode(&word.try_into().expect("112 and 16 bits")));
        }
        Some(page)
    }

    /// The bits of the page with parity and tails. Of an alert page the reserved bits of the word are zero.
    ///
    /// # Errors
    /// If a value does not fit its field.
    pub fn encode(&self) -> Result<InavPageBits, OutOfRange> {
        let is_alert = self.word.is_none();
        let word = self.word.as_ref().map_or(Ok([false; WORD_BITS]), InavWord::encode)?;
        let (first, last) = word.split_at(CHECKED_EVEN - 2);
        let mut odd = Walk::writer(&[false; PART_BITS]);
        for mut bit in [true, is_alert].into_iter().chain(last.iter().copied()) {
            odd.flag(&mut bit);
        }
        self.clone().walk(&mut odd);
        let odd = odd.finish::<PART_BITS>()?;
        let mut bits = [false; 2 * PART_BITS];
        bits[1] = is_alert;
        bits[2..CHECKED_EVEN].copy_from_slice(first);
        bits[PART_BITS..].copy_from_slice(&odd);
        let parity = parity(&bits);
        for (k, bit) in bits[PART_BITS + CHECKED_ODD..][..24].iter_mut().enumerate() {
            *bit = parity >> (23 - k) & 1 == 1;
        }
        Ok(bits)
    }

    /// The fields of the odd part after the word.
    fn walk(&mut self, w: &mut Walk) {
        self.osnma.iter_mut().for_each(|byte| w.count("OSNMA", byte, 8));
        w.count("SAR", &mut self.sar, 22);
        w.count("spare", &mut self.spare, 2);
        w.spare(24);
        w.count("SSP", &mut self.ssp, 8);
    }
}

fn parity(bits: &InavPageBits) -> u32 {
    crc24q::checksum(&[&bits[..CHECKED_EVEN], &bits[PART_BITS..][..CHECKED_ODD]].concat())
}

fn sent_parity(odd: &[bool]) -> u32 {
    odd[CHECKED_ODD..][..24].iter().fold(0, |value, &bit| value << 1 | u32::from(bit))
}

/// The symbols of a page, +1 for logical 0 and -1 for logical 1.
pub fn page_symbols(bits: &InavPageBits) -> [i8; PAGE_SYMBOLS] {
    let mut symbols = [0; PAGE_SYMBOLS];
    for (part, sent) in bits.chunks(PART_BITS).zip(symbols.chunks_mut(PART_SYMBOLS)) {
        let coded = Encoder::new(SecondOutput::Inverted).encode(part);
        let (sync, data) = sent.split_at_mut(SYNC.len());
        sync.copy_from_slice(&SYNC);
        for (k, symbol) in data.iter_mut().enumerate() {
            *symbol = coded[interleaved(k)];
        }
    }
    symbols
}

/// Place among the coded symbols of the symbol that is sent in place `k`.
fn interleaved(k: usize) -> usize {
    k % COLUMNS * ROWS + k / COLUMNS
}

/// The bits of a page from soft symbols, each part in the polarity of its synchronisation pattern.
pub(super) fn page_bits(symbols: &[f32; PAGE_SYMBOLS]) -> InavPageBits {
    let mut bits = [false; 2 * PART_BITS];
    for (part, received) in bits.chunks_mut(PART_BITS).zip(symbols.chunks(PART_SYMBOLS)) {
        let (sync, data) = received.split_at(SYNC.len());
        let agreement: f32 = sync.iter().zip(SYNC).map(|(&s, p)| s * f32::from(p)).sum();
        let mut coded = [0.0; PART_SYMBOLS - SYNC.len()];
        for (k, &symbol) in data.iter().enumerate() {
            coded[interleaved(k)] = if agreement < 0.0 { -symbol } else { symbol };
        }
        let decoded = decode_block(&coded, SecondOutput::Inverted);
        part[..decoded.len()].copy_from_slice(&decoded);
    }
    bits
}
