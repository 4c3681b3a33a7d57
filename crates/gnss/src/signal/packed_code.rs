//! Codes as bits.

/// Chips, +1 (logical 0) and -1 (logical 1), of the first `count` bits of `bytes`, the highest bit of each first.
pub(super) fn unpack(bytes: &[u8], count: usize) -> Box<[i8]> {
    let chips =
        bytes.iter().flat_map(|byte| (0..8).rev().map(move |k| 1 - 2 * (byte >> k & 1) as i8));
    chips.take(count).collect()
}
