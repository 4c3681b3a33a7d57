//! GLONASS L1OF (ICD L1, L2, edition 5.1): one code for all, and a carrier by frequency channel.

use super::{Carrier, Modulation, Overlay, Signal, Symbols};
use crate::Constellation;

const CHIPS: usize = 511;

/// Frequency channels of the slots 1 to 24 (plan of channels in use since 2016): slots opposite each other in a plane
/// share one.
const CHANNELS: [i8; 24] =
    [1, -4, 5, 6, 1, -4, 5, 6, -2, -7, 0, -1, -2, -7, 0, -1, 4, -3, 3, 2, 4, -3, 3, 2];

fn channel(number: u8) -> Option<i8> {
    CHANNELS.get(usize::from(number.checked_sub(1)?)).copied()
}

/// Output of stage 7 of a register of 9 stages, 1 + x^5 + x^9, that starts at all ones (3.3.2.1).
fn code() -> Box<[i8]> {
    let mut register = [1i8; 9];
    let step = |_| {
        let (output, feedback) = (register[6], register[4] ^ register[8]);
        register.rotate_right(1);
        register[0] = feedback;
        1 - 2 * output
    };
    (0..CHIPS).map(step).collect()
}

/// GLONASS L1OF: two symbols of 10 ms a bit. Its message is not decoded here.
pub static GLONASS_L1OF: Signal = Signal {
    name: "GLONASS L1OF",
    rinex: "1C",
    constellation: Constellation::Glonass,
    carrier: Carrier::Fdma { centre_hz: 1_602e6, step_hz: 562.5e3, channel },
    chip_rate_hz: 511e3,
    chips: CHIPS,
    code: |number| channel(number).map(|_| code()),
    modulation: Modulation::Bpsk,
    overlay: Overlay::None,
    symbols: |_| Some(Symbols { periods: 10, decoder: None }),
    partner: None,
    power_fraction: 1.0,
    phase_cycles: 0.0,
};

#[cfg(test)]
mod tests {
    use super::super::code_vectors::check_all;
    use super::*;

    #[test]
    fn the_code_equals_the_vector_of_others() {
        check_all("GLONASS_L1OF", |_| Some(code()), 0..=0);
    }

    /// Slots and channels in the header of a file of a mosaic-X5 of 2024.
    #[test]
    fn channels_are_those_that_a_receiver_reports() {
        for (slot, expected) in
            [(1, 1), (2, -4), (3, 5), (11, 0), (12, -1), (13, -2), (17, 4), (18, -3)]
        {
            assert_eq!(channel(slot), Some(expected));
        }
        assert_eq!((channel(0), channel(25)), (None, None));
        assert_eq!(GLONASS_L1OF.period_s(), 1e-3);
    }
}
