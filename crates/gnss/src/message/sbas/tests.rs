use super::*;
use crate::message::{Content, MessageDecoder, Page};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Messages that EGNOS sent, as printed in the documentation of three public projects, here in an order in
/// which the preambles take turns. Types 18 and 26: goGPS (`ems2igpmask.m`, `ems2idc.m`). Type 4: a
/// frame that a Septentrio mosaic-X5 received of PRN 136 and accepted (test data of pysbf2 1.0.7). The
/// others: README of jonatanmv/sisnet, SISNeT.
const RECEIVED: [(u8, &str); 15] = [
    (18, "534964000000FFFFFFC00000001FFFC00001FFFC00003FFFE001FC003C15ABC0"),
    (1, "9A07FF7FFFBC00000000000000000000008004000000000000000000E791BF40"),
    (9, "C62456193ED63F1B620D92C0C000000000000000000000000000000032433880"),
    (26, "536A53FDFFEF05C02DC16E0A7053829C14FFEFFF7FFBFFDFFEFFF7803BEF9280"),
    (17, "9A447B116C02847C000011022FC6C2C280000000000000000000010C8E2F9640"),
    (12, "C6300015A0000000304A084A241C49891D81040000000000000000001204D900"),
    (10, "5328002CC9C3C3BE78589903C0148CB00000000000000000000000003CA3EA80"),
    (7, "9A1CF3FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFC00000000000000000037565480"),
    (25, "C66409E0000000021312FB81C05FE61A8C0302800027077F204FB7F99D867540"),
    (3, "530DFFE4003FF3FFBFD4000008003FEC000000000001797979B997BBA31765C0"),
    (6, "9A189FBBB97B97BDD55795997B95BBBB97BBBBBBBBBBBBBBBBBBBBBB84B91080"),
    (4, "C612FFC4000003FFFFE8000000000000000000000003BBAD7B8000000DC52980"),
    (24, "5360000000003FFC000003BB97BB902D69FBFB7C801198BEDFF14FFFBE49F280"),
    (26, "9A6A43FDFFEFFF7FFBFFDE0AD06E83601B20E8074035C1AE0E707B803569CCC0"),
    (27, "C66C0040F48EC0A0A200000000000000000000000000000000000000109715C0"),
];

fn bits_of(hex: &str) -> MessageBits {
    let digits: Vec<u32> = hex.chars().map(|c| c.to_digit(16).unwrap()).collect();
    std::array::from_fn(|k| digits[k / 4] >> (3 - k % 4) & 1 == 1)
}

/// Contents of the first message received of a type.
fn received(kind: u8) -> SbasContent {
    let (_, hex) = RECEIVED.iter().find(|(k, _)| *k == kind).unwrap();
    SbasMessage::decode(&bits_of(hex)).unwrap().content
}

fn radius_and_longitude([x, y, z]: [f64; 3]) -> (f64, f64) {
    ((x * x + y * y + z * z).sqrt(), y.atan2(x).to_degrees())
}

#[test]
fn received_messages_keep_parity_and_every_bit_is_accounted_for() {
    for (k, (kind, hex)) in RECEIVED.iter().enumerate() {
        let bits = bits_of(hex);
        assert_eq!(crc24q::checksum(&bits), 0, "parity of type {kind}");
        let message = SbasMessage::decode(&bits).unwrap();
        assert_eq!((message.kind, usize::from(message.preamble)), (*kind, k % 3));
        assert_eq!(message.encode().unwrap(), bits, "type {kind}");
    }
}

