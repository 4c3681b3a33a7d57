//! Samples of a few bits each, packed into words.

use num_complex::Complex32;
use std::fmt;
use std::str::FromStr;

/// Value of a code of a few bits (names as in the ION GNSS SDR metadata standard).
///
/// The adjusted forms stand for the odd numbers 2x + 1, so that no code is zero and the levels lie
/// symmetrically: 2 bits give -3, -1, 1, 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// One bit: 0 is +1, 1 is -1.
    Sign,
    /// Two's complement (TC).
    TwosComplement,
    /// Two's complement, adjusted (TCA): codes 0..3 are 1, 3, -3, -1.
    TwosComplementAdjusted,
    /// Offset binary (OB): the code less half its range.
    OffsetBinary,
    /// Offset binary, adjusted (OBA): codes 0..3 are -3, -1, 1, 3.
    OffsetBinaryAdjusted,
    /// Sign and magnitude (SM), the most significant bit 1 for negative.
    SignMagnitude,
    /// Sign and magnitude, adjusted (SMA): codes 0..3 are 1, 3, -1, -3.
    SignMagnitudeAdjusted,
}

impl Encoding {
    /// The value of a code of `bits` bits (1 to 16).
    pub fn value(self, code: u32, bits: u32) -> f32 {
        let half = 1i32 << (bits - 1);
        let code = code as i32;
        let sign = if code & half == 0 { 1 } else { -1 };
        let twos_complement = if sign > 0 { code } else { code - 2 * half };
        let magnitude = code & (half - 1);
        let value = match self {
            Self::Sign => sign,
            Self::TwosComplement => twos_complement,
            Self::TwosComplementAdjusted => 2 * twos_complement + 1,
            Self::OffsetBinary => code - half,
            Self::OffsetBinaryAdjusted => 2 * (code - half) + 1,
            Self::SignMagnitude => sign * magnitude,
            Self::SignMagnitudeAdjusted => sign * (2 * magnitude + 1),
        };
        value as f32
    }
}

/// As it is parsed.
impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sign => "sign",
            Self::TwosComplement => "tc",
            Self::TwosComplementAdjusted => "tca",
            Self::OffsetBinary => "ob",
            Self::OffsetBinaryAdjusted => "oba",
            Self::SignMagnitude => "sm",
            Self::SignMagnitudeAdjusted => "sma",
        })
    }
}

/// `sign tc tca ob oba sm sma`, in either case.
impl FromStr for Encoding {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        Ok(match text.to_ascii_lowercase().as_str() {
            "sign" => Self::Sign,
            "tc" => Self::TwosComplement,
            "tca" => Self::TwosComplementAdjusted,
            "ob" => Self::OffsetBinary,
            "oba" => Self::OffsetBinaryAdjusted,
            "sm" => Self::SignMagnitude,
            "sma" => Self::SignMagnitudeAdjusted,
            _ => {
                return Err(format!(
                    "encoding '{text}' is unknown: write one of sign, tc, tca, ob, oba, sm, sma"
                ));
            }
        })
    }
}

/// Order of the samples in a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BitOrder {
    /// The first sample is in the most significant bits.
    MostFirst,
    /// The first sample is in the least significant bits.
    LeastFirst,
}

/// Position of a number in its word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Component {
    /// Position of its lowest bit, counted from the word's lowest.
    pub shift: u32,
    /// Whether the stored number has the wrong sign (`In`, `Qn` of the ION standard).
    pub inverted: bool,
}

/// Samples packed into words of up to 16 bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Packing {
    byte_order: Vec<usize>,
    bits: u32,
    encoding: Encoding,
    samples: Vec<(Component, Option<Component>)>,
    table: Vec<Complex32>,
}

impl Packing {
    /// A word of `byte_order.len()` bytes (1 to 16) that holds `samples` in the order of time (channels
    /// of one instant side by side), each an I and perhaps a Q of `bits` bits (1 to 16).
    ///
    /// `byte_order` lists the positions of the bytes in the file from the least significant up:
    /// `[0, 1]` is a little-endian word of 16 bits. `None` when a component lies outside of the word.
    pub fn new(
        byte_order: Vec<usize>,
        bits: u32,
        encoding: Encoding,
        samples: Vec<(Component, Option<Component>)>,
    ) -> Option<Self> {
        let word_bits = 8 * byte_order.len() as u32;
        let fits = |c: &Component| c.shift.checked_add(bits).is_some_and(|end| end <= word_bits);
        let is_valid = (1..=16).contains(&byte_order.len())
            && (1..=16).contains(&bits)
            && byte_order.iter().all(|&b| b < byte_order.len())
            && !samples.is_empty()
            && samples.iter().all(|(i, q)| fits(i) && q.as_ref().is_none_or(fits));
        let mut packing = Self { byte_order, bits, encoding, samples, table: Vec::new() };
        if !is_valid {
            return None;
        }
        packing.tabulate();
        Some(packing)
    }

