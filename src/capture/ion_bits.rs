//! Where the samples of ION streams lie in their chunk.

use super::packing::{Component, Encoding};

/// Order of samples or streams in a word: `Left` of the standard shifts them out at the most significant
/// end, `Right` at the least significant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Most significant first (`Left`).
    #[default]
    MostFirst,
    /// Least significant first (`Right`).
    LeastFirst,
}

/// A stream: the samples of one band in a chunk.
#[derive(Clone, Debug, PartialEq)]
pub struct Stream {
    /// Its name.
    pub id: String,
    /// Samples for each chunk.
    pub ratefactor: usize,
    /// Bits of one number.
    pub bits: u32,
    /// Bits that the stream occupies in the chunk.
    pub packed_bits: u32,
    /// Whether unused bits are at the least significant end.
    pub left_aligned: bool,
    /// Order of the samples within the stream.
    pub order: Order,
    /// Value of a code.
    pub encoding: Encoding,
    /// The numbers of one sample in their order: whether it is Q, and whether it is inverted.
    pub numbers: Vec<(bool, bool)>,
    /// Radio frequency that the front end brings to `translated_hz`, Hz.
    pub center_hz: f64,
    /// Where `center_hz` lies in the samples, Hz.
    pub translated_hz: f64,
    /// Bandwidth, Hz.
    pub bandwidth_hz: f64,
    /// The samples' positions in the chunk, once known.
    pub samples: Vec<(Component, Option<Component>)>,
}

impl Default for Stream {
    fn default() -> Self {
        Self {
            id: String::new(),
            ratefactor: 1,
            bits: 1,
            packed_bits: 1,
            left_aligned: true,
            order: Order::MostFirst,
            encoding: Encoding::Sign,
            numbers: vec![(false, false)],
            center_hz: 0.0,
            translated_hz: 0.0,
            bandwidth_hz: 0.0,
            samples: Vec::new(),
        }
    }
}

impl Stream {
    /// `IF IFn IQ IQn InQ InQn QI QIn QnI QnIn`: n inverts the component before it.
    pub(super) fn set_format(&mut self, format: &str) -> Result<(), String> {
        let (i, q, i_inverted, q_inverted) =
            ((false, false), (true, false), (false, true), (true, true));
        self.numbers = match format {
            "IF" => vec![i],
            "IFn" => vec![i_inverted],
            "IQ" => vec![i, q],
            "IQn" => vec![i, q_inverted],
            "InQ" => vec![i_inverted, q],
            "InQn" => vec![i_inverted, q_inverted],
            "QI" => vec![q, i],
            "QIn" => vec![q, i_inverted],
            "QnI" => vec![q_inverted, i],
            "QnIn" => vec![q_inverted, i_inverted],
            _ => {
                return Err(format!(
                    "'{format}' is not supported: IF, IQ or QI with n for inverted"
                ));
            }
        };
        Ok(())
    }

    /// Places the samples in the stream's bits, of which the least significant is bit `low`.
    fn place(&mut self, low: u32) -> Result<(), String> {
        let count = self.numbers.len();
        let needed = (self.ratefactor * count) as u32 * self.bits;
        if needed > self.packed_bits {
            return Err(format!(
                "stream '{}' needs {needed} bits for its samples and has {} packedbits",
                self.id, self.packed_bits
            ));
        }
        let low = if self.left_aligned { low + self.packed_bits - needed } else { low };
        let shift = |number: usize| match self.order {
            Order::MostFirst => low + needed - (number as u32 + 1) * self.bits,
            Order::LeastFirst => low + number as u32 * self.bits,
        };
        let sample = |k: usize| {
            let find = |is_q: bool| {
                let at = self.numbers.iter().position(|n| n.0 == is_q)?;
                Some(Component { shift: shift(k * count + at), inverted: self.numbers[at].1 })
            };
            Some((find(false)?, find(true)))
        };
        let samples: Option<Vec<_>> = (0..self.ratefactor).map(sample).collect();
        self.samples = samples.ok_or("a sample without I")?;
        Ok(())
    }
}

/// Places streams one after the other into a chunk of `chunk_bits`, what is left over before or after.
pub(super) fn place_streams(
    streams: &mut [Stream],
    chunk_bits: u32,
    order: Order,
    padding_first: bool,
) -> Result<(), String> {
    let used: u32 = streams.iter().map(|s| s.packed_bits).sum();
    let padding = chunk_bits
        .checked_sub(used)
        .ok_or_else(|| format!("its streams take {used} bits, and the chunk has {chunk_bits}"))?;
    let mut before = if padding_first { padding } else { 0 };
    for stream in streams {
        let low = match order {
            Order::MostFirst => chunk_bits - before - stream.packed_bits,
            Order::LeastFirst => before,
        };
        before += stream.packed_bits;
        stream.place(low)?;
    }
    Ok(())
}

/// Positions of the bytes of a chunk from the least significant up.
pub(super) fn byte_order(word: usize, words: usize, big_endian: bool, order: Order) -> Vec<usize> {
    let bytes =
        |w: usize| (0..word).map(move |b| w * word + if big_endian { word - 1 - b } else { b });
    match order {
        Order::LeastFirst => (0..words).flat_map(bytes).collect(),
        Order::MostFirst => (0..words).rev().flat_map(bytes).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_ordered_by_endianness_and_word_shift() {
        assert_eq!(byte_order(2, 1, false, Order::MostFirst), [0, 1]);
        assert_eq!(byte_order(2, 1, true, Order::MostFirst), [1, 0]);
        assert_eq!(byte_order(2, 2, false, Order::MostFirst), [2, 3, 0, 1]);
        assert_eq!(byte_order(1, 3, false, Order::LeastFirst), [0, 1, 2]);
    }

    #[test]
    fn streams_lie_side_by_side_with_padding_and_alignment() {
        let stream =
            |packed_bits, order| Stream { packed_bits, bits: 2, order, ..Stream::default() };
        let shift = |s: &Stream| s.samples[0].0.shift;
        let mut streams = [stream(4, Order::MostFirst), stream(3, Order::LeastFirst)];
        place_streams(&mut streams, 8, Order::MostFirst, false).unwrap();
        assert_eq!([shift(&streams[0]), shift(&streams[1])], [6, 2]);
        place_streams(&mut streams, 8, Order::MostFirst, true).unwrap();
        assert_eq!([shift(&streams[0]), shift(&streams[1])], [5, 1]);
        streams[1].left_aligned = false;
        place_streams(&mut streams, 8, Order::LeastFirst, false).unwrap();
        assert_eq!([shift(&streams[0]), shift(&streams[1])], [2, 4]);
        assert!(place_streams(&mut streams, 6, Order::MostFirst, false).is_err());
    }

    #[test]
    fn q_before_i_and_inverted_components_are_distinguished() {
        let mut s = Stream { packed_bits: 4, bits: 2, ..Stream::default() };
        s.set_format("QnI").unwrap();
        s.place(0).unwrap();
        let q = Component { shift: 2, inverted: true };
        assert_eq!(s.samples, [(Component { shift: 0, inverted: false }, Some(q))]);
        assert!(s.set_format("QQ").is_err());
    }
}
