//! The message I/NAV of Galileo E1-B (Galileo OS SIS ICD 2.1, chapters 4 and 5): 125 bit/s, a page every 2 s.
//!
//! A page has an even and an odd part of one second each: a synchronisation pattern of 10 symbols, and 120 bits with a
//! tail of six zeros that are coded at rate 1/2 ([`super::convolutional`], G2 inverted) and interleaved. A *word* is the
//! 128 data bits of a page; CRC-24Q protects it. Pages of E1-B begin at odd seconds of Galileo System Time (GST), whose
//! week 0 is GPS week 1024, and which is kept within nanoseconds of GPS time. Fields are described once for encoder and
//! decoder.
//!
//! An ephemeris is words 1 to 4 of one issue of data (IODnav), or, since 2023, any four of them and of the words 17 to
//! 20, which hold parity of theirs. Word 5 has health, group delays and time, and follows
//! word 3 within 2 s.

mod almanac;
mod collector;
mod contents;
mod decoder;
mod ephemeris;
mod fec2;
mod page;
#[cfg(test)]
mod tests;
mod words;

pub use almanac::*;
pub(super) use collector::InavCollector;
pub use contents::*;
pub use decoder::InavDecoder;
pub use ephemeris::ephemeris_words;
pub use page::{InavPage, InavPageBits, page_symbols};
pub use words::InavWord;

pub use super::fields::OutOfRange;

use super::lnav::resolve_week;

/// Data bits of a nominal page.
pub const WORD_BITS: usize = 128;
/// The bits of a word.
pub type WordBits = [bool; WORD_BITS];
/// Symbols of a page; it lasts two seconds.
pub const PAGE_SYMBOLS: usize = 500;
/// The GPS week that is week 0 of GST.
const GPS_WEEK_OF_GST: i32 = 1024;

/// The GPS week nearest `reference_week` of a week of GST modulo 4096.
fn gps_week(week: u16, reference_week: i32) -> i32 {
    resolve_week((i32::from(week) + GPS_WEEK_OF_GST) as u32, 12, reference_week)
}