    /// One bit each for I and Q, four samples a byte, I before Q in the order of the bits.
    pub fn one_bit(order: BitOrder) -> Self {
        let sample = |k: u32| match order {
            BitOrder::MostFirst => (at(7 - 2 * k), Some(at(6 - 2 * k))),
            BitOrder::LeastFirst => (at(2 * k), Some(at(2 * k + 1))),
        };
        Self::of_bytes(1, Encoding::Sign, (0..4).map(sample).collect())
    }

    /// Two bits each for I and Q, two samples a byte: nibbles whose bits are Q1 Q0 I1 I0.
    pub fn two_bit(order: BitOrder, encoding: Encoding) -> Self {
        let sample = |nibble: u32| (at(4 * nibble), Some(at(4 * nibble + 2)));
        let nibbles = match order {
            BitOrder::MostFirst => [1, 0],
            BitOrder::LeastFirst => [0, 1],
        };
        Self::of_bytes(2, encoding, nibbles.map(sample).to_vec())
    }

    /// Two bits for each real sample, four samples a byte.
    pub fn two_bit_real(order: BitOrder, encoding: Encoding) -> Self {
        let shifts = match order {
            BitOrder::MostFirst => [6, 4, 2, 0],
            BitOrder::LeastFirst => [0, 2, 4, 6],
        };
        Self::of_bytes(2, encoding, shifts.map(|s| (at(s), None)).to_vec())
    }

    fn of_bytes(
        bits: u32,
        encoding: Encoding,
        samples: Vec<(Component, Option<Component>)>,
    ) -> Self {
        let mut packing = Self { byte_order: vec![0], bits, encoding, samples, table: Vec::new() };
        packing.tabulate();
        packing
    }

    /// Bytes of one word.
    pub fn word_bytes(&self) -> usize {
        self.byte_order.len()
    }

    /// Samples (of all channels together) in one word.
    pub fn samples_per_word(&self) -> usize {
        self.samples.len()
    }

    /// Whether the samples have no Q.
    pub fn is_real(&self) -> bool {
        self.samples.iter().all(|(_, q)| q.is_none())
    }

    /// The mirrored spectrum: every Q inverted.
    pub fn conjugated(mut self) -> Self {
        for q in self.samples.iter_mut().filter_map(|(_, q)| q.as_mut()) {
            q.inverted = !q.inverted;
        }
        self.tabulate();
        self
    }

    /// Decodes whole words into `out`, which holds [`Packing::samples_per_word`] samples for each.
    pub(super) fn decode(&self, bytes: &[u8], out: &mut [Complex32]) {
        match self.samples.len() {
            _ if self.word_bytes() > 1 => {
                let words = bytes.chunks_exact(self.word_bytes());
                for (word, out) in words.zip(out.chunks_exact_mut(self.samples.len())) {
                    self.decode_word(self.word(word), out);
                }
            }
            1 => look_up::<1>(&self.table, bytes, out),
            2 => look_up::<2>(&self.table, bytes, out),
            4 => look_up::<4>(&self.table, bytes, out),
            8 => look_up::<8>(&self.table, bytes, out),
            n => {
                for (&byte, out) in bytes.iter().zip(out.chunks_exact_mut(n)) {
                    out.copy_from_slice(&self.table[usize::from(byte) * n..][..n]);
                }
            }
        }
    }

    /// Where a word is one byte: the samples of all 256 bytes.
    fn tabulate(&mut self) {
        if self.word_bytes() > 1 {
            return;
        }
        let n = self.samples.len();
        let mut table = vec![Complex32::ZERO; 256 * n];
        for (byte, out) in table.chunks_exact_mut(n).enumerate() {
            self.decode_word(byte as u128, out);
        }
        self.table = table;
    }

    fn word(&self, bytes: &[u8]) -> u128 {
        self.byte_order.iter().rev().fold(0, |word, &k| word << 8 | u128::from(bytes[k]))
    }

    fn decode_word(&self, word: u128, out: &mut [Complex32]) {
        let mask = (1u32 << self.bits) - 1;
        let number = |c: Component| {
            let value = self.encoding.value((word >> c.shift) as u32 & mask, self.bits);
            if c.inverted { -value } else { value }
        };
        for (sample, &(i, q)) in out.iter_mut().zip(&self.samples) {
            *sample = Complex32::new(number(i), q.map_or(0.0, number));
        }
    }
}

fn at(shift: u32) -> Component {
    Component { shift, inverted: false }
}

