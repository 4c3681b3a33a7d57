//! Pages made here: through symbols, noise and slips, and what cannot be sent.

use super::{E05_BITS, bits_of, galileo};
use crate::Ephemeris;
use crate::galileo_data::GalileoHealth;
use crate::message::inav::*;
use crate::message::{Content, MessageDecoder, NavigationCollector, Page, Update};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Symbols of a real page, of one with the time, of an alert page and of a dummy, ten times over.
fn symbols() -> Vec<f32> {
    (0..PAGES).flat_map(|k| page_symbols(&page(k).encode().unwrap())).map(f32::from).collect()
}

const PAGES: usize = 40;

/// The page of index `k` of [`symbols`].
fn page(k: usize) -> InavPage {
    let real = InavPage::decode(&bits_of(E05_BITS)).unwrap();
    match k % 4 {
        0 => real,
        1 => InavPage::new(InavWord::SpareTime(Word0 {
            time: 2,
            week: 1174,
            tow: 28_801 + 2 * k as u32,
        })),
        2 => InavPage { word: None, ..real },
        _ => InavPage::new(InavWord::Other(OtherWord {
            kind: 63,
            data: [k as u8; 16].map(|b| b & 0xC0),
        })),
    }
}

/// Pages of symbols that are numbered from `start`.
fn decode(symbols: &[f32], start: u64) -> Vec<Page> {
    let mut decoder = InavDecoder::new();
    symbols.iter().zip(start..).filter_map(|(&s, index)| decoder.push(s, index)).collect()
}

/// Asserts that the pages are those `expected` of `symbols()`, the first symbol of page n at 500 n plus `shift`.
fn assert_pages(
    pages: &[Page],
    expected: impl Iterator<Item = usize>,
    shift: impl Fn(usize) -> i64,
) {
    let expected: Vec<_> = expected
        .map(|k| {
            let content = page(k);
            let tow_s = content.word.as_ref().and_then(InavWord::tow_s);
            let start_index = ((PAGE_SYMBOLS * k) as i64 + shift(k)) as u64;
            Page { start_index, tow_s, content: Content::Inav(Box::new(content)) }
        })
        .collect();
    assert_eq!(pages, expected);
}

#[test]
fn all_whole_pages_are_found_wherever_the_symbols_start_and_whatever_the_polarity() {
    let all = symbols();
    for cut in [0, 1, 9, 249, 250, 251, 499, 500, 501] {
        for sign in [1.0, -1.0] {
            let cut_off: Vec<f32> = all[cut..].iter().map(|s| s * sign).collect();
            let pages = decode(&cut_off, 1_000_000 + cut as u64);
            assert_pages(&pages, cut.div_ceil(500)..PAGES, |_| 1_000_000);
        }
    }
    assert!((0..PAGES).any(|k| page(k).word.is_none()), "alert pages are among them");
}

/// C/N0 = 29 dB-Hz of the signal, half of which is E1-B: Es/N0 = 29 - 3 - 24 = 2 dB, Eb/N0 = 5 dB, where a decoded bit is
/// wrong with probability below 5e-7 (union bound).
#[test]
fn pages_pass_noise() {
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
    assert_pages(&decode(&noisy, 0), 0..PAGES, |_| 0);
}

#[test]
fn slips_cost_the_page_they_fall_into_and_jumps_start_the_search_again() {
    let mut slipped = symbols();
    // Half-cycle slips in page 4 and between the parts of page 6, a lost symbol in 9 and one too many in 20.
    slipped[4 * 500 + 110..].iter_mut().for_each(|s| *s = -*s);
    slipped[6 * 500 + 250..].iter_mut().for_each(|s| *s = -*s);
    slipped.insert(20 * 500 + 77, 1.0);
    slipped.remove(9 * 500 + 123);
    let kept = (0..PAGES).filter(|n| ![4, 9, 20].contains(n));
    assert_pages(&decode(&slipped, 0), kept, |n| if (10..20).contains(&n) { -1 } else { 0 });

    let mut decoder = InavDecoder::new();
    let indices = (0..2_600).chain(2_603..);
    let pages: Vec<Page> =
        symbols().iter().zip(indices).filter_map(|(&s, index)| decoder.push(s, index)).collect();
    assert_pages(&pages, (0..PAGES).filter(|&n| n != 5), |n| if n > 5 { 3 } else { 0 });
}

