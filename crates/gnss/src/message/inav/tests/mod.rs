//! Pages that satellites sent, read by other implementations.

mod made;

use super::*;
use crate::constants::SPEED_OF_LIGHT;
use crate::galileo_data::GalileoHealth;
use crate::message::{Content, NavigationCollector, Update};
use crate::navigation_data::UtcParameters;
use crate::{Constellation, Ephemeris, GpsTime, Sv};
use std::collections::BTreeMap;

/// First page of E05 of 2022-02-20, GST week 1174, second 28801: its bits, and its 500 symbols by the encoder of
/// another implementation.
const E05_BITS: &str = "020BBF1CA9A889BE6BE4AC050598C0BA53548B8E8FC22AAAAA5D1A90BF40";
const E05_SYMBOLS: &str = "\
    580a49660bde68d738f876766d2e2b84116069f7bdff37cd626eaadd596494960d5a3f\
    03162402cef5c605c6a0f3d540382f51b182403c91ca00275f27d9c";

/// A page as recorded: week and second of GST at its start, satellite, bits.
struct Recorded {
    week: u16,
    tow: u32,
    sv: Sv,
    bits: InavPageBits,
}

/// Real pages (`SDR_RX_DATA`, `signals/messages/`).
fn recorded(name: &str) -> Vec<Recorded> {
    let Some(text) = shared(name) else { return Vec::new() };
    let page = |line: &str| {
        let mut words = line.split_whitespace();
        let mut next = || words.next().unwrap();
        let (week, tow) = (next().parse().unwrap(), next().parse().unwrap());
        let sv = Sv::new(Constellation::Galileo, next().parse().unwrap()).unwrap();
        Recorded { week, tow, sv, bits: bits_of(next()) }
    };
    text.lines().filter(|line| !line.starts_with('#')).map(page).collect()
}

fn shared(name: &str) -> Option<String> {
    let Some(folder) = std::env::var_os("SDR_RX_DATA") else {
        println!("SDR_RX_DATA is not set: real pages are passed over");
        return None;
    };
    Some(
        std::fs::read_to_string(std::path::Path::new(&folder).join("signals/messages").join(name))
            .unwrap(),
    )
}

fn bits_of<const N: usize>(hexadecimal: &str) -> [bool; N] {
    let digits: Vec<u32> = hexadecimal.chars().map(|c| c.to_digit(16).unwrap()).collect();
    assert_eq!(4 * digits.len(), N);
    std::array::from_fn(|k| digits[k / 4] >> (3 - k % 4) & 1 == 1)
}

const FILES: [&str; 2] = ["inav_pages_20220220.txt", "inav_pages_20231007.txt"];

#[test]
fn a_real_page_has_the_symbols_of_another_encoder() {
    let bits = bits_of(E05_BITS);
    let page = InavPage::decode(&bits).unwrap();
    assert_eq!(page.encode(), Ok(bits));
    let expected = bits_of::<PAGE_SYMBOLS>(E05_SYMBOLS).map(|bit| if bit { -1 } else { 1 });
    assert_eq!(page_symbols(&bits), expected);
    let Some(InavWord::Ephemeris2(word)) = page.word else { panic!("word 2") };
    // Values of the other implementation.
    let expected = Word2 {
        iod_nav: 46,
        omega0: -0.08718275215157066,
        i0: 0.956598647361933,
        omega: -1.9615695485252558,
        idot: -5.189501877869111e-10,
    };
    assert_close(
        &[word.omega0, word.i0, word.omega],
        &[expected.omega0, expected.i0, expected.omega],
    );
    assert_close(&[word.idot, 46.0], &[expected.idot, word.iod_nav.into()]);
}

/// Of a parameter that another implementation multiplied by pi, to the last bits of both.
fn assert_close(ours: &[f64], theirs: &[f64]) {
    for (ours, theirs) in ours.iter().zip(theirs) {
        assert!((ours - theirs).abs() <= 1e-13 * theirs.abs(), "{ours:e} {theirs:e}");
    }
}

