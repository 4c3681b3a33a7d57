//! Against a simulator that others wrote: same place, time and ephemeris.

use super::common::data_trial;
use super::correlator::{code_sigma, doppler_sigma, measure, periods};
use super::theory::samples;
use libtest_mimic::{Failed, Trial};
use num_complex::Complex32;
use sdr_rx::gnss::lnav::{Header, Message, decode_subframe, decode_words};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::path::Path;

const RATE: f64 = 2.6e6;
const SATELLITES: &str =
    r#"["G10", "G12", "G13", "G15", "G18", "G19", "G23", "G24", "G25", "G32"]"#;

pub fn trials() -> Vec<Trial> {
    vec![
        data_trial("code_doppler_and_milliseconds_agree_with_the_independent_simulator", ranges),
        data_trial("ephemeris_words_agree_bit_by_bit_with_the_independent_simulator", bits),
        data_trial("a_navigation_file_of_another_day_is_refused_with_the_hours_between", stale),
    ]
}

/// The independent simulator's place: static, Klobuchar's ionosphere, no troposphere, perfect clock.
fn tokyo(data: &Path, tow: f64, seconds: f64) -> Result<Scenario, Failed> {
    let text = format!(
        r#"
        start = "2190:{tow}"
        duration_s = {seconds}
        orbits.navigation_file = '{}'
        satellites = {SATELLITES}
        receiver.position.ecef_m = [-3959617.5, 3350136.6, 3699531.5]
        atmosphere.ionosphere = "klobuchar"
        signal.cn0_dbhz = 45.0
        front_end = {{ rate_hz = {RATE}, bits = 8 }}
        "#,
        data.join("nav/brdc0010.22n").display()
    );
    Ok(Scenario::parse(&text, "tokyo")?)
}

fn ranges(data: &Path) -> Result<(), Failed> {
    let scenario = tokyo(data, 525_633.0, 1.0)?;
    let mut source = ScenarioSource::new(&scenario)?;
    let ours = samples(&mut source, 1 << 18)?;
    let bytes = std::fs::read(data.join("captures/sim_tokyo_2.6MHz_1s_cs8.bin"))?;
    let number = |b: u8| f32::from(b as i8);
    let theirs: Vec<Complex32> =
        bytes.chunks_exact(2).map(|b| Complex32::new(number(b[0]), number(b[1]))).collect();
    println!(
        "sv    code ours  theirs  difference (chips)   Doppler ours  theirs  difference (Hz)   C/N0 ours theirs"
    );
    for sv in source.satellites().collect::<Vec<_>>() {
        let a = measure(&periods(&source, &ours, RATE, sv));
        let b = measure(&periods(&source, &theirs, RATE, sv));
        let (code, doppler) = (b.code_chips - a.code_chips, b.doppler_hz - a.doppler_hz);
        println!(
            "{sv}   {:+.4}  {:+.4}  {code:+.4}   {:+.4}  {:+.4}  {doppler:+.4}   {:.1}  {:.1}",
            a.code_chips, b.code_chips, a.doppler_hz, b.doppler_hz, a.cn0_dbhz, b.cn0_dbhz
        );
        // The required agreement; thermal noise alone is below a third of it at three deviations.
        let seconds = a.signs.len() as f64 * 1e-3;
        assert!(3.0 * code_sigma(45.0, seconds) * 2f64.sqrt() < 0.02);
        assert!(3.0 * doppler_sigma(45.0, seconds) < 0.5);
        assert!(code.abs() < 0.02, "{sv}: code phase differs by {code} chips");
        assert!(doppler.abs() < 0.5, "{sv}: Doppler differs by {doppler} Hz");

        // Bit edges fall into the same code periods: the ranges agree in whole milliseconds too (a bit
        // is 20 ms, and the words that both send alike fix more).
        let edges = |signs: &[f64]| -> Vec<usize> {
            (1..signs.len()).filter(|&k| signs[k] != signs[k - 1]).map(|k| k % 20).collect()
        };
        let (mine, other) = (edges(&a.signs), edges(&b.signs));
        let place = mine.first().copied().ok_or("no bit edge in a second")?;
        assert!(mine.iter().chain(&other).all(|&k| k == place), "{sv}: {mine:?} {other:?}");
        assert!(!other.is_empty());
    }
    Ok(())
}

