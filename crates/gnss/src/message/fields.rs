//! One description of the fields of a message for both encoder and decoder: of SBAS and Galileo, whose fields follow
//! each other without gaps.

use crate::constants::GPS_PI;

/// A value that its field cannot hold.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("navigation message: {name} is {value}, its field holds {min} to {max}")]
pub struct OutOfRange {
    /// The field.
    pub name: &'static str,
    /// The value, or the number of values of a list.
    pub value: f64,
    /// The smallest that the field holds.
    pub min: f64,
    /// The largest that the field holds.
    pub max: f64,
}

/// Goes from field to field of a message, most significant bit first, and carries values one way or the
/// other. The first value that does not fit is kept as the error, and zero is written for it.
pub(super) struct Walk {
    bits: Vec<bool>,
    at: usize,
    writing: bool,
    error: Option<OutOfRange>,
}

/// A struct whose fields lie in a message.
pub(super) trait Fields: Default {
    /// Names every field with its width and scale, in the order of the message.
    fn walk(&mut self, w: &mut Walk);
}

impl Walk {
    /// Reads from the bit `at` on.
    pub(super) fn reader(bits: &[bool], at: usize) -> Self {
        Self { bits: bits.to_vec(), at, writing: false, error: None }
    }

    /// Writes over a message of these bits, from its first bit on.
    pub(super) fn writer(bits: &[bool]) -> Self {
        Self { bits: bits.to_vec(), at: 0, writing: true, error: None }
    }

    /// The bits, unless a value did not fit.
    ///
    /// # Panics
    /// If the message has not `N` bits.
    pub(super) fn finish<const N: usize>(self) -> Result<[bool; N], OutOfRange> {
        let bits = self.bits.try_into().expect("the length of the message");
        self.error.map_or(Ok(bits), Err)
    }

    /// The struct that begins here.
    pub(super) fn read<T: Fields>(&mut self) -> T {
        let mut value = T::default();
        value.walk(self);
        value
    }

    fn get(&mut self, width: usize) -> u32 {
        let from = self.at;
        self.at += width;
        self.bits[from..self.at].iter().fold(0, |value, &bit| value << 1 | u32::from(bit))
    }

    fn put(&mut self, width: usize, value: u32) {
        for k in 0..width {
            self.bits[self.at + k] = value >> (width - 1 - k) & 1 == 1;
        }
        self.at += width;
    }

    /// Writes `count` if it lies in the range of the field, whose unit `lsb` only the error needs.
    fn put_checked(
        &mut self,
        name: &'static str,
        width: usize,
        count: f64,
        signed: bool,
        lsb: f64,
    ) {
        let size = 2f64.powi(width as i32);
        let (min, max) = if signed { (-size / 2.0, size / 2.0 - 1.0) } else { (0.0, size - 1.0) };
        let fits = (min..=max).contains(&count);
        if !fits {
            let (value, min, max) = (count * lsb, min * lsb, max * lsb);
            self.error.get_or_insert(OutOfRange { name, value, min, max });
        }
        self.put(width, if fits { count as i64 as u32 } else { 0 });
    }

    /// Unused bits: skipped, and left as they are.
    pub(super) fn spare(&mut self, width: usize) {
        self.at += width;
    }

    /// Unused bits: skipped, written as alternating zeros and ones.
    pub(super) fn alternating(&mut self, width: usize) {
        if self.writing {
            (0..width).for_each(|k| self.bits[self.at + k] = k % 2 == 1);
        }
        self.at += width;
    }

    /// One bit.
    pub(super) fn flag(&mut self, value: &mut bool) {
        if self.writing {
            self.put(1, u32::from(*value));
        } else {
            *value = self.get(1) == 1;
        }
    }

    /// An unsigned integer.
    pub(super) fn count<T>(&mut self, name: &'static str, value: &mut T, width: usize)
    where
        T: Copy + Into<u32> + TryFrom<u32>,
    {
        if self.writing {
            self.put_checked(name, width, f64::from((*value).into()), false, 1.0);
        } else if let Ok(read) = T::try_from(self.get(width)) {
            *value = read;
        }
    }

    /// A list of `length` unsigned integers of equal width.
    pub(super) fn list(
        &mut self,
        name: &'static str,
        list: &mut Vec<u8>,
        length: usize,
        width: usize,
    ) {
        if self.writing && list.len() != length {
            let (value, length) = (list.len() as f64, length as f64);
            self.error.get_or_insert(OutOfRange { name, value, min: length, max: length });
        }
        list.resize(length, 0);
        list.iter_mut().for_each(|value| self.count(name, value, width));
    }

    /// An unsigned real number of unit `lsb`.
    pub(super) fn unsigned(&mut self, name: &'static str, value: &mut f64, width: usize, lsb: f64) {
        if self.writing {
            self.put_checked(name, width, (*value / lsb).round(), false, lsb);
        } else {
            *value = f64::from(self.get(width)) * lsb;
        }
    }

    /// A real number of unit `lsb`, two's complement.
    pub(super) fn signed(&mut self, name: &'static str, value: &mut f64, width: usize, lsb: f64) {
        if self.writing {
            self.put_checked(name, width, (*value / lsb).round(), true, lsb);
        } else {
            let unused = 32 - width;
            *value = f64::from((self.get(width) << unused) as i32 >> unused) * lsb;
        }
    }

    /// A signed real number of unit `lsb` semicircles (or semicircles/s), kept in rad (rad/s).
    pub(super) fn semicircles(
        &mut self,
        name: &'static str,
        rad: &mut f64,
        width: usize,
        lsb: f64,
    ) {
        let mut value = *rad / GPS_PI;
        self.signed(name, &mut value, width, lsb);
        if !self.writing {
            *rad = value * GPS_PI;
        }
    }

    /// An angle, kept in rad, in a field as wide as the circle; any number of turns may be added to it.
    pub(super) fn angle(&mut self, name: &'static str, rad: &mut f64, width: usize) {
        let lsb = 2f64.powi(1 - width as i32);
        let size = 2f64.powi(width as i32);
        let mut turned = *rad;
        if self.writing {
            let count = (*rad / GPS_PI / lsb).round().rem_euclid(size);
            turned = (if count < size / 2.0 { count } else { count - size }) * lsb * GPS_PI;
        }
        self.semicircles(name, &mut turned, width, lsb);
        if !self.writing {
            *rad = turned;
        }
    }

    /// A mask of `length` bits as the ascending numbers, from 1, of those that are set.
    pub(super) fn mask(&mut self, name: &'static str, numbers: &mut Vec<u8>, length: u8) {
        if self.writing {
            if let Some(&wrong) = numbers.iter().find(|&&n| n == 0 || n > length) {
                let (value, max) = (f64::from(wrong), f64::from(length));
                self.error.get_or_insert(OutOfRange { name, value, min: 1.0, max });
            }
            (1..=length).for_each(|n| self.put(1, u32::from(numbers.contains(&n))));
        } else {
            *numbers = (1..=length).filter(|_| self.get(1) == 1).collect();
        }
    }
}
