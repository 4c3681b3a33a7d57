//! The legacy navigation message (LNAV) of GPS and QZSS L1 C/A, bit by bit: encoder and decoder
//! (IS-GPS-200N 20.3).
//!
//! A subframe is ten words of 30 bits at 50 bit/s, so 6 s; five subframes are a frame. Bits are named as
//! there: D1 is sent first. In a `u32`, D1 of a 30-bit word is bit 29 and d1 of 24 source bits is bit 23.
//! Each message is a struct whose fields are described once, with word, first bit, length, scale and sign, for
//! encoder and decoder; values are in SI units and rad.
//!
//! Weeks are sent modulo 1024 (or 256); [`resolve_week`] picks the full week nearest a reference.

mod fields;
mod frame;
mod pages;
pub mod parity;
mod subframes;

pub use fields::DataWords;
pub use frame::{FrameDecoder, LooseWords, Subframe, WordsState};
pub use pages::{Almanac, Health1To24, Health25To32, IonosphereUtc, page_sv_id};
pub use subframes::{Subframe1, Subframe2, Subframe3, assemble};

use fields::{Fields, Walk};

/// The eight bits that start every subframe.
pub const PREAMBLE: u32 = 0x8B;
/// Bits in a subframe.
pub const SUBFRAME_BITS: usize = 300;
/// Data ID of the pages of subframes 4 and 5 that GPS sends of itself (IS-GPS-200N 20.3.3.5.1.1).
pub const DATA_ID_GPS: u8 = 1;
/// Data ID under which QZSS repeats pages of GPS; its own pages have 3 and are not read (IS-QZSS-PNT-005 4.1.2.6).
pub const DATA_ID_REPEATED: u8 = 0;
/// Seconds that a subframe takes.
pub const SUBFRAME_SECONDS: f64 = 6.0;
/// Number of subframes in a week: TOW counts run from 0 to one less.
pub const TOW_COUNTS: u32 = 100_800;
/// Week in which the program was built: no recording is of a later one.
const BUILD_WEEK: i32 = match i32::from_str_radix(env!("SDR_RX_BUILD_WEEK"), 10) {
    Ok(week) => week,
    Err(_) => panic!("the build script gives a week"),
};
/// Reference week without other information: weeks modulo 1024 then mean the latest that are not later than the build.
pub const DEFAULT_REFERENCE_WEEK: i32 = BUILD_WEEK - 511;

/// Why a message cannot be sent.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LnavError {
    /// A value does not fit its field.
    #[error(
        "encoding an LNAV subframe: {name} = {value:e} does not fit its field, which holds {min:e} to {max:e}"
    )]
    OutOfRange {
        /// The field as IS-GPS-200 names it.
        name: &'static str,
        /// The value, in the field's unit (semicircles for angles).
        value: f64,
        /// Minimum value.
        min: f64,
        /// Maximum value.
        max: f64,
    },
}

/// Telemetry and handover words, words 1 and 2 of every subframe (IS-GPS-200N 20.3.3.1, 20.3.3.2).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Header {
    /// Telemetry message (14 bits).
    pub telemetry: u16,
    /// Integrity status flag.
    pub integrity: bool,
    /// TOW count of the start of the NEXT subframe: units of 6 s, 0 to 100 799.
    pub tow_count: u32,
    /// Alert flag: the satellite may be worse than its URA.
    pub alert: bool,
    /// Whether anti-spoofing is on.
    pub anti_spoof: bool,
    /// Subframe number, 1 to 5.
    pub id: u8,
}

impl Fields for Header {
    fn walk(&mut self, w: &mut Walk) {
        w.count("preamble", &mut PREAMBLE.clone(), &[(1, 1, 8)]);
        w.count("TLM message", &mut self.telemetry, &[(1, 9, 14)]);
        w.flag(&mut self.integrity, &[(1, 23, 1)]);
        w.count("TOW count", &mut self.tow_count, &[(2, 1, 17)]);
        w.flag(&mut self.alert, &[(2, 18, 1)]);
        w.flag(&mut self.anti_spoof, &[(2, 19, 1)]);
        w.count("subframe number", &mut self.id, &[(2, 20, 3)]);
    }
}

impl Header {
    /// Header of subframe `id` (1 to 5) whose first bit is sent at time of week `tow` (s, a multiple
    /// of 6), no flag set.
    pub fn new(id: u8, tow: f64) -> Self {
        let tow_count = ((tow / SUBFRAME_SECONDS).round() as u32 + 1) % TOW_COUNTS;
        Self { id, tow_count, ..Self::default() }
    }

    /// Time of week of the subframe's own first bit, s.
    pub fn tow(&self) -> f64 {
        f64::from((self.tow_count + TOW_COUNTS - 1) % TOW_COUNTS) * SUBFRAME_SECONDS
    }

    /// Whether preamble, TOW count and subframe number of decoded words are possible.
    pub fn is_plausible(words: &DataWords) -> bool {
        let header = Self::read(words);
        words[0] >> 16 == PREAMBLE && header.tow_count < TOW_COUNTS && (1..=5).contains(&header.id)
    }
}

