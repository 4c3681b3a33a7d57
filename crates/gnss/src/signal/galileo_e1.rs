//! Galileo E1 open service: E1-B with the I/NAV message, and the pilot E1-C (Galileo OS SIS ICD 2.1, sections 2.3.3,
//! 3.4 and annex C).
//!
//! s(t) = (e_B (a sc_A + b sc_B) - e_C (a sc_A - b sc_B)) / sqrt 2, with a^2 = 10/11 and b^2 = 1/11: both components on
//! one phase, the pilot with a minus sign.
//!
//! The codes are memory codes without a generator: `galileo_e1b.bin` and `galileo_e1c.bin` hold 50 codes each, a code
//! in 512 bytes, its first chip the highest bit of the first byte, the last 4 bits zero.

use super::packed_code::unpack;
use super::{Carrier, L1_CENTRE_HZ, Modulation, Overlay, Signal, Symbols};
use crate::Constellation;
use crate::message::inav::InavDecoder;

const CHIPS: usize = 4092;
/// Bytes of a code.
const BYTES: usize = CHIPS.div_ceil(8);

static E1B_CODES: &[u8] = include_bytes!("galileo_e1b.bin");
static E1C_CODES: &[u8] = include_bytes!("galileo_e1c.bin");

/// Secondary code CS25_1 (3.4): its first chip begins at multiples of 100 ms of GST.
const CS25: [i8; 25] =
    [1, 1, -1, -1, -1, 1, 1, 1, 1, 1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, -1, 1, 1, -1, 1];

fn memory_code(codes: &[u8], number: u8) -> Option<Box<[i8]>> {
    let code = codes.chunks_exact(BYTES).nth(usize::from(number.checked_sub(1)?))?;
    Some(unpack(code, CHIPS))
}

/// Galileo E1-B, the data component: one symbol of I/NAV a code period.
pub static GALILEO_E1B: Signal = Signal {
    name: "Galileo E1-B",
    rinex: "1B",
    constellation: Constellation::Galileo,
    carrier: Carrier::Fixed(L1_CENTRE_HZ),
    chip_rate_hz: 1.023e6,
    chips: CHIPS,
    code: |number| memory_code(E1B_CODES, number),
    modulation: Modulation::Cboc { pilot: false },
    overlay: Overlay::None,
    symbols: |_| Some(Symbols { periods: 1, decoder: Some(|| Box::new(InavDecoder::new())) }),
    partner: Some(&GALILEO_E1C),
    power_fraction: 0.5,
    phase_cycles: 0.0,
};

/// Galileo E1-C, the pilot.
pub static GALILEO_E1C: Signal = Signal {
    name: "Galileo E1-C",
    rinex: "1C",
    constellation: Constellation::Galileo,
    carrier: Carrier::Fixed(L1_CENTRE_HZ),
    chip_rate_hz: 1.023e6,
    chips: CHIPS,
    code: |number| memory_code(E1C_CODES, number),
    modulation: Modulation::Cboc { pilot: true },
    overlay: Overlay::Shared(&CS25),
    symbols: |_| None,
    partner: Some(&GALILEO_E1B),
    power_fraction: 0.5,
    phase_cycles: 0.5,
};

#[cfg(test)]
mod tests {
    use super::super::code_vectors::{check_all, hexadecimal};
    use super::*;

    /// First chips of OS SIS ICD annex C (E1-B PRN 1 and 50, E1-C PRN 1) and of section 3.4.
    #[test]
    fn first_chips_and_secondary_code_are_those_of_the_interface_specification() {
        let first = |signal: &Signal, number| hexadecimal(&(signal.code)(number).unwrap()[..40]);
        assert_eq!(first(&GALILEO_E1B, 1), "F5D7101305");
        assert_eq!(first(&GALILEO_E1C, 1), "B39340CA1C");
        // 25 bits and three of padding.
        assert_eq!(hexadecimal(&[&CS25[..], &[1; 3]].concat()), "380AD90");
        assert_eq!((GALILEO_E1B.code)(51), None);
        assert_eq!((GALILEO_E1B.period_s(), GALILEO_E1C.period_s()), (4e-3, 4e-3));
    }

    #[test]
    fn all_codes_equal_the_vectors_of_others() {
        check_all("E1B", GALILEO_E1B.code, 1..=50);
        check_all("E1C", GALILEO_E1C.code, 1..=50);
    }

    #[test]
    fn data_and_pilot_are_reached_from_each_other() {
        let sv = "E11".parse().unwrap();
        let pilot = crate::signal::of(sv);
        let data = pilot.partner().unwrap();
        assert_eq!((data.signal, pilot.signal), (&GALILEO_E1B, &GALILEO_E1C));
        assert_eq!(data.partner(), Some(pilot));
        assert!(data.decoder().is_some() && pilot.decoder().is_some());
        assert!(pilot.is_pilot() && !data.is_pilot());
        assert_eq!((pilot.timing().cycle, data.timing().is_aligned), (4, true));
        assert_eq!((data.overlay(), pilot.overlay().unwrap().len()), (None, 25));
        assert_eq!(data.signal.power_fraction + pilot.signal.power_fraction, 1.0);
    }
}
