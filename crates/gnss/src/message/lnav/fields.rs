//! One description of the fields of a subframe for both encoder and decoder.

use super::LnavError;
use crate::constants::GPS_PI;

/// Position of a field: runs of (word 1..=10, first bit 1..=24, number of bits), most significant first.
pub(super) type Position<'a> = &'a [(usize, u32, u32)];

/// The 24 source bits (d1 = bit 23) of the ten words of a subframe.
pub type DataWords = [u32; 10];

/// Carries values between the fields of a struct and the bits of a subframe, one way or the other.
/// The first value that does not fit its field is kept as the error.
pub(super) struct Walk {
    pub words: DataWords,
    writing: bool,
    error: Option<LnavError>,
}

/// A struct whose fields lie in a subframe.
pub(super) trait Fields: Default + Clone {
    /// Names every field with its position and scale, in the order of the subframe.
    fn walk(&mut self, w: &mut Walk);

    /// Reads the struct from the source bits of a subframe.
    fn read(words: &DataWords) -> Self {
        let mut value = Self::default();
        value.walk(&mut Walk { words: *words, writing: false, error: None });
        value
    }

    /// Writes the struct over `words`; bits of no field stay as they are.
    fn write(&self, words: DataWords) -> Result<DataWords, LnavError> {
        let mut walk = Walk { words, writing: true, error: None };
        self.clone().walk(&mut walk);
        walk.error.map_or(Ok(walk.words), Err)
    }
}

impl Walk {
    fn get(&self, position: Position) -> u32 {
        position.iter().fold(0, |value, &(word, first, bits)| {
            let run = self.words[word - 1] >> (25 - first - bits) & ((1 << bits) - 1);
            (u64::from(value) << bits) as u32 | run
        })
    }

    fn put(&mut self, position: Position, mut value: u32) {
        for &(word, first, bits) in position.iter().rev() {
            let shift = 25 - first - bits;
            let mask = (1u32 << bits) - 1;
            self.words[word - 1] &= !(mask << shift);
            self.words[word - 1] |= (value & mask) << shift;
            value = (u64::from(value) >> bits) as u32;
        }
    }

    fn fail(&mut self, name: &'static str, value: f64, min: f64, max: f64) {
        self.error.get_or_insert(LnavError::OutOfRange { name, value, min, max });
    }

    /// An unsigned integer.
    pub fn count<T>(&mut self, name: &'static str, value: &mut T, position: Position)
    where
        T: Copy + Into<u32> + TryFrom<u32>,
    {
        if self.writing {
            let max = (1u64 << width(position)) - 1;
            match (*value).into() {
                v if u64::from(v) <= max => self.put(position, v),
                v => self.fail(name, v.into(), 0.0, max as f64),
            }
        } else if let Ok(v) = T::try_from(self.get(position)) {
            *value = v;
        }
    }

    /// One bit.
    pub fn flag(&mut self, value: &mut bool, position: Position) {
        if self.writing {
            self.put(position, u32::from(*value));
        } else {
            *value = self.get(position) != 0;
        }
    }

    /// A real number of unit 2^`exponent`, two's complement if `signed`.
    pub fn real(
        &mut self,
        name: &'static str,
        value: &mut f64,
        position: Position,
        exponent: i32,
        signed: bool,
    ) {
        let (lsb, bits) = (2f64.powi(exponent), width(position));
        let (min, max) = if signed {
            (-(1i64 << (bits - 1)), (1i64 << (bits - 1)) - 1)
        } else {
            (0, (1i64 << bits) - 1)
        };
        if self.writing {
            let count = (*value / lsb).round();
            if (min as f64..=max as f64).contains(&count) {
                self.put(position, count as i64 as u32);
            } else {
                self.fail(name, *value, min as f64 * lsb, max as f64 * lsb);
            }
        } else {
            let raw = i64::from(self.get(position));
            *value = (if raw > max { raw - (1i64 << bits) } else { raw }) as f64 * lsb;
        }
    }

    /// A signed real number of unit 2^`exponent` semicircles (or semicircles/s), kept in rad (rad/s).
    pub fn semicircles(
        &mut self,
        name: &'static str,
        rad: &mut f64,
        position: Position,
        exponent: i32,
    ) {
        let mut value = *rad / GPS_PI;
        self.real(name, &mut value, position, exponent, true);
        if !self.writing {
            *rad = value * GPS_PI;
        }
    }

    /// An angle of unit 2^`exponent` semicircles in a field as wide as the circle, kept in rad; any
    /// number of turns may be added to it.
    pub fn angle(&mut self, name: &'static str, rad: &mut f64, position: Position, exponent: i32) {
        if self.writing && rad.is_finite() {
            let count = (*rad / GPS_PI / 2f64.powi(exponent)).round();
            self.put(position, count.rem_euclid(2f64.powi(width(position) as i32)) as u64 as u32);
        } else {
            self.semicircles(name, rad, position, exponent);
        }
    }
}

fn width(position: Position) -> u32 {
    position.iter().map(|run| run.2).sum()
}