/// PRN 123 was ASTRA 5B at 31.5 E, PRN 136 SES-5 at 5 E. The radius of a geostationary orbit is 42 164 km;
/// eccentricity and drift move a satellite by some 20 km. The almanac is rounded to 2.6 km.
#[test]
fn geostationary_satellites_are_where_they_were() {
    let SbasContent::GeoNavigation(navigation) = received(9) else { panic!() };
    let (radius, longitude) = radius_and_longitude(navigation.position_m);
    assert!((radius - 42.164e6).abs() < 20e3, "{radius}");
    assert!((longitude - 31.5).abs() < 0.1, "{longitude}");
    assert_eq!((navigation.t0_s, navigation.ura, navigation.position_m[2]), (68_752.0, 15, 0.0));
    assert_eq!(navigation.velocity_m_s, [0.0; 3], "a velocity of zero is sent");

    let SbasContent::GeoAlmanacs(almanacs) = received(17) else { panic!() };
    assert_eq!(almanacs.satellites.map(|s| s.prn), [123, 136, 0]);
    // Provider 1 is EGNOS; ranging is off, by the user range accuracy 15.
    assert_eq!(almanacs.satellites.map(|s| s.health), [17, 17, 0]);
    assert_eq!(almanacs.t0_s, 68_736.0, "64 s unit, within the minute of the other message");
    let [astra, ses, _] = almanacs.satellites.map(|s| s.position_m);
    assert!((0..3).all(|k| (astra[k] - navigation.position_m[k]).abs() <= 1_300.0));
    assert!((radius_and_longitude(ses).1 - 5.0).abs() < 0.1);
}