/// Names and values of a word as the other implementation has them.
fn fields(word: &InavWord) -> Vec<(&'static str, f64)> {
    match word.clone() {
        InavWord::SpareTime(w) => vec![("time", w.time.into()), ("wn", w.week.into())],
        InavWord::Ephemeris1(w) => vec![
            ("iod", w.iod_nav.into()),
            ("toe", w.toe),
            ("M0", w.m0),
            ("e", w.e),
            ("sqrtA", w.sqrt_a),
        ],
        InavWord::Ephemeris2(w) => vec![
            ("iod", w.iod_nav.into()),
            ("Om0", w.omega0),
            ("i0", w.i0),
            ("w", w.omega),
            ("idot", w.idot),
        ],
        InavWord::Ephemeris3(w) => vec![
            ("iod", w.iod_nav.into()),
            ("Omd", w.omega_dot),
            ("dn", w.delta_n),
            ("cuc", w.cuc),
            ("cus", w.cus),
            ("crc", w.crc),
            ("crs", w.crs),
            ("sisa", w.sisa.into()),
        ],
        InavWord::Ephemeris4(w) => vec![
            ("iod", w.iod_nav.into()),
            ("svid", w.sv_id.into()),
            ("cic", w.cic),
            ("cis", w.cis),
            ("toc", w.toc),
            ("af0", w.af0),
            ("af1", w.af1),
            ("af2", w.af2),
        ],
        InavWord::IonosphereHealth(w) => vec![
            ("ai0", w.ai[0]),
            ("ai1", w.ai[1]),
            ("ai2", w.ai[2]),
            ("sf", w.storm_flags.into()),
            ("bgd_a", w.bgd_e1_e5a),
            ("bgd_b", w.bgd_e1_e5b),
            ("e5b_hs", w.health.e5b_status.into()),
            ("e1b_hs", w.health.e1b_status.into()),
            ("e5b_dvs", u8::from(w.health.e5b_not_valid).into()),
            ("e1b_dvs", u8::from(w.health.e1b_not_valid).into()),
            ("wn", w.week.into()),
        ],
        InavWord::Utc(w) => vec![
            ("A0", w.a0),
            ("A1", w.a1),
            ("dtls", w.delta_t_ls),
            ("t0t", w.t0t),
            ("wn0t", w.week_0t.into()),
            ("wnlsf", w.week_lsf.into()),
            ("dn", w.day.into()),
            ("dtlsf", w.delta_t_lsf),
        ],
        InavWord::Almanac10(w) => vec![
            ("ggA0", w.gps_offset.a0g),
            ("ggA1", w.gps_offset.a1g),
            ("ggt0", w.gps_offset.t0g),
            ("ggwn", w.gps_offset.week_0g.into()),
        ],
        _ => Vec::new(),
    }
}

/// Each field but the time of week equals that of the first word of its type that the other implementation decoded of
/// the satellite. In the recorded minute nothing changes but that a new issue of data may begin.
#[test]
fn real_pages_give_what_another_implementation_reads() {
    let Some(expected) = shared("inav_expected.json") else { return };
    let expected: serde_json::Value = serde_json::from_str(&expected).unwrap();
    let pages = recorded(FILES[0]);
    assert_eq!(pages.len(), 217);
    let mut compared = 0;
    for Recorded { sv, bits, .. } in &pages {
        let word = InavPage::decode(bits).unwrap().word.unwrap();
        let theirs = &expected["decoded"][sv.number().to_string()][format!("W{}", word.kind())];
        assert_eq!(theirs["type"], word.kind(), "{sv}");
        if fields(&word).first().is_some_and(|&(name, iod)| name == "iod" && theirs["iod"] != iod) {
            continue;
        }
        for (name, ours) in fields(&word) {
            assert_close(&[ours], &[theirs[name].as_f64().unwrap()]);
            compared += 1;
        }
    }
    assert!(compared > 700, "{compared}");
}

