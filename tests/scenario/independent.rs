//! Against an independent simulator: same position, time and ephemeris.

use super::correlator::{code_sigma, doppler_sigma, measure, periods};
use super::theory::samples;
use crate::common::{Failed, Tested, data};
use num_complex::Complex32;
use sdr_rx::gnss::message::lnav::{Header, LnavMessage, decode_subframe, decode_words};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::path::Path;

const RATE: f64 = 2.6e6;
const SATELLITES: &str =
    r#"["G10", "G12", "G13", "G15", "G18", "G19", "G23", "G24", "G25", "G32"]"#;

/// The independent simulator's settings: static, Klobuchar's ionosphere, no troposphere, perfect clock.
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

#[test]
fn code_phase_and_doppler_agree_with_the_independent_simulator() -> Tested {
    let Some(data) = data() else { return Ok(()) };
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
        // The required agreement; thermal noise alone is below a third of it at three standard deviations.
        let seconds = a.signs.len() as f64 * 1e-3;
        assert!(3.0 * code_sigma(45.0, seconds) * 2f64.sqrt() < 0.02);
        assert!(3.0 * doppler_sigma(45.0, seconds) < 0.5);
        assert!(code.abs() < 0.02, "{sv}: code phase differs by {code} chips");
        assert!(doppler.abs() < 0.5, "{sv}: Doppler differs by {doppler} Hz");
    }
    Ok(())
}

/// Samples of the first `seconds` of the one-bit capture.
fn one_bit(data: &Path, seconds: f64) -> Result<Vec<Complex32>, Failed> {
    let bytes = std::fs::read(data.join("captures/sim_tokyo_2.6MHz_45s_1bit.bin"))?;
    let rail = |b: u8, k: u32| if b >> (7 - k) & 1 == 1 { -1.0 } else { 1.0 };
    Ok(bytes[..(seconds * RATE / 4.0) as usize]
        .iter()
        .flat_map(|&b| (0..4).map(move |k| Complex32::new(rail(b, 2 * k), rail(b, 2 * k + 1))))
        .collect())
}

/// Despread along our truth, the data bits of the independent capture begin with the code periods with
/// which ours do: pseudoranges agree in whole milliseconds for each satellite, not only modulo one.
#[test]
fn whole_milliseconds_agree_with_the_independent_simulator() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let source = ScenarioSource::new(&tokyo(data, 525_600.0, 2.0)?)?;
    let theirs = one_bit(data, 2.0)?;
    for sv in source.satellites() {
        let list = periods(&source, &theirs, RATE, sv);
        let signs = measure(&list).signs;
        let edges: Vec<i64> = (1..signs.len())
            .filter(|&k| signs[k] != signs[k - 1])
            .map(|k| list[k].index % 20)
            .collect();
        // Word 1 and 2 begin with 10001011; at 15 dB a period no sign is wrong (1e-15).
        assert!(edges.len() > 10 && edges.iter().all(|&k| k == 0), "{sv}: {edges:?}");
    }
    Ok(())
}

/// Words of three subframes of 6 s from the one-bit capture, despread along our truth.
#[test]
fn decoded_ephemerides_agree_with_those_of_the_independent_simulator() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let source = ScenarioSource::new(&tokyo(data, 525_600.0, 19.0)?)?;
    let theirs = one_bit(data, 19.0)?;
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
            compare(message, own_message);
        }
    }
    Ok(())
}

/// Integers are equal, reals too or one step nearer zero: the independent simulator truncates the twelve
/// digits of the navigation file where we round.
fn compare(theirs: LnavMessage, ours: LnavMessage) {
    let check = |unit: f64, fields: &[(f64, f64, i32)]| {
        for &(a, b, exponent) in fields {
            let step = unit * 2f64.powi(exponent);
            assert!((a - b).abs() <= 1.001 * step && a.abs() <= b.abs() * (1.0 + 1e-9), "{a} {b}");
        }
    };
    let near = |fields: &[_]| check(1.0, fields);
    let near_semicircles = |fields: &[_]| check(std::f64::consts::PI, fields);
    match (theirs, ours) {
        (LnavMessage::Clock(a), LnavMessage::Clock(b)) => {
            near(&[(a.af0, b.af0, -31), (a.af1, b.af1, -43), (a.tgd, b.tgd, -31)]);
            assert_eq!((a.week, a.iodc, a.toc, a.af2), (b.week, b.iodc, b.toc, b.af2));
        }
        (LnavMessage::Orbit(a), LnavMessage::Orbit(b)) => {
            near(&[(a.crs, b.crs, -5), (a.cuc, b.cuc, -29), (a.cus, b.cus, -29)]);
            near(&[(a.e, b.e, -33), (a.sqrt_a, b.sqrt_a, -19)]);
            near_semicircles(&[(a.delta_n, b.delta_n, -43), (a.m0, b.m0, -31)]);
            assert_eq!((a.iode, a.toe), (b.iode, b.toe));
        }
        (LnavMessage::Orientation(a), LnavMessage::Orientation(b)) => {
            near(&[(a.cic, b.cic, -29), (a.cis, b.cis, -29), (a.crc, b.crc, -5)]);
            near_semicircles(&[
                (a.omega0, b.omega0, -31),
                (a.i0, b.i0, -31),
                (a.omega, b.omega, -31),
            ]);
            near_semicircles(&[(a.omega_dot, b.omega_dot, -43), (a.idot, b.idot, -43)]);
            assert_eq!(a.iode, b.iode);
        }
        (a, b) => panic!("{a:?} {b:?}"),
    }
}

#[test]
fn a_navigation_file_of_another_day_is_refused_with_the_hours_between() -> Tested {
    let Some(data) = data() else { return Ok(()) };
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
