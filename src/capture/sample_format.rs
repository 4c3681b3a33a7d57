//! The sample type of a recording, and its decoding to complex samples.

use super::number::Number;
use super::packing::{BitOrder, Encoding, Packing};
use num_complex::Complex32;

/// Names that [`SampleFormat::named`] knows, for messages.
pub const FORMAT_NAMES: &str =
    "cu8, cs8, cs16, cs32, cf32, cf64, ru8, rs8 (s8), rs16 (s16), rs32, rf32, rf64, b1, b2, rb2";

#[derive(Clone, Debug, PartialEq)]
enum Coding {
    Numbers { number: Number, big_endian: bool, real: bool, q_sign: f32 },
    Packed(Packing),
}

/// A sample type: how bytes become complex samples. Values are the integers that the file holds
/// (floating-point numbers as they are); nothing is normalised.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleFormat {
    name: String,
    coding: Coding,
}

impl SampleFormat {
    /// A format of [`FORMAT_NAMES`]; numbers little-endian. The bit order (most significant first if
    /// not given) and the encoding (two's complement if not given) apply to packed formats only.
    pub fn named(
        name: &str,
        bit_order: Option<BitOrder>,
        encoding: Option<Encoding>,
    ) -> Option<Self> {
        let order = bit_order.unwrap_or(BitOrder::MostFirst);
        let encoding = encoding.unwrap_or(Encoding::TwosComplement);
        let packed = match name {
            "b1" => Some(Packing::one_bit(order)),
            "b2" => Some(Packing::two_bit(order, encoding)),
            "rb2" => Some(Packing::two_bit_real(order, encoding)),
            _ => None,
        };
        if let Some(packing) = packed {
            return Some(Self::packed(name, packing));
        }
        let (real, number) = match name {
            "s8" | "s16" => (true, name),
            _ => (name.starts_with('r'), name.strip_prefix(['c', 'r'])?),
        };
        let number = match number {
            "u8" => Number::U8,
            "s8" | "i8" => Number::I8,
            "s16" | "i16" => Number::I16,
            "s32" | "i32" => Number::I32,
            "f32" => Number::F32,
            "f64" => Number::F64,
            _ => return None,
        };
        Some(Self::numbers(number, false, real))
    }

    /// Samples of whole numbers.
    pub fn numbers(number: Number, big_endian: bool, real: bool) -> Self {
        let prefix = if real { 'r' } else { 'c' };
        let suffix = if big_endian && number.bytes() > 1 { "_be" } else { "" };
        let name = format!("{prefix}{}{suffix}", number.name());
        Self { name, coding: Coding::Numbers { number, big_endian, real, q_sign: 1.0 } }
    }

    /// Packed samples, under a common name.
    pub fn packed(name: &str, packing: Packing) -> Self {
        Self { name: name.to_owned(), coding: Coding::Packed(packing) }
    }

    /// The same with mirrored spectrum: Q inverted. Real formats stay as they are.
    pub fn conjugated(self) -> Self {
        let coding = match self.coding {
            Coding::Numbers { number, big_endian, real, q_sign } => {
                Coding::Numbers { number, big_endian, real, q_sign: -q_sign }
            }
            Coding::Packed(packing) => Coding::Packed(packing.conjugated()),
        };
        Self { coding, ..self }
    }

    /// Name, such as `cs8`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether the samples have no imaginary part.
    pub fn is_real(&self) -> bool {
        match &self.coding {
            Coding::Numbers { real, .. } => *real,
            Coding::Packed(packing) => packing.is_real(),
        }
    }

    /// Bytes of the smallest run that holds whole samples.
    pub fn word_bytes(&self) -> usize {
        match &self.coding {
            Coding::Numbers { number, real, .. } => number.bytes() * if *real { 1 } else { 2 },
            Coding::Packed(packing) => packing.word_bytes(),
        }
    }

    /// Samples (of all channels together) in one word.
    pub fn samples_per_word(&self) -> usize {
        match &self.coding {
            Coding::Numbers { .. } => 1,
            Coding::Packed(packing) => packing.samples_per_word(),
        }
    }

    /// Decodes whole words into `out`, which must hold exactly their samples, and gives the count of
    /// numbers that were NaN or infinite: they become 0.
    pub fn decode(&self, bytes: &[u8], out: &mut [Complex32]) -> u64 {
        debug_assert_eq!(bytes.len() / self.word_bytes() * self.samples_per_word(), out.len());
        match &self.coding {
            Coding::Numbers { number, big_endian, real, q_sign } => {
                number.decode(*big_endian, *real, *q_sign, bytes, out)
            }
            Coding::Packed(packing) => {
                packing.decode(bytes, out);
                0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(name: &str, bytes: &[u8]) -> (Vec<Complex32>, u64) {
        let format = SampleFormat::named(name, None, None).unwrap();
        let mut out = vec![Complex32::ZERO; bytes.len() / format.word_bytes()];
        let bad = format.decode(bytes, &mut out);
        (out, bad)
    }

    #[test]
    fn numbers_decode_as_the_integers_they_are() {
        let c = Complex32::new;
        assert_eq!(decode("cu8", &[0, 255, 127, 128]).0, [c(-127.5, 127.5), c(-0.5, 0.5)]);
        assert_eq!(decode("cs8", &[0x80, 0x7f]).0, [c(-128.0, 127.0)]);
        assert_eq!(decode("cs16", &[1, 0, 0, 0x80]).0, [c(1.0, -32768.0)]);
        assert_eq!(decode("s16", &[0xff, 0xff, 2, 0]).0, [c(-1.0, 0.0), c(2.0, 0.0)]);
        assert_eq!(decode("rs8", &[0xff]).0, [c(-1.0, 0.0)]);
        let be24 = SampleFormat::numbers(Number::I24, true, true);
        let mut out = [Complex32::ZERO];
        be24.decode(&[0xff, 0xff, 0xfe], &mut out);
        assert_eq!(out, [c(-2.0, 0.0)]);
        let mirrored = SampleFormat::named("cs8", None, None).unwrap().conjugated();
        mirrored.decode(&[3, 1], &mut out);
        assert_eq!(out, [c(3.0, -1.0)]);
    }

    #[test]
    fn not_a_number_becomes_zero_and_is_counted() {
        let bytes: Vec<u8> =
            [1.5, f32::NAN, f32::INFINITY, -2.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let (out, bad) = decode("cf32", &bytes);
        assert_eq!(out, [Complex32::new(1.5, 0.0), Complex32::new(0.0, -2.0)]);
        assert_eq!(bad, 2);
    }
}