/// Of the dummy words of E20 in 2022 the whole contents are kept.
#[test]
fn real_pages_are_encoded_to_their_bits_and_tell_their_time() {
    for Recorded { week, tow, sv, bits } in FILES.iter().flat_map(|name| recorded(name)) {
        let page = InavPage::decode(&bits).unwrap();
        assert_eq!(page.encode(), Ok(bits), "{sv} {tow}");
        let word = page.word.unwrap();
        assert!(word.tow_s().is_none_or(|stated| stated == f64::from(tow)), "{sv} {tow}");
        assert!(word.week().is_none_or(|stated| stated == week));
        // Since 2023 the secondary synchronisation pattern tells the second modulo 6 (OS SIS ICD 2.1, 5.1.9.5).
        if week > 1200 {
            let pattern = [0b0000_0100, 0b0010_1011, 0b0010_1111][(tow as usize % 6 - 1) / 2];
            assert_eq!(page.ssp, pattern);
        }
    }
}

/// Bounds of OS SIS ICD 2.1, 5.1.12, and 107, 3.12 m, which all satellites send.
#[test]
fn accuracies_of_indices_are_those_of_the_interface_specification() {
    let table = [(0, 0.0), (49, 0.49), (50, 0.5), (74, 0.98), (75, 1.0), (99, 1.96), (100, 2.0)];
    for (index, metres) in table.into_iter().chain([(107, 3.12), (125, 6.0)]) {
        assert!((sisa_m(index).unwrap() - metres).abs() < 1e-12, "{index}");
    }
    assert!([126, 254, 255].into_iter().all(|index| sisa_m(index).is_none()));
}

/// A collector that was given all pages of a file, and what it said of them.
fn collected(name: &str) -> Option<(NavigationCollector, Vec<Update>)> {
    let (mut collector, mut updates) = (NavigationCollector::default(), Vec::new());
    let pages = recorded(name);
    for Recorded { sv, bits, .. } in &pages {
        let content = Content::Inav(Box::new(InavPage::decode(bits).unwrap()));
        updates.extend(collector.add(*sv, &content));
    }
    (!pages.is_empty()).then_some((collector, updates))
}

fn galileo(number: u8) -> Sv {
    Sv::new(Constellation::Galileo, number).unwrap()
}

#[test]
fn real_pages_give_ephemerides_time_and_models() {
    let Some((collector, updates)) = collected(FILES[0]) else { return };
    let data = collector.data();
    let satellites: Vec<u8> = data.satellites().map(Sv::number).collect();
    // E20 sends dummy words.
    assert_eq!(satellites, [1, 5, 13, 24, 31, 33]);
    let ephemerides = updates.iter().filter(|u| matches!(u, Update::Ephemeris(_))).count();
    assert_eq!((ephemerides, data.iter().count()), (6, 6));
    // Week 1174 of GST is week 2198 of GPS time.
    let now = GpsTime::from_calendar(2022, 2, 20, 8, 0, 30.0);
    assert_eq!(now.week(), 1174 + 1024);
    let e05 = data.ephemeris(galileo(5), now).unwrap();
    assert_eq!((e05.toe, e05.iodc, e05.health), (now - 30.0 - 1200.0, 46, 0));
    assert_eq!(e05.toe.tow(), 27_600.0);
    assert_close(&[e05.tgd, e05.af0], &[4.190951585769653e-9, -0.0002073374344035983]);
    assert!(data.orbit(galileo(5), now).is_ok());
    let status = data.galileo.status[&galileo(5)];
    assert_close(&[status.sisa_m.unwrap(), status.bgd_e1_e5a], &[3.12, 3.725290298461914e-9]);
    assert_eq!(data.galileo.nequick.unwrap().ai, [81.25, -0.24609375, 0.003753662109375]);
    // Some nanoseconds, at 0 h of Sunday of that week (22 modulo 64).
    let offset = data.galileo.gps_offset.unwrap();
    assert_eq!(offset.t0, GpsTime::from_week_tow(2198, 0.0));
    assert_close(&[offset.at(offset.t0)], &[6.05359673500061e-9]);
    // The leap second at the end of 2016, and the same of GPS.
    let utc = data.galileo.utc.unwrap();
    let UtcParameters { delta_t_ls, delta_t_lsf, wn_lsf, day, tot, .. } = utc;
    assert_eq!((delta_t_ls, delta_t_lsf, wn_lsf % 256, day), (18, 18, 1929 % 256, 7));
    assert_eq!(tot, GpsTime::from_week_tow(2198, 0.0));
    assert_eq!((data.utc, data.ionosphere), (None, None), "those of GPS are not touched");
}