/// `N` samples a byte from a table of 256 entries.
fn look_up<const N: usize>(table: &[Complex32], bytes: &[u8], out: &mut [Complex32]) {
    let (entries, _) = table.as_chunks::<N>();
    let Ok(entries) = <&[[Complex32; N]; 256]>::try_from(entries) else { return };
    for (samples, &byte) in out.as_chunks_mut::<N>().0.iter_mut().zip(bytes) {
        *samples = entries[usize::from(byte)];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_encoding_gives_the_levels_of_the_standard() {
        let levels = |e: Encoding| [0, 1, 2, 3].map(|c| e.value(c, 2));
        assert_eq!(levels(Encoding::TwosComplement), [0.0, 1.0, -2.0, -1.0]);
        assert_eq!(levels(Encoding::TwosComplementAdjusted), [1.0, 3.0, -3.0, -1.0]);
        assert_eq!(levels(Encoding::OffsetBinary), [-2.0, -1.0, 0.0, 1.0]);
        assert_eq!(levels(Encoding::OffsetBinaryAdjusted), [-3.0, -1.0, 1.0, 3.0]);
        assert_eq!(levels(Encoding::SignMagnitude), [0.0, 1.0, 0.0, -1.0]);
        assert_eq!(levels(Encoding::SignMagnitudeAdjusted), [1.0, 3.0, -1.0, -3.0]);
        assert_eq!([0, 1].map(|c| Encoding::Sign.value(c, 1)), [1.0, -1.0]);
    }

    #[test]
    fn packed_bytes_decode_as_drawn() {
        let c = Complex32::new;
        let decode = |p: Packing, byte: u8| {
            let mut out = vec![Complex32::ZERO; p.samples_per_word()];
            p.decode(&[byte], &mut out);
            out
        };
        let (most, least) = (BitOrder::MostFirst, BitOrder::LeastFirst);
        // I Q I Q I Q I Q = 0 1 1 0 1 1 0 0 from the most significant bit.
        let b1 = vec![c(1., -1.), c(-1., 1.), c(-1., -1.), c(1., 1.)];
        assert_eq!(decode(Packing::one_bit(most), 0b0110_1100), b1);
        let reversed = 0b0110_1100u8.reverse_bits();
        assert_eq!(decode(Packing::one_bit(least), reversed), b1);
        // Nibble 1: Q = 01, I = 10; nibble 2: Q = 11, I = 00.
        let tc = Encoding::TwosComplement;
        let b2 = vec![c(-2., 1.), c(0., -1.)];
        assert_eq!(decode(Packing::two_bit(most, tc), 0b0110_1100), b2);
        assert_eq!(decode(Packing::two_bit(least, tc), 0b1100_0110), b2);
        assert_eq!(
            decode(Packing::two_bit(most, tc).conjugated(), 0b0110_1100),
            vec![c(-2., -1.), c(0., 1.)]
        );
        let tca = Encoding::TwosComplementAdjusted;
        let rb2 = vec![c(1., 0.), c(-1., 0.), c(-3., 0.), c(3., 0.)];
        assert_eq!(decode(Packing::two_bit_real(least, tca), 0b0110_1100), rb2);
    }

    #[test]
    fn a_word_of_two_bytes_decodes_as_the_same_bits_in_one_byte_words() {
        // Four samples of 2 + 2 bits over a big-endian word, most significant first.
        let sample = |k: u32| {
            let [i, q] = [14 - 4 * k, 12 - 4 * k];
            (at(i), Some(at(q)))
        };
        let tc = Encoding::TwosComplement;
        let wide = Packing::new(vec![1, 0], 2, tc, (0..4).map(sample).collect()).unwrap();
        let narrow = Packing::new(vec![0], 2, tc, (2..4).map(sample).collect()).unwrap();
        let bytes: Vec<u8> = (0..=255).collect();
        let mut a = vec![Complex32::ZERO; 512];
        let mut b = a.clone();
        wide.decode(&bytes, &mut a);
        narrow.decode(&bytes, &mut b);
        assert_eq!(a, b);
    }

    #[test]
    fn components_outside_of_the_word_are_refused() {
        let sign = Encoding::Sign;
        assert!(Packing::new(vec![0], 1, sign, vec![(at(8), None)]).is_none());
        assert!(Packing::new(vec![0], 1, sign, vec![(at(u32::MAX), None)]).is_none());
        assert!(Packing::new(vec![1], 1, sign, vec![(at(0), None)]).is_none());
        assert!(Packing::new(vec![], 1, sign, vec![(at(0), None)]).is_none());
        assert!(Packing::new(vec![0], 0, sign, vec![(at(0), None)]).is_none());
        assert!(Packing::new(vec![0], 1, sign, vec![]).is_none());
    }
}
