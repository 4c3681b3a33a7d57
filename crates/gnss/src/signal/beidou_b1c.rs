//! BeiDou B1C (BDS-SIS-ICD-B1C-1.0): data component with B-CNAV1, and pilot, which is in quadrature to it.

use super::weil_code::weil_code;
use super::{Carrier, L1_CENTRE_HZ, Modulation, Overlay, Signal, Symbols};
use crate::Constellation;

const CHIPS: usize = 10_230;
const PRIME: usize = 10_243;
const OVERLAY_CHIPS: usize = 1800;
const OVERLAY_PRIME: usize = 3607;

/// Index of a Weil code and first chip, counted from 1.
type Weil = (u16, u16);

/// Data component of PRN 1 to 63 (table 5-2).
#[rustfmt::skip]
const DATA: [Weil; 63] = [
    (2678, 699), (4802, 694), (958, 7318), (859, 2127), (3843, 715), (2232, 6682), (124, 7850), (4352, 5495), (1816, 1162), (1126, 7682), (1860, 6792), (4800, 9973), (2267, 6596), (424, 2092), (4192, 19), (4333, 10151), (2656, 6297), (4148, 5766), (243, 2359), (1330, 7136), (1593, 1706), (1470, 2128), (882, 6827), (3202, 693), (5095, 9729), (2546, 1620), (1733, 6805), (4795, 534), (4577, 712), (1627, 1929), (3638, 5355), (2553, 6139), (3646, 6339), (1087, 1470), (1843, 6867), (216, 7851), (2245, 1162), (726, 7659), (1966, 1156), (670, 2672), (4130, 6043), (53, 2862), (4830, 180), (182, 2663), (2181, 6940), (2006, 1645), (1080, 1582), (2288, 951), (2027, 6878), (271, 7701), (915, 1823), (497, 2391), (139, 2606), (3693, 822), (2054, 6403), (4342, 239), (3342, 442), (2592, 6769), (1007, 2560), (310, 2502), (4203, 5072), (455, 7268), (4318, 341),
];
/// Pilot (table 5-3).
#[rustfmt::skip]
const PILOT: [Weil; 63] = [
    (796, 7575), (156, 2369), (4198, 5688), (3941, 539), (1374, 2270), (1338, 7306), (1833, 6457), (2521, 6254), (3175, 5644), (168, 7119), (2715, 1402), (4408, 5557), (3160, 5764), (2796, 1073), (459, 7001), (3594, 5910), (4813, 10060), (586, 2710), (1428, 1546), (2371, 6887), (2285, 1883), (3377, 5613), (4965, 5062), (3779, 1038), (4547, 10170), (1646, 6484), (1430, 1718), (607, 2535), (2118, 1158), (4709, 526), (1149, 7331), (3283, 5844), (2473, 6423), (1006, 6968), (3670, 1280), (1817, 1838), (771, 1989), (2173, 6468), (740, 2091), (1433, 1581), (2458, 1453), (3459, 6252), (2155, 7122), (1205, 7711), (413, 7216), (874, 2113), (2463, 1095), (1106, 1628), (1590, 1713), (3873, 6102), (4026, 6123), (4272, 6070), (3556, 1115), (128, 8047), (1200, 6795), (130, 2575), (4494, 53), (1871, 1729), (3073, 6388), (4386, 682), (4098, 5565), (1923, 7160), (1176, 2277),
];
/// Secondary code of the pilot (table 5-4).
#[rustfmt::skip]
const PILOT_OVERLAY: [Weil; 63] = [
    (269, 1889), (1448, 1268), (1028, 1593), (1324, 1186), (822, 1239), (5, 1930), (155, 176), (458, 1696), (310, 26), (959, 1344), (1238, 1271), (1180, 1182), (1288, 1381), (334, 1604), (885, 1333), (1362, 1185), (181, 31), (1648, 704), (838, 1190), (313, 1646), (750, 1385), (225, 113), (1477, 860), (309, 1656), (108, 1921), (1457, 1173), (149, 1928), (322, 57), (271, 150), (576, 1214), (1103, 1148), (450, 1458), (399, 1519), (241, 1635), (1045, 1257), (164, 1687), (513, 1382), (687, 1514), (422, 1), (303, 1583), (324, 1806), (495, 1664), (725, 1338), (780, 1111), (367, 1706), (882, 1543), (631, 1813), (37, 228), (647, 2871), (1043, 2884), (24, 1823), (120, 75), (134, 11), (136, 63), (158, 1937), (214, 22), (335, 1768), (340, 1526), (661, 1402), (889, 1445), (929, 1680), (1002, 1290), (1149, 1245),
];

fn code(table: &[Weil; 63], number: u8, prime: usize, chips: usize) -> Option<Box<[i8]>> {
    let (index, first) = *table.get(usize::from(number.checked_sub(1)?))?;
    Some(weil_code(prime, index.into(), usize::from(first) - 1, chips).into())
}

/// BeiDou B1C, the data component: a symbol a code period. Its message is not decoded here.
pub static BEIDOU_B1C_DATA: Signal = Signal {
    name: "BeiDou B1C data",
    rinex: "1D",
    constellation: Constellation::BeiDou,
    carrier: Carrier::Fixed(L1_CENTRE_HZ),
    chip_rate_hz: 1.023e6,
    chips: CHIPS,
    code: |number| code(&DATA, number, PRIME, CHIPS),
    modulation: Modulation::Boc { ratio: 1 },
    overlay: Overlay::None,
    symbols: |_| Some(Symbols { periods: 1, decoder: None }),
    partner: Some(&BEIDOU_B1C_PILOT),
    power_fraction: 0.25,
    phase_cycles: 0.0,
};

/// BeiDou B1C, the pilot.
pub static BEIDOU_B1C_PILOT: Signal = Signal {
    name: "BeiDou B1C pilot",
    rinex: "1P",
    constellation: Constellation::BeiDou,
    carrier: Carrier::Fixed(L1_CENTRE_HZ),
    chip_rate_hz: 1.023e6,
    chips: CHIPS,
    code: |number| code(&PILOT, number, PRIME, CHIPS),
    modulation: Modulation::Qmboc,
    overlay: Overlay::PerSatellite(|number| {
        code(&PILOT_OVERLAY, number, OVERLAY_PRIME, OVERLAY_CHIPS)
    }),
    symbols: |_| None,
    partner: Some(&BEIDOU_B1C_DATA),
    power_fraction: 0.75,
    phase_cycles: 0.25,
};

#[cfg(test)]
mod tests {
    use super::super::code_vectors::check_all;
    use super::*;

    #[test]
    fn all_codes_equal_the_vectors_of_others() {
        check_all("B1C_data", BEIDOU_B1C_DATA.code, 1..=63);
        check_all("B1C_pilot", BEIDOU_B1C_PILOT.code, 1..=63);
        check_all("B1C_pilot_secondary", |n| BEIDOU_B1C_PILOT.overlay.chips(n), 1..=63);
    }

    #[test]
    fn periods_are_those_of_the_interface_specification() {
        assert_eq!((BEIDOU_B1C_DATA.period_s(), BEIDOU_B1C_PILOT.period_s()), (10e-3, 10e-3));
        assert_eq!((BEIDOU_B1C_DATA.code)(64), None);
    }
}
