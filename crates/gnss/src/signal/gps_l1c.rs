//! GPS L1C (IS-GPS-800G): data component L1C-D with CNAV-2, and pilot L1C-P. GPS III and later send it.

use super::weil_code::weil_code;
use super::{Carrier, L1_CENTRE_HZ, Modulation, Overlay, Signal, Symbols};
use crate::Constellation;

const CHIPS: usize = 10_230;
const PRIME: usize = 10_223;
/// Chips that are inserted into the Weil code, 0110100 (3.2.2.1.1).
const INSERTED: [i8; 7] = [1, -1, -1, 1, -1, 1, 1];
const OVERLAY_CHIPS: usize = 1800;
const OVERLAY_STAGES: u16 = 11;

/// Weil index, and the place, counted from 1, before which the chips are inserted.
type Weil = (u16, u16);

/// L1C-P of PRN 1 to 63 (table 3.2-2).
#[rustfmt::skip]
const PILOT: [Weil; 63] = [
    (5111, 412), (5109, 161), (5108, 1), (5106, 303), (5103, 207), (5101, 4971), (5100, 4496), (5098, 5), (5095, 4557), (5094, 485), (5093, 253), (5091, 4676), (5090, 1), (5081, 66), (5080, 4485), (5069, 282), (5068, 193), (5054, 5211), (5044, 729), (5027, 4848), (5026, 982), (5014, 5955), (5004, 9805), (4980, 670), (4915, 464), (4909, 29), (4893, 429), (4885, 394), (4832, 616), (4824, 9457), (4591, 4429), (3706, 4771), (5092, 365), (4986, 9705), (4965, 9489), (4920, 4193), (4917, 9947), (4858, 824), (4847, 864), (4790, 347), (4770, 677), (4318, 6544), (4126, 6312), (3961, 9804), (3790, 278), (4911, 9461), (4881, 444), (4827, 4839), (4795, 4144), (4789, 9875), (4725, 197), (4675, 1156), (4539, 4674), (4535, 10035), (4458, 4504), (4197, 5), (4096, 9937), (3484, 430), (3481, 5), (3393, 355), (3175, 909), (2360, 1622), (1852, 6284),
];
/// L1C-D.
#[rustfmt::skip]
const DATA: [Weil; 63] = [
    (5097, 181), (5110, 359), (5079, 72), (4403, 1110), (4121, 1480), (5043, 5034), (5042, 4622), (5104, 1), (4940, 4547), (5035, 826), (4372, 6284), (5064, 4195), (5084, 368), (5048, 1), (4950, 4796), (5019, 523), (5076, 151), (3736, 713), (4993, 9850), (5060, 5734), (5061, 34), (5096, 6142), (4983, 190), (4783, 644), (4991, 467), (4815, 5384), (4443, 801), (4769, 594), (4879, 4450), (4894, 9437), (4985, 4307), (5056, 5906), (4921, 378), (5036, 9448), (4812, 9432), (4838, 5849), (4855, 5547), (4904, 9546), (4753, 9132), (4483, 403), (4942, 3766), (4813, 3), (4957, 684), (4618, 9711), (4669, 333), (4969, 6124), (5031, 10216), (5038, 4251), (4740, 9893), (4073, 9884), (4843, 4627), (4979, 4449), (4867, 9798), (4964, 985), (5025, 4272), (4579, 126), (4390, 10024), (4763, 434), (4612, 1029), (4784, 561), (3716, 289), (4703, 638), (4851, 4353),
];
/// Coefficients of the polynomial and first chips of the secondary code L1C-O (table 3.2-3).
#[rustfmt::skip]
const PILOT_OVERLAY: [(u16, u16); 63] = [
    (0o5111, 0o3266), (0o5421, 0o2040), (0o5501, 0o1527), (0o5403, 0o3307), (0o6417, 0o3756), (0o6141, 0o3026), (0o6351, 0o562), (0o6501, 0o420), (0o6205, 0o3415), (0o6235, 0o337), (0o7751, 0o265), (0o6623, 0o1230), (0o6733, 0o2204), (0o7627, 0o1440), (0o5667, 0o2412), (0o5051, 0o3516), (0o7665, 0o2761), (0o6325, 0o3750), (0o4365, 0o2701), (0o4745, 0o1206), (0o7633, 0o1544), (0o6747, 0o1774), (0o4475, 0o546), (0o4225, 0o2213), (0o7063, 0o3707), (0o4423, 0o2051), (0o6651, 0o3650), (0o4161, 0o1777), (0o7237, 0o3203), (0o4473, 0o1762), (0o5477, 0o2100), (0o6163, 0o571), (0o7223, 0o3710), (0o6323, 0o3535), (0o7125, 0o3110), (0o7035, 0o1426), (0o4341, 0o255), (0o4353, 0o321), (0o4107, 0o3124), (0o5735, 0o572), (0o6741, 0o1736), (0o7071, 0o3306), (0o4563, 0o1307), (0o5755, 0o3763), (0o6127, 0o1604), (0o4671, 0o1021), (0o4511, 0o2624), (0o4533, 0o406), (0o5357, 0o114), (0o5607, 0o77), (0o6673, 0o3477), (0o6153, 0o1000), (0o7565, 0o3460), (0o7107, 0o2607), (0o6211, 0o2057), (0o4321, 0o3467), (0o7201, 0o706), (0o4451, 0o2032), (0o5411, 0o1464), (0o5141, 0o520), (0o7041, 0o1766), (0o6637, 0o3270), (0o4577, 0o341),
];

