//! CRC-24Q, the cyclic redundancy check of SBAS, Galileo, BeiDou B-CNAV, GPS CNAV and RTCM 3: generator
//! 0x1864CFB, register zero at the start, nothing inverted. Other catalogues name it CRC-24/LTE-A.

use crc::{CRC_24_LTE_A, Crc};

static CRC24Q: Crc<u32> = Crc::<u32>::new(&CRC_24_LTE_A);

/// The 24 parity bits of a block of bits. A block followed by its own parity has parity zero.
///
/// The register starts at zero, so zeros in front change nothing: blocks that are no whole number of
/// bytes are filled up there. Cost: a table look-up per byte, no allocation.
pub fn checksum(bits: &[bool]) -> u32 {
    let mut digest = CRC24Q.digest();
    let (front, bytes) = bits.split_at(bits.len() % 8);
    digest.update(&[byte(front)]);
    for chunk in bytes.chunks(8) {
        digest.update(&[byte(chunk)]);
    }
    digest.finalize()
}

fn byte(bits: &[bool]) -> u8 {
    bits.iter().fold(0, |value, &bit| value << 1 | u8::from(bit))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The check value of the published catalogue of CRCs (CRC-24/LTE-A of "123456789" is 0xCDE703).
    #[test]
    fn checksum_has_the_published_check_value_and_ignores_zeros_in_front() {
        let bits: Vec<bool> =
            b"123456789".iter().flat_map(|b| (0..8).rev().map(move |k| b >> k & 1 == 1)).collect();
        assert_eq!(checksum(&bits), 0xCD_E703);
        for zeros in 1..10 {
            assert_eq!(checksum(&[vec![false; zeros], bits.clone()].concat()), 0xCD_E703);
        }
        // The generator itself: one bit leaves the polynomial.
        assert_eq!(checksum(&[true]), 0x86_4CFB);
    }
}