/// The mask has GPS 1 to 32 without 11 and 28, and the two satellites of the almanac; the 32 degradation
/// indicators of another message count the same.
#[test]
fn mask_and_satellite_corrections_agree_with_each_other() {
    let SbasContent::PrnMask(mask) = received(1) else { panic!() };
    let expected: Vec<u8> = (1..=32).filter(|n| ![11, 28].contains(n)).chain([123, 136]).collect();
    assert_eq!((mask.slots, mask.iodp), (expected, 3));
    let SbasContent::FastDegradation(degradation) = received(7) else { panic!() };
    assert_eq!((degradation.latency_s, degradation.iodp), (3, 3));
    assert!(
        degradation.indicators.iter().enumerate().all(|(k, &i)| i == if k < 32 { 15 } else { 0 })
    );

    let SbasContent::FastCorrections(fast) = received(3) else { panic!() };
    let ranges = [-0.875, 0.0, -0.5, -0.25, -1.375, 0.0, 0.25, 0.0, -0.625, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(fast.satellites.map(|s| s.range_m), ranges);
    assert_eq!(fast.satellites.map(|s| s.udrei), [5, 14, 5, 14, 5, 14, 6, 14, 6, 5, 14, 14, 14]);

    let SbasContent::LongTerm(halves) = received(25) else { panic!() };
    let corrections: Vec<_> = halves.iter().flat_map(|h| &h.corrections).collect();
    assert_eq!(corrections.iter().map(|c| c.satellite).collect::<Vec<_>>(), [1, 19, 13, 28]);
    assert_eq!(corrections[1].position_m, [-1.125, 0.875, 0.25]);
    assert_eq!((corrections[1].iode, corrections[1].clock_s), (18, -4.0 * 2f64.powi(-31)));
    assert!(corrections.iter().all(|c| c.rate.is_none()) && halves.iter().all(|h| h.iodp == 3));
}

/// The degradation parameters are those that a Septentrio mosaic-X5 decoded of PRN 136 (block
/// GEODegrFactors in the test data of pysbf2 1.0.7): EGNOS did not change them in between. The leap second
/// at the end of 2016 was on day 7 of week 1929 = 7 x 256 + 137 and made them 18.
#[test]
fn degradation_parameters_and_time_agree_with_independent_values() {
    let SbasContent::Degradation(p) = received(10) else { panic!() };
    let metres = [p.b_rrc_m, p.c_ltc_lsb_m, p.c_ltc_v0_m, p.c_geo_lsb_m, p.c_er_m, p.c_iono_step_m];
    for (value, expected) in metres.iter().zip([0.0, 0.358, 0.958, 0.177, 0.0, 0.657]) {
        assert!((value - expected).abs() < 1e-12);
    }
    assert!((p.c_ltc_v1_m_s - 0.0078).abs() < 1e-12 && (p.c_geo_v_m_s - 0.02).abs() < 1e-12);
    assert_eq!((p.i_ltc_v1_s, p.i_ltc_v0_s, p.i_geo_s, p.i_iono_s), (120, 120, 120, 300));
    assert_eq!(
        (p.c_iono_ramp_m_s, p.rss_udre, p.rss_iono, p.c_covariance),
        (0.0, false, false, 0.0)
    );

    let SbasContent::NetworkTime(time) = received(12) else { panic!() };
    assert_eq!((time.leap_s, time.leap_future_s), (18.0, 18.0));
    assert_eq!((time.week_lsf, time.day), (137, 7));
    assert_eq!((time.gps_week, time.week_t), (130, 130));
    // The reference time is the last multiple of 4096 s.
    assert_eq!((time.gps_tow_s, time.t0t_s), (74_672, 73_728.0));
    assert!(time.a0_s.abs() < 50e-9, "time scales of laboratories differ by nanoseconds");
}

#[test]
fn values_that_do_not_fit_are_refused() {
    let mut message = SbasMessage::decode(&bits_of(RECEIVED[2].1)).unwrap();
    let SbasContent::GeoNavigation(navigation) = &mut message.content else { panic!() };
    navigation.position_m[1] = 0.08 * 2f64.powi(29);
    let error = message.encode().unwrap_err();
    assert_eq!((error.name, error.min), ("position_m", -0.08 * 2f64.powi(29)));
}

/// The received messages twice over, and some bits more so that the last comes out of the decoder.
fn symbols() -> Vec<f32> {
    let once = RECEIVED.map(|(_, hex)| bits_of(hex));
    let sent = encode(&[&once[..], &once[..], &once[..1]].concat());
    sent[..30 * MESSAGE_SYMBOLS + 140].iter().map(|&s| f32::from(s)).collect()
}

/// Pages of symbols that are numbered from `start`.
fn decode(symbols: &[f32], start: u64) -> Vec<Page> {
    let mut decoder = SbasDecoder::new();
    symbols.iter().zip(start..).filter_map(|(&s, index)| decoder.push(s, index)).collect()
}

fn kind_of(page: &Page) -> u8 {
    let Content::Sbas(message) = &page.content else { panic!("a message of SBAS") };
    message.kind
}

/// Asserts that the pages are the messages `expected` of `symbols()`, with the first symbol of message n
/// at 500 n plus `shift`.
fn assert_pages(
    pages: &[Page],
    expected: impl Iterator<Item = usize>,
    shift: impl Fn(usize) -> i64,
) {
    let found: Vec<_> = pages.iter().map(|p| (kind_of(p), p.start_index as i64)).collect();
    let expected: Vec<_> =
        expected.map(|n| (RECEIVED[n % 15].0, (500 * n) as i64 + shift(n))).collect();
    assert_eq!(found, expected);
}

#[test]
fn all_whole_messages_are_found_wherever_the_symbols_start_and_whatever_the_polarity() {
    let all = symbols();
    for cut in [0, 1, 2, 3, 250, 497, 498, 499, 500, 501] {
        for sign in [1.0, -1.0] {
            let cut_off: Vec<f32> = all[cut..].iter().map(|s| s * sign).collect();
            let pages = decode(&cut_off, 1_000_000 + cut as u64);
            assert_pages(&pages, cut.div_ceil(500)..30, |_| 1_000_000);
            let tows: Vec<f64> = pages.iter().filter_map(|p| p.tow_s).collect();
            assert_eq!(tows, [74_672.0, 74_672.0], "of type 12 only");
        }
    }
}

/// At Eb/N0 = 5 dB (C/N0 = 29 dB-Hz) a decoded bit is wrong with probability below 5e-7 (union bound): 30
/// messages have none with probability above 99 %.
#[test]
fn messages_pass_noise() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let sigma = 10f64.powf(-5.0 / 20.0);
    let noisy: Vec<f32> = symbols()
        .iter()
        .map(|&s| {
            let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
            let noise = (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos();
            s + (sigma * noise) as f32
        })
        .collect();
    // The first begins with the stream, where no earlier symbols help.
    assert_pages(&decode(&noisy, 0), 0..30, |_| 0);
}

#[test]
fn slips_cost_the_message_they_fall_into_and_the_pairing_follows() {
    let mut slipped = symbols();
    // A half-cycle slip in message 4, a lost symbol in 9 and one too many in 20, without a jump of the index.
    slipped[4 * 500 + 210..].iter_mut().for_each(|s| *s = -*s);
    slipped.insert(20 * 500 + 77, 1.0);
    slipped.remove(9 * 500 + 123);
    let kept = (0..30).filter(|n| ![4, 9, 20].contains(n));
    assert_pages(&decode(&slipped, 0), kept, |n| if (10..20).contains(&n) { -1 } else { 0 });

    // A jump of the index starts the search again.
    let mut decoder = SbasDecoder::new();
    let indices = (0..3_100).chain(3_103..);
    let pages: Vec<Page> =
        symbols().iter().zip(indices).filter_map(|(&s, index)| decoder.push(s, index)).collect();
    // Of message 5 the last bits were still in the Viterbi decoder.
    assert_pages(&pages, (0..30).filter(|n| ![5, 6].contains(n)), |n| if n > 6 { 3 } else { 0 });
}

#[test]
fn noise_and_messages_without_a_second_in_step_give_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut noise = |count| (0..count).map(|_| rng.random_range(-1.0..1.0)).collect::<Vec<f32>>();
    assert_eq!(decode(&noise(1_000_000), 0), []);
    let message = |n: usize| symbols()[500 * n..500 * n + 500].to_vec();
    // One alone; two of the same preamble; two a symbol too far apart; two five messages apart.
    for gap in [None, Some((8, 0)), Some((9, 1)), Some((10, 4 * 500))] {
        let second = gap.map(|(n, apart)| [noise(apart), message(n)].concat()).unwrap_or_default();
        let stream = [noise(333), message(5), second, noise(777)].concat();
        assert_eq!(decode(&stream, 0), []);
    }
    // With three lost between them they are synchronous.
    let stream = [noise(333), message(5), noise(3 * 500), message(9), noise(777)].concat();
    assert_eq!(decode(&stream, 0).iter().map(|p| p.start_index).collect::<Vec<_>>(), [333, 2_333]);
}

proptest! {
    #[test]
    fn arbitrary_symbols_never_panic(symbols in prop::collection::vec(any::<f32>(), 0..1500), start: u64) {
        let mut decoder = SbasDecoder::new();
        for (k, symbol) in symbols.iter().enumerate() {
            decoder.push(*symbol, start.wrapping_add(k as u64));
        }
    }

    #[test]
    fn arbitrary_contents_are_written_as_they_were_read(
        kind in 0u8..64,
        data in prop::collection::vec(any::<bool>(), MESSAGE_BITS),
    ) {
        let mut bits: MessageBits = data.try_into().unwrap();
        let head = u16::from(PREAMBLES[1]) << 6 | u16::from(kind);
        bits[..14].iter_mut().enumerate().for_each(|(k, bit)| *bit = head >> (13 - k) & 1 == 1);
        let message = SbasMessage::decode(&bits).unwrap();
        prop_assert_eq!(message.kind, kind);
        let again = message.encode().unwrap();
        prop_assert_eq!(crc24q::checksum(&again), 0);
        prop_assert_eq!(SbasMessage::decode(&again), Some(message));
    }
}
