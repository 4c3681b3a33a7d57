//! The words of I/NAV, and which type is which (Galileo OS SIS ICD 2.1, 4.3.5).

use super::almanac::{AlmanacWord7, AlmanacWord8, AlmanacWord9, AlmanacWord10};
use super::contents::{
    OtherWord, ParityWord, Word0, Word1, Word2, Word3, Word4, Word5, Word6, Word16,
};
use super::{WORD_BITS, WordBits};
use crate::message::fields::{Fields, OutOfRange, Walk};

/// A word of I/NAV: the 128 data bits of a nominal page.
#[derive(Clone, Debug, PartialEq)]
pub enum InavWord {
    /// Type 0: time alone.
    SpareTime(Word0),
    /// Type 1: first quarter of the ephemeris.
    Ephemeris1(Word1),
    /// Type 2: second quarter.
    Ephemeris2(Word2),
    /// Type 3: third quarter, with the accuracy.
    Ephemeris3(Word3),
    /// Type 4: fourth quarter, with the clock.
    Ephemeris4(Word4),
    /// Type 5: ionosphere, group delays, health and time.
    IonosphereHealth(Word5),
    /// Type 6: GST against UTC.
    Utc(Word6),
    /// Type 7: almanac of a first satellite, first half.
    Almanac7(AlmanacWord7),
    /// Type 8: its second half, and the first half of a second one.
    Almanac8(AlmanacWord8),
    /// Type 9: the second half of that, and the first half of a third one.
    Almanac9(AlmanacWord9),
    /// Type 10: the second half of that, and GST against GPS time.
    Almanac10(AlmanacWord10),
    /// Type 16: reduced ephemeris and clock.
    Reduced(Word16),
    /// Types 17 to 20: parity of the ephemeris (FEC2).
    Parity(ParityWord),
    /// Another type, such as the dummy word, 63.
    Other(OtherWord),
}

impl InavWord {
    /// The word of these bits.
    pub fn decode(bits: &WordBits) -> Self {
        let mut kind = 0;
        let mut w = Walk::reader(bits, 0);
        w.count("type", &mut kind, 6);
        match kind {
            0 => Self::SpareTime(w.read()),
            1 => Self::Ephemeris1(w.read()),
            2 => Self::Ephemeris2(w.read()),
            3 => Self::Ephemeris3(w.read()),
            4 => Self::Ephemeris4(w.read()),
            5 => Self::IonosphereHealth(w.read()),
            6 => Self::Utc(w.read()),
            7 => Self::Almanac7(w.read()),
            8 => Self::Almanac8(w.read()),
            9 => Self::Almanac9(w.read()),
            10 => Self::Almanac10(w.read()),
            16 => Self::Reduced(w.read()),
            17..=20 => Self::Parity(ParityWord { kind, ..w.read() }),
            _ => Self::Other(OtherWord { kind, ..w.read() }),
        }
    }

    /// The bits of the word. Spare fields hold alternating zeros and ones, as Galileo sends them.
    ///
    /// # Errors
    /// If a value does not fit its field.
    pub fn encode(&self) -> Result<WordBits, OutOfRange> {
        let mut w = Walk::writer(&[false; WORD_BITS]);
        w.count("type", &mut self.kind(), 6);
        match self.clone() {
            Self::SpareTime(mut word) => word.walk(&mut w),
            Self::Ephemeris1(mut word) => word.walk(&mut w),
            Self::Ephemeris2(mut word) => word.walk(&mut w),
            Self::Ephemeris3(mut word) => word.walk(&mut w),
            Self::Ephemeris4(mut word) => word.walk(&mut w),
            Self::IonosphereHealth(mut word) => word.walk(&mut w),
            Self::Utc(mut word) => word.walk(&mut w),
            Self::Almanac7(mut word) => word.walk(&mut w),
            Self::Almanac8(mut word) => word.walk(&mut w),
            Self::Almanac9(mut word) => word.walk(&mut w),
            Self::Almanac10(mut word) => word.walk(&mut w),
            Self::Reduced(mut word) => word.walk(&mut w),
            Self::Parity(mut word) => word.walk(&mut w),
            Self::Other(mut word) => word.walk(&mut w),
        }
        w.finish()
    }

    /// Its type, 0 to 63.
    pub fn kind(&self) -> u8 {
        match self {
            Self::SpareTime(_) => 0,
            Self::Ephemeris1(_) => 1,
            Self::Ephemeris2(_) => 2,
            Self::Ephemeris3(_) => 3,
            Self::Ephemeris4(_) => 4,
            Self::IonosphereHealth(_) => 5,
            Self::Utc(_) => 6,
            Self::Almanac7(_) => 7,
            Self::Almanac8(_) => 8,
            Self::Almanac9(_) => 9,
            Self::Almanac10(_) => 10,
            Self::Reduced(_) => 16,
            Self::Parity(word) => word.kind,
            Self::Other(word) => word.kind,
        }
    }

    /// GST of the start of the page that carries it, s of the week, where the word states it.
    pub fn tow_s(&self) -> Option<f64> {
        let tow = match self {
            Self::SpareTime(word) if word.time == 2 => word.tow,
            Self::IonosphereHealth(word) => word.tow,
            Self::Utc(word) => word.tow,
            _ => return None,
        };
        (tow < 604_800).then(|| tow.into())
    }

    /// Week of GST modulo 4096, where the word states it.
    pub fn week(&self) -> Option<u16> {
        match self {
            Self::SpareTime(word) if word.time == 2 => Some(word.week),
            Self::IonosphereHealth(word) => Some(word.week),
            _ => None,
        }
    }
}
