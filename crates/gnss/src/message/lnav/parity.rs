//! Parity of a 30-bit LNAV word: the (32, 26) extended Hamming code of IS-GPS-200N 20.3.5.

/// Source bits d1..d24 (d1 = bit 23) that enter D25..D30, IS-GPS-200N table 20-XIV.
const MASKS: [u32; 6] = [
    source_bits(&[1, 2, 3, 5, 6, 10, 11, 12, 13, 14, 17, 18, 20, 23]),
    source_bits(&[2, 3, 4, 6, 7, 11, 12, 13, 14, 15, 18, 19, 21, 24]),
    source_bits(&[1, 3, 4, 5, 7, 8, 12, 13, 14, 15, 16, 19, 20, 22]),
    source_bits(&[2, 4, 5, 6, 8, 9, 13, 14, 15, 16, 17, 20, 21, 23]),
    source_bits(&[1, 3, 5, 6, 7, 9, 10, 14, 15, 16, 17, 18, 21, 22, 24]),
    source_bits(&[3, 5, 6, 8, 9, 10, 11, 13, 15, 19, 22, 23, 24]),
];

/// Whether D29* (true) or D30* (false) enters each of D25..D30.
const TAKES_D29: [bool; 6] = [true, false, true, false, false, true];

const fn source_bits(numbers: &[u32]) -> u32 {
    let (mut mask, mut k) = (0, 0);
    while k < numbers.len() {
        mask |= 1 << (24 - numbers[k]);
        k += 1;
    }
    mask
}

/// The last two bits D29*, D30* of the word before, as a number: 2 D29* + D30*.
pub type Tail = u32;

/// The six parity bits D25..D30 (D30 = bit 0) of 24 source bits (d1 = bit 23) after a word that ended
/// in `tail` (IS-GPS-200N table 20-XIV).
pub fn parity(data: u32, tail: Tail) -> u32 {
    let (d29, d30) = (tail >> 1 & 1, tail & 1);
    (0..6).fold(0, |bits, k| {
        let star = if TAKES_D29[k] { d29 } else { d30 };
        bits << 1 | (star ^ ((data & MASKS[k]).count_ones() & 1))
    })
}

/// The 30 bits sent (D1 = bit 29) for 24 source bits after a word that ended in `tail`: source bits
/// inverted where D30* = 1, then parity.
pub fn encode_word(data: u32, tail: Tail) -> u32 {
    let sent = if tail & 1 == 1 { !data } else { data } & 0xFF_FFFF;
    sent << 6 | parity(data, tail)
}

/// The 24 source bits of 30 received bits after a word that ended in `tail`, if parity holds.
pub fn decode_word(word: u32, tail: Tail) -> Option<u32> {
    let sent = word >> 6 & 0xFF_FFFF;
    let data = if tail & 1 == 1 { !sent & 0xFF_FFFF } else { sent };
    (parity(data, tail) == word & 0x3F).then_some(data)
}

/// `data` with its bits d23 and d24 chosen so that the word ends in D29 = D30 = 0, as words 2 and 10 of
/// every subframe do (IS-GPS-200N 20.3.3.2: the "t" bits).
pub fn solve_tail_bits(data: u32, tail: Tail) -> u32 {
    let data = data & 0xFF_FFFC;
    let open = parity(data, tail);
    let d24 = open >> 1 & 1;
    let d23 = (open & 1) ^ d24;
    data | d23 << 1 | d24
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The code's minimum distance is 4: over the 32 bits D29*, D30*, D1..D30 every error of one, two
    /// or three bits is seen. The code is linear, so the all-zero word stands for all.
    #[test]
    fn every_error_of_up_to_three_bits_in_word_and_tail_is_detected() {
        let accepts = |error: u64| decode_word(error as u32 & 0x3FFF_FFFF, (error >> 30) as u32);
        assert_eq!(accepts(0), Some(0));
        for a in 0..32 {
            for b in a..32 {
                for c in b..32 {
                    let error: u64 = 1 << a | 1 << b | 1 << c;
                    // D30* alone also inverts the data, which is part of the code.
                    assert_eq!(accepts(error), None, "bits {a} {b} {c}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn words_round_trip_and_are_blind_to_the_polarity_of_everything(data in 0u32..1 << 24, tail in 0u32..4) {
            let word = encode_word(data, tail);
            prop_assert_eq!(decode_word(word, tail), Some(data));
            // A receiver half a cycle off sees word and tail inverted: parity still holds and the
            // same data comes out, as D30* carries the polarity.
            prop_assert_eq!(decode_word(!word & 0x3FFF_FFFF, tail ^ 3), Some(data));
            let solved = solve_tail_bits(data, tail);
            prop_assert_eq!(solved >> 2, data >> 2);
            prop_assert_eq!(encode_word(solved, tail) & 3, 0);
        }
    }
}