/// Words of three subframes of 6 s from the one-bit capture, despread along our truth.
fn bits(data: &Path) -> Result<(), Failed> {
    let scenario = tokyo(data, 525_600.0, 19.0)?;
    let source = ScenarioSource::new(&scenario)?;
    let bytes = std::fs::read(data.join("captures/sim_tokyo_2.6MHz_45s_1bit.bin"))?;
    let rail = |b: u8, k: u32| if b >> (7 - k) & 1 == 1 { -1.0 } else { 1.0 };
    let theirs: Vec<Complex32> = bytes[..(19.0 * RATE / 4.0) as usize]
        .iter()
        .flat_map(|&b| (0..4).map(move |k| Complex32::new(rail(b, 2 * k), rail(b, 2 * k + 1))))
        .collect();
    for sv in ["G10", "G23", "G32"] {
        let sv = sv.parse()?;
        let list = periods(&source, &theirs, RATE, sv);
        // The first whole subframe: 525 600 s is a frame's start by the satellite's clock, and the first
        // sample was sent some 70 ms before.
        let first = list.iter().position(|p| p.index == 525_600_000).ok_or("no frame start")?;
        // 20 periods a bit; polarity from bit to bit, as the phase of truth follows the carrier.
        let reference = measure(&list[first..first + 1000]).phase_cycles;
        let turn = num_complex::Complex64::cis(-std::f64::consts::TAU * reference);
        let mut polarity = 1.0;
        for subframe in 0..3 {
            let mut words = [0u32; 10];
            for bit in 0..300 {
                let at = first + subframe * 6000 + bit * 20;
                let sum: f64 = list[at..at + 20].iter().map(|p| (p.prompt * turn).re).sum();
                if subframe == 0 && bit == 0 {
                    // The preamble starts with a 1, sent as -1.
                    polarity = -sum.signum();
                }
                words[bit / 30] = words[bit / 30] << 1 | u32::from(sum * polarity < 0.0);
            }
            let index = 2190 * 100_800 + 87_600 + subframe as i64;
            let ours = source.subframe(sv, index).ok_or("not simulated")??;
            let theirs = decode_words(&words, 0).ok_or(format!("{sv} {subframe}: parity"))?;
            let ours_data = decode_words(&ours, 0).ok_or("our own parity")?;
            let (header, message) = decode_subframe(&theirs);
            let (own_header, own_message) = decode_subframe(&ours_data);
            let same = |h: &Header| (h.tow_count, h.id, h.alert);
            assert_eq!(same(&header), same(&own_header));
            let differing: Vec<usize> = (0..10).filter(|&k| theirs[k] != ours_data[k]).collect();
            println!("{sv} subframe {}: words {differing:?} differ (counted from 0)", header.id);
            match (message, own_message) {
                (Message::Clock(a), Message::Clock(b)) => assert_eq!(a, b),
                (Message::Orbit(mut a), Message::Orbit(b)) => {
                    a.aodo = b.aodo;
                    assert_eq!(a, b);
                }
                (Message::Orientation(a), Message::Orientation(b)) => assert_eq!(a, b),
                (a, b) => panic!("{a:?} {b:?}"),
            }
        }
    }
    Ok(())
}

fn stale(data: &Path) -> Result<(), Failed> {
    let mut scenario = tokyo(data, 525_600.0, 1.0)?;
    scenario.start = scenario.start + 10.0 * 86_400.0;
    let error = ScenarioSource::new(&scenario).err().ok_or("accepted")?.to_string();
    assert!(error.contains("hours away") && error.contains("G10"), "{error}");
    scenario.satellites = None;
    let error = ScenarioSource::new(&scenario).err().ok_or("accepted")?.to_string();
    assert!(error.contains("hours away"), "{error}");
    scenario.satellites = Some(vec!["J03".parse()?]);
    let error = ScenarioSource::new(&scenario).err().ok_or("accepted")?.to_string();
    assert!(error.contains("no ephemeris of J03"), "{error}");
    Ok(())
}