/// The semi-major axis of a reduced ephemeris has steps of 256 m, its angles of 22 m each, eccentricity and inclination
/// of less: together the position is off by up to 170 m. Its clock makes good the radius, so that ranges are good to
/// metres: radius less clock, as seen from the ground.
#[test]
fn reduced_ephemerides_give_ranges_as_the_ephemerides_do() {
    let Some((collector, _)) = collected(FILES[1]) else { return };
    let mut compared = 0;
    for Recorded { week, tow, sv, bits } in recorded(FILES[1]) {
        let Some(InavWord::Reduced(word)) = InavPage::decode(&bits).unwrap().word else { continue };
        let sent = GpsTime::from_week_tow(i32::from(week) + 1024, tow.into());
        let (ours, full) = (word.ephemeris(sv, sent), collector.data().nearest(sv, sent).unwrap());
        for after in [0.0, 60.0, 300.0] {
            let (ours, full) = (ours.state(sent + after), full.state(sent + after));
            let error_m = (ours.position_m - full.position_m).norm();
            let clock_m = SPEED_OF_LIGHT * (ours.clock_bias_s - full.clock_bias_s);
            let range_m = ours.position_m.norm() - full.position_m.norm() - clock_m;
            assert!(error_m < 170.0 && range_m.abs() < 5.0, "{sv} {after}: {error_m} {range_m}");
            compared += 1;
        }
    }
    assert_eq!(compared, 36, "12 words");
}

/// Three satellites sent almanacs of different issues and reference times, 10 minutes apart, which must put a satellite
/// in one place: M_0 and omega have steps of 2.8 km, and each almanac is good to some kilometres.
#[test]
fn almanacs_of_different_issues_agree() {
    let pages = recorded(FILES[1]);
    let mut almanacs = BTreeMap::<Sv, Vec<GalileoAlmanac>>::new();
    for sender in [2, 3, 13].map(galileo) {
        let mut collector = NavigationCollector::default();
        // Twice over: before the first word 0 or 5 the week is not known.
        let of_sender = pages.iter().filter(|page| page.sv == sender);
        for Recorded { bits, .. } in of_sender.clone().chain(of_sender) {
            let page = InavPage::decode(bits).unwrap();
            collector.add(sender, &Content::Inav(Box::new(page)));
        }
        for (&sv, almanac) in collector.galileo_almanacs() {
            almanacs.entry(sv).or_default().push(almanac.clone());
        }
    }
    let t = GpsTime::from_week_tow(1258 + 1024, 571_530.0);
    for (sv, list) in &almanacs {
        assert_eq!(list.iter().map(|a| a.iod_a).collect::<Vec<_>>(), [4, 7, 6], "{sv}");
        let at = |k: usize| almanac_state(&list[k], t);
        assert!((at(0) - at(1)).norm() < 5e3 && (at(0) - at(2)).norm() < 5e3, "{sv}");
        assert!(list.iter().all(|a| a.health == GalileoHealth::default()));
    }
    let satellites = almanacs.keys().map(|sv| sv.number()).collect::<Vec<_>>();
    assert_eq!(satellites, if pages.is_empty() { vec![] } else { vec![10, 11, 12] });
}