#[test]
fn noise_gives_nothing_and_parts_of_two_pages_make_none() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let noise: Vec<f32> = (0..200_000).map(|_| rng.random_range(-1.0..1.0)).collect();
    assert_eq!(decode(&noise, 0), []);
    let all = symbols();
    // An even part, then the odd part of the next page.
    let mixed = [&all[..250], &all[750..1000]].concat();
    assert_eq!(decode(&mixed, 0), []);
}

#[test]
fn ephemerides_are_not_mixed_of_two_issues_and_follow_the_health() {
    let sv = galileo(14);
    let sample = crate::orbit::broadcast::sample_ephemeris();
    let eph = |iodc, e| Ephemeris { sv, iodc, iode: iodc as u8, e, ..sample.clone() };
    // E14 is on an eccentric orbit.
    let (old, new) = (ephemeris_words(&eph(1023, 0.16), 107), ephemeris_words(&eph(0, 0.17), 107));
    let status = |e1b_status| {
        let health = GalileoHealth { e1b_status, ..Default::default() };
        let tow = sample.toe.tow() as u32 + 301 + u32::from(e1b_status);
        InavWord::IonosphereHealth(Word5 { health, week: 2190 - 1024, tow, ..Word5::default() })
    };
    let mut collector = NavigationCollector::default();
    let mut add = |word: &InavWord| {
        let sent = InavPage::new(word.clone()).encode().unwrap();
        let page = InavPage::decode(&sent).unwrap();
        collector.add(sv, &Content::Inav(Box::new(page)))
    };
    assert_eq!(old.iter().map(&mut add).collect::<Vec<_>>(), [None, None, None, None]);
    assert_eq!(add(&status(0)), Some(Update::Ephemeris(sv)), "the last that is needed");
    for word in &new[..3] {
        assert_eq!(add(word), None);
    }
    assert_eq!(add(&new[3]), Some(Update::Ephemeris(sv)));
    assert_eq!(add(&new[0]), None, "nothing new");
    assert_eq!(add(&status(1)), Some(Update::Health));
    // Words of another satellite, as after a lock on a cross-correlation.
    let other = ephemeris_words(&Ephemeris { sv: galileo(18), ..eph(5, 0.1) }, 107);
    assert_eq!(other.iter().filter_map(&mut add).collect::<Vec<_>>(), []);
    let data = collector.data();
    assert_eq!(
        data.iter().map(|e| (e.iodc, e.health)).collect::<Vec<_>>(),
        [(1023, 0), (0, 0), (0, 2)]
    );
    let now = sample.toe + 400.0;
    assert_eq!(data.orbit(sv, now).err(), Some(crate::orbit::NoOrbit::Unhealthy(2)));
}

#[test]
fn values_that_do_not_fit_are_refused() {
    let word = InavWord::Ephemeris1(Word1 { toe: 604_800.0 * 2.0, ..Word1::default() });
    let error = InavPage::new(word).encode().unwrap_err();
    assert_eq!((error.name, error.max), ("t_0e", 60.0 * 16_383.0));
}

#[test]
fn an_offset_of_ones_is_not_available() {
    let ones = [true; WORD_BITS];
    let mut bits = ones;
    bits[..6].copy_from_slice(&[false, false, true, false, true, false]);
    let InavWord::Almanac10(word) = InavWord::decode(&bits) else { panic!("word 10") };
    assert_eq!(word.gps_offset.resolve(2198), None);
}

proptest! {
    #[test]
    fn arbitrary_symbols_never_panic(symbols in prop::collection::vec(any::<f32>(), 0..1500), start: u64) {
        let mut decoder = InavDecoder::new();
        for (k, symbol) in symbols.iter().enumerate() {
            decoder.push(*symbol, start.wrapping_add(k as u64));
        }
    }

    #[test]
    fn arbitrary_words_are_written_as_they_were_read(
        kind in 0u8..64,
        data in prop::collection::vec(any::<bool>(), WORD_BITS),
    ) {
        let mut bits: WordBits = data.try_into().unwrap();
        bits[..6].iter_mut().enumerate().for_each(|(k, bit)| *bit = kind >> (5 - k) & 1 == 1);
        let word = InavWord::decode(&bits);
        prop_assert_eq!(word.kind(), kind);
        let page = InavPage::new(word);
        prop_assert_eq!(InavPage::decode(&page.encode().unwrap()), Some(page.clone()));
        // Whatever it says, the collector takes it.
        let mut collector = NavigationCollector::default();
        for _ in 0..2 {
            collector.add(galileo(1), &Content::Inav(Box::new(page.clone())));
        }
    }
}
