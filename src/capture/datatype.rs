//! Samples as bytes of files and pipes.

use multiversion::multiversion;

/// 1.5 x 2^23: what is added to it (of magnitude below 2^22) is rounded to an integer, ties to even, whose
/// two's complement are the low bits of the sum.
const ROUNDER: f32 = 12_582_912.0;

/// Sample type to be written; real if the stream is real.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Datatype {
    /// 8-bit integers: values are rounded (ties to even), and clipped to -127..=127.
    I8,
    /// 16-bit integers, little-endian: rounded, and clipped to -32767..=32767.
    I16,
    /// IEEE 754 single precision, little-endian, unchanged.
    F32,
}

impl Datatype {
    /// Appends numbers (I or Q) to `bytes`; gives how many of them were clipped.
    pub fn encode(self, numbers: &[f32], bytes: &mut Vec<u8>) -> u64 {
        let size = match self {
            Self::I8 => 1,
            Self::I16 => 2,
            Self::F32 => 4,
        };
        let old = bytes.len();
        bytes.resize(old + size * numbers.len(), 0);
        let out = &mut bytes[old..];
        match self {
            Self::I8 => round::<1>(numbers, 127.0, out.as_chunks_mut().0),
            Self::I16 => round::<2>(numbers, 32_767.0, out.as_chunks_mut().0),
            Self::F32 => {
                let chunks = out.as_chunks_mut().0.iter_mut();
                chunks.zip(numbers).for_each(|(bytes, x)| *bytes = x.to_le_bytes());
                0
            }
        }
    }
}

/// Little-endian integers of `N` bytes within +-`limit`; gives how many numbers were beyond.
#[multiversion(targets("x86_64+avx2", "aarch64+neon"))]
fn round<const N: usize>(numbers: &[f32], limit: f32, out: &mut [[u8; N]]) -> u64 {
    let mut clipped = 0;
    for (bytes, &x) in out.iter_mut().zip(numbers) {
        clipped += u64::from(x.abs() >= limit + 0.5);
        let sum = x.max(-limit).min(limit) + ROUNDER;
        bytes.copy_from_slice(&sum.to_bits().to_le_bytes()[..N]);
    }
    clipped
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding, clipping and counting by the standard library, one number at a time.
    fn scalar(numbers: &[f32], limit: f32) -> (Vec<i16>, u64) {
        let rounded = numbers.iter().map(|x| x.round_ties_even());
        let levels = rounded.clone().map(|x| x.clamp(-limit, limit) as i16).collect();
        (levels, rounded.filter(|x| x.abs() > limit).count() as u64)
    }

    #[test]
    fn integers_equal_the_scalar_version_at_every_quarter_and_far_beyond() {
        let extremes = [f32::MAX, f32::MIN, f32::INFINITY, f32::NEG_INFINITY, -0.0, 1e-40];
        let numbers: Vec<f32> =
            (-140_000..140_000).map(|k| k as f32 / 4.0).chain(extremes).collect();
        let mut bytes = vec![9];
        let (levels, clipped) = scalar(&numbers, 127.0);
        assert_eq!(Datatype::I8.encode(&numbers, &mut bytes), clipped);
        assert!(bytes[1..].iter().map(|&b| i16::from(b as i8)).eq(levels));
        bytes.clear();
        let (levels, clipped) = scalar(&numbers, 32_767.0);
        assert_eq!(Datatype::I16.encode(&numbers, &mut bytes), clipped);
        assert!(bytes.as_chunks().0.iter().map(|&b| i16::from_le_bytes(b)).eq(levels));
    }
}