/// Each choice of four words of eight, and a time, give the ephemeris that the words 1 to 4 give, and so does no choice
/// of three.
#[test]
fn any_four_words_of_ephemeris_and_parity_give_the_ephemeris() {
    let pages = recorded(FILES[1]);
    for sv in [2, 3, 13].map(galileo) {
        let word = |kind: u8| {
            let mut words = pages
                .iter()
                .filter(|page| page.sv == sv)
                .map(|page| InavPage::decode(&page.bits).unwrap().word.unwrap());
            words.find(|word| word.kind() == kind)
        };
        let kinds = [1, 2, 3, 4, 17, 18, 19, 20];
        let Some(words) = kinds.map(word).into_iter().collect::<Option<Vec<_>>>() else { return };
        let ephemeris = |choice: u32| {
            let chosen = words.iter().enumerate().filter(|(k, _)| choice >> k & 1 == 1);
            let mut collector = NavigationCollector::default();
            let mut sent: Vec<InavWord> = chosen.map(|(_, word)| word.clone()).collect();
            // The time may come first or last.
            sent.insert(if choice.is_multiple_of(2) { 0 } else { sent.len() }, word(5).unwrap());
            for word in &sent {
                let page = InavPage::new(word.clone());
                collector.add(sv, &Content::Inav(Box::new(page)));
            }
            collector.data().iter().next().cloned()
        };
        let expected = ephemeris(0b1111).unwrap();
        for choice in 0u32..256 {
            match choice.count_ones() {
                0..4 => assert_eq!(ephemeris(choice), None),
                _ => assert_eq!(ephemeris(choice).as_ref(), Some(&expected), "{sv} {choice:08b}"),
            }
        }
    }
}

/// By the order of the words (OS SIS ICD 2.1, 4.3.3: 2, 4, 6, 7, 8, 17, 19, 16, 0, 0, 1, 3, 5, 0, 16, and then 9, 10, 18
/// and 20 for 7, 8, 17 and 19), words 1 to 5, or word 5 and any four of 1 to 4 and 17 to 20, are there after so many pages.
#[test]
fn parity_words_make_an_ephemeris_come_sooner_wherever_reception_starts() {
    let without = [13, 15, 15, 14, 13, 12, 11, 10, 9, 8, 7, 15, 15, 15, 14];
    let with = [13, 12, 11, 10, 9, 8, 10, 10, 9, 8, 7, 10, 10, 15, 14];
    let pages = recorded(FILES[1]);
    for sv in [2, 3, 13].map(galileo) {
        let words = |page: &Recorded| InavPage::decode(&page.bits).unwrap().word.unwrap();
        let own: Vec<InavWord> = pages.iter().filter(|page| page.sv == sv).map(words).collect();
        let count = |start: usize, is_used: fn(&InavWord) -> bool| {
            let mut collector = NavigationCollector::default();
            let got = own[start..].iter().position(|word| {
                let content = Content::Inav(Box::new(InavPage::new(word.clone())));
                is_used(word) && collector.add(sv, &content) == Some(Update::Ephemeris(sv))
            });
            got.unwrap() + 1
        };
        for start in (0..15).filter(|_| !own.is_empty()) {
            assert_eq!(count(start, |word| !matches!(word, InavWord::Parity(_))), without[start]);
            assert_eq!(count(start, |_| true), with[start], "{sv} from page {start}");
        }
    }
}

fn almanac_state(almanac: &GalileoAlmanac, t: GpsTime) -> nalgebra::Vector3<f64> {
    let &GalileoAlmanac { sv, t0a, sqrt_a, e, i0, omega, omega0, omega_dot, m0, .. } = almanac;
    let orbit = Word16::default().ephemeris(sv, t0a);
    Ephemeris { toe: t0a, sqrt_a, e, i0, omega, omega0, omega_dot, m0, ..orbit }.state(t).position_m
}
