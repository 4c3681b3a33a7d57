//! One description of the fields of a message for both encoder and decoder.

use super::MessageBits;

/// A value that its field cannot hold.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("SBAS message: {name} is {value}, its field holds {min} to {max}")]
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
    pub bits: MessageBits,
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
    pub(super) fn reader(bits: &MessageBits, at: usize) -> Self {
        Self { bits: *bits, at, writing: false, error: None }
    }

    /// Writes over zeros from the bit `at` on.
    pub(super) fn writer(at: usize) -> Self {
        Self { bits: [false; super::MESSAGE_BITS], at, writing: true, error: None }
    }

    /// The bits, unless a value did not fit.
    pub(super) fn finish(self) -> Result<MessageBits, OutOfRange> {
        self.error.map_or(Ok(self.bits), Err)
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

    /// Unused bits: skipped, written as zeros.
    pub(super) fn spare(&mut self, width: usize) {
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
