//! The message of SBAS L1 (RTCA DO-229 Appendix A; ICAO Annex 10 volume I, appendix B, 3.5): 250 bit/s, a
//! message of 250 bits every second.
//!
//! A message is a preamble of 8 bits (three in turn: 01010011, 10011010, 11000110), a type of 6 bits, 212
//! bits of data and CRC-24Q over the 226 bits before. The stream of bits is coded without tail at rate
//! 1/2 ([`super::convolutional`], G2 upright) and sent at 500 symbols/s. The first symbol that depends on the
//! first bit of a message leaves the satellite on a whole second of the SBAS network time.

mod decoder;
mod messages;
#[cfg(test)]
mod tests;

pub use decoder::SbasDecoder;
pub use messages::*;

pub use super::fields::OutOfRange;

use super::convolutional::{Encoder, SecondOutput};
use super::crc24q;

/// Bits of a message with preamble and parity.
pub const MESSAGE_BITS: usize = 250;
/// Symbols of a message; it lasts one second.
pub const MESSAGE_SYMBOLS: usize = 2 * MESSAGE_BITS;
/// Bits before the parity.
const CHECKED_BITS: usize = 226;
/// The preambles in their turn.
const PREAMBLES: [u8; 3] = [0b0101_0011, 0b1001_1010, 0b1100_0110];

/// The bits of a message as sent, from the preamble to the parity.
pub type MessageBits = [bool; MESSAGE_BITS];

/// The symbols of consecutive messages, +1 for logical 0 and -1 for logical 1, from an encoder in state 0.
pub fn encode(messages: &[MessageBits]) -> Vec<i8> {
    Encoder::new(SecondOutput::Upright).encode(&messages.concat())
}

/// Writes the parity of the bits before it.
fn seal(bits: &mut MessageBits) {
    let parity = crc24q::checksum(&bits[..CHECKED_BITS]);
    for (k, bit) in bits[CHECKED_BITS..].iter_mut().enumerate() {
        *bit = parity >> (23 - k) & 1 == 1;
    }
}

/// Which of the three preambles (0 to 2) the bits begin with.
fn preamble_of(bits: &MessageBits) -> Option<u8> {
    let first = bits[..8].iter().fold(0, |value, &bit| value << 1 | u8::from(bit));
    PREAMBLES.iter().position(|&p| p == first).map(|k| k as u8)
}