/// Contents of words 3 to 10 of a subframe.
#[derive(Clone, Debug, PartialEq)]
pub enum LnavMessage {
    /// Subframe 1: clock.
    Clock(Subframe1),
    /// Subframe 2: first half of the ephemeris.
    Orbit(Subframe2),
    /// Subframe 3: second half of the ephemeris.
    Orientation(Subframe3),
    /// Almanac of one satellite, in subframe 4 or 5.
    Almanac(Almanac),
    /// Subframe 4 page 18.
    IonosphereUtc(IonosphereUtc),
    /// Subframe 4 page 25.
    Health25To32(Health25To32),
    /// Subframe 5 page 25.
    Health1To24(Health1To24),
    /// A page of subframe 4 or 5 that is reserved or not decoded here, by its SV ID; sent as
    /// alternating ones and zeros.
    Other(u8),
}

impl LnavMessage {
    /// The message in decoded `words`.
    pub fn decode(words: &DataWords) -> Self {
        let sv_id = (words[2] >> 16 & 0x3F) as u8;
        let gps_page = matches!((words[2] >> 22 & 3) as u8, DATA_ID_GPS | DATA_ID_REPEATED);
        match Header::read(words).id {
            1 => Self::Clock(Subframe1::read(words)),
            2 => Self::Orbit(Subframe2::read(words)),
            3 => Self::Orientation(Subframe3::read(words)),
            4 | 5 if !gps_page => Self::Other(sv_id),
            4 | 5 if (1..=32).contains(&sv_id) => Self::Almanac(Almanac::read(words)),
            4 if sv_id == 56 => Self::IonosphereUtc(IonosphereUtc::read(words)),
            4 if sv_id == 63 => Self::Health25To32(Health25To32::read(words)),
            5 if sv_id == 51 => Self::Health1To24(Health1To24::read(words)),
            _ => Self::Other(sv_id),
        }
    }

    fn write(&self, data_id: u8) -> Result<DataWords, LnavError> {
        // Unused bits: alternating ones and zeros (IS-GPS-200N 20.3.3.5.1.1), with data ID and SV ID.
        let page = |sv_id: u8| {
            let mut words = [0xAA_AAAA; 10];
            words[2] = u32::from(data_id) << 22 | u32::from(sv_id) << 16 | 0xAAAA;
            words
        };
        match self {
            Self::Clock(m) => m.write([0xAA_AAAA; 10]),
            Self::Orbit(m) => m.write([0; 10]),
            Self::Orientation(m) => m.write([0; 10]),
            Self::Almanac(m) => m.write(page(m.sv_id)),
            Self::IonosphereUtc(m) => m.write(page(56)),
            Self::Health25To32(m) => m.write(page(63)),
            Self::Health1To24(m) => m.write(page(51)),
            Self::Other(sv_id) => Ok(page(*sv_id)),
        }
    }
}

/// The ten 30-bit words as sent (D1 = bit 29) of one subframe of GPS. Parity starts from D29* = D30* = 0,
/// which every subframe's last word guarantees for the next, and so does this one.
pub fn encode_subframe(header: &Header, message: &LnavMessage) -> Result<[u32; 10], LnavError> {
    encode_with_data_id(header, message, DATA_ID_GPS)
}

/// The same with another data ID on the pages of subframes 4 and 5, such as [`DATA_ID_REPEATED`].
pub fn encode_with_data_id(
    header: &Header,
    message: &LnavMessage,
    data_id: u8,
) -> Result<[u32; 10], LnavError> {
    let mut data = header.write(message.write(data_id)?)?;
    data[0] &= !1;
    let mut tail = 0;
    Ok(std::array::from_fn(|k| {
        if k == 1 || k == 9 {
            data[k] = parity::solve_tail_bits(data[k], tail);
        }
        let word = parity::encode_word(data[k], tail);
        tail = word & 3;
        word
    }))
}

/// Source bits of ten received words (D1 = bit 29) after a word that ended in `tail`, if every parity holds.
pub fn decode_words(words: &[u32; 10], mut tail: parity::Tail) -> Option<DataWords> {
    let mut data = [0; 10];
    for (word, source) in words.iter().zip(&mut data) {
        *source = parity::decode_word(*word, tail)?;
        tail = word & 3;
    }
    Some(data)
}

/// Header and message of decoded words.
pub fn decode_subframe(words: &DataWords) -> (Header, LnavMessage) {
    (Header::read(words), LnavMessage::decode(words))
}

/// The full week whose low `bits` bits are `week` and that is nearest `reference_week` (of two equally
/// near the earlier).
pub fn resolve_week(week: u32, bits: u32, reference_week: i32) -> i32 {
    let modulus = 1 << bits;
    let ahead = (week as i32 - reference_week).rem_euclid(modulus);
    reference_week + if ahead >= modulus / 2 { ahead - modulus } else { ahead }
}

#[cfg(test)]
mod tests;