fn code(table: &[Weil; 63], number: u8) -> Option<Box<[i8]>> {
    let (index, place) = *table.get(usize::from(number.checked_sub(1)?))?;
    let mut chips = weil_code(PRIME, index.into(), 0, PRIME);
    let place = usize::from(place) - 1;
    chips.splice(place..place, INSERTED);
    Some(chips.into())
}

/// The secondary code: a register of 11 stages, whose first output is the highest bit of its first state.
fn overlay(number: u8) -> Option<Box<[i8]>> {
    let (polynomial, mut state) = *PILOT_OVERLAY.get(usize::from(number.checked_sub(1)?))?;
    // The lowest coefficient is the output of the register itself.
    let taps = polynomial >> 1;
    let step = |_| {
        let chip = 1 - 2 * (state >> (OVERLAY_STAGES - 1) & 1) as i8;
        let feedback = (state & taps).count_ones() as u16 & 1;
        state = (state << 1 | feedback) & ((1 << OVERLAY_STAGES) - 1);
        chip
    };
    Some((0..OVERLAY_CHIPS).map(step).collect())
}

/// GPS L1C-D, the data component: a symbol a code period. Its message is not decoded here.
pub static GPS_L1C_D: Signal = Signal {
    name: "GPS L1C-D",
    rinex: "1S",
    constellation: Constellation::Gps,
    carrier: Carrier::Fixed(L1_CENTRE_HZ),
    chip_rate_hz: 1.023e6,
    chips: CHIPS,
    code: |number| code(&DATA, number),
    modulation: Modulation::Boc { ratio: 1 },
    overlay: Overlay::None,
    symbols: |_| Some(Symbols { periods: 1, decoder: None }),
    partner: Some(&GPS_L1C_P),
    power_fraction: 0.25,
    phase_cycles: 0.0,
};

/// GPS L1C-P, the pilot, on the phase of the data component.
pub static GPS_L1C_P: Signal = Signal {
    name: "GPS L1C-P",
    rinex: "1L",
    constellation: Constellation::Gps,
    carrier: Carrier::Fixed(L1_CENTRE_HZ),
    chip_rate_hz: 1.023e6,
    chips: CHIPS,
    code: |number| code(&PILOT, number),
    modulation: Modulation::Tmboc,
    overlay: Overlay::PerSatellite(overlay),
    symbols: |_| None,
    partner: Some(&GPS_L1C_D),
    power_fraction: 0.75,
    phase_cycles: 0.0,
};

#[cfg(test)]
mod tests {
    use super::super::code_vectors::check_all;
    use super::*;

    #[test]
    fn all_codes_equal_the_vectors_of_others() {
        check_all("GPS_L1C_D", GPS_L1C_D.code, 1..=63);
        check_all("GPS_L1C_P", GPS_L1C_P.code, 1..=63);
        check_all("GPS_L1C_overlay", |n| GPS_L1C_P.overlay.chips(n), 1..=63);
    }
}
