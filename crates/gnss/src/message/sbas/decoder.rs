//! From the symbols of one SBAS satellite to messages.
//!
//! The pairing of symbols to bits, their polarity and the start of a message are unknown.
//! Two Viterbi decoders run on the two pairings of the symbols. After each bit that one of them gives, its
//! last 250 bits are a *candidate* if, in one polarity or the other, they begin with one of the three
//! preambles and keep parity. A candidate is released as a message when it is *synchronous* with another
//! of the same pairing: 1 to 4 messages after it to the symbol, with the next preamble in turn. The first of
//! a series waits for its second and is released with it, so none is lost.
//!
//! **False alarms.** Random bits are a candidate with probability 2 x 3 x 2^-8 x 2^-24 = 1.4e-9, which at
//! 2 x 250 windows a second would be one in 17 days for each channel that tracks noise. Synchronous with
//! it must be one at 4 positions of probability 2 x 2^-8 x 2^-24: 1.4e-9 x 1.9e-9 x 500/s = 1.3e-15/s, once in
//! 24 million years. Right after true messages end, noise passes with probability 1.9e-9.
//!
//! **No state of lock.** Pairing, polarity and position are those of the last candidate of each pairing, and
//! each message must be synchronous with one: after the loss of a symbol the other pairing takes over with its
//! second message, a half-cycle slip costs the message that it falls into, and a candidate
//! by chance costs at most the first message of a series.
//!
//! A message is given [`Viterbi::DELAY`] bits (0.256 s) after its last symbol, the first of
//! a series with its second: that one comes with the next symbol.

use super::{MESSAGE_BITS, MESSAGE_SYMBOLS, MessageBits, SbasMessage, preamble_of};
use crate::message::convolutional::{SecondOutput, Viterbi};
use crate::message::{Content, MessageDecoder, Page, crc24q};
use std::collections::VecDeque;

/// A candidate is synchronous up to so many messages after the last one: three may be lost in between.
const MAX_STEP: u64 = 4;

/// Finds messages in the symbols of one satellite. Cost: one step of a Viterbi decoder a symbol; the parity
/// is computed only where a preamble stands.
#[derive(Clone, Debug)]
pub struct SbasDecoder {
    last_index: Option<u64>,
    pairings: [Pairing; 2],
    ready: VecDeque<Page>,
}

impl SbasDecoder {
    /// A decoder without symbols.
    pub fn new() -> Self {
        Self {
            last_index: None,
            pairings: [Pairing::new(), Pairing::new()],
            ready: VecDeque::new(),
        }
    }
}

impl Default for SbasDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl MessageDecoder for SbasDecoder {
    fn push(&mut self, symbol: f32, index: u64) -> Option<Page> {
        let follows = self.last_index.and_then(|last| last.checked_add(1)) == Some(index);
        if !follows {
            self.pairings = [Pairing::new(), Pairing::new()];
        }
        self.last_index = Some(index);
        let [first, second] = &mut self.pairings;
        first.push(symbol, index, &mut self.ready);
        // The second pairing lags by one symbol.
        if follows {
            second.push(symbol, index, &mut self.ready);
        }
        self.ready.pop_front()
    }
}

/// 250 bits with preamble and parity.
#[derive(Clone, Debug)]
struct Candidate {
    start_index: u64,
    preamble: u8,
    bits: MessageBits,
    released: bool,
}

impl Candidate {
    fn is_in_step_with(&self, before: &Self) -> bool {
        let symbols = self.start_index - before.start_index;
        let messages = symbols / MESSAGE_SYMBOLS as u64;
        symbols.is_multiple_of(MESSAGE_SYMBOLS as u64)
            && (1..=MAX_STEP).contains(&messages)
            && (u64::from(before.preamble) + messages) % 3 == u64::from(self.preamble)
    }

    fn release(&mut self, ready: &mut VecDeque<Page>) {
        if let (false, Some(message)) = (self.released, SbasMessage::decode(&self.bits)) {
            let (start_index, tow_s) = (self.start_index, message.tow_s());
            ready.push_back(Page { start_index, tow_s, content: Content::Sbas(Box::new(message)) });
        }
        self.released = true;
    }
}

/// One way to pair the symbols: its decoder, its last bits and its last candidate.
#[derive(Clone, Debug)]
struct Pairing {
    viterbi: Viterbi,
    /// The first symbol of a bit, until the second comes.
    waiting: Option<f32>,
    window: MessageBits,
    /// Bits in the window, up to 250.
    received: usize,
    last: Option<Candidate>,
}

impl Pairing {
    fn new() -> Self {
        Self {
            viterbi: Viterbi::new(SecondOutput::Upright),
            waiting: None,
            window: [false; MESSAGE_BITS],
            received: 0,
            last: None,
        }
    }

    fn push(&mut self, symbol: f32, index: u64, ready: &mut VecDeque<Page>) {
        let Some(first) = self.waiting.take() else {
            self.waiting = Some(symbol);
            return;
        };
        let Some(bit) = self.viterbi.push([first, symbol]) else { return };
        self.window.copy_within(1.., 0);
        self.window[MESSAGE_BITS - 1] = bit;
        self.received = (self.received + 1).min(MESSAGE_BITS);
        if self.received < MESSAGE_BITS {
            return;
        }
        // From the second symbol of the newest bit back to the first of the oldest in the window.
        let start_index = index - (2 * (Viterbi::DELAY + MESSAGE_BITS) - 1) as u64;
        let Some(mut found) = self.candidate(start_index) else { return };
        if let Some(before) = self.last.as_mut().filter(|before| found.is_in_step_with(before)) {
            before.release(ready);
            found.release(ready);
        }
        self.last = Some(found);
    }

    /// The window as a candidate, in whichever polarity it is one.
    fn candidate(&self, start_index: u64) -> Option<Candidate> {
        [false, true].into_iter().find_map(|inverted| {
            let bits = self.window.map(|bit| bit != inverted);
            let preamble = preamble_of(&bits)?;
            let kept = crc24q::checksum(&bits) == 0;
            kept.then_some(Candidate { start_index, preamble, bits, released: false })
        })
    }
}
