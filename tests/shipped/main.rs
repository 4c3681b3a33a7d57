//! The program on a capture that an independent generator made, and that comes with the tests: satellites against its
//! truth, whatever the sample type, under impulses and jammers that are added here, and with mistaken options.

#[path = "../common/mod.rs"]
mod common;
#[path = "../receiver/program.rs"]
#[allow(dead_code)]
mod program;

use common::{Failed, Tested};
use program::{Answer, run};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::Value;

const CAPTURE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/oslo_4MHz_0.3s.cs8");
const TRUTH: &str = include_str!("../data/oslo_truth.json");
const RATE_HZ: f64 = 4e6;

/// The satellites sent, of the systems with these letters.
fn sent(systems: &str) -> Result<Vec<Value>, Failed> {
    let truth: Value = serde_json::from_str(TRUTH)?;
    let rows = truth["satellites"].as_array().ok_or("no satellites")?;
    let is_asked = |row: &&Value| row["sat"].as_str().is_some_and(|sv| systems.contains(&sv[..1]));
    Ok(rows.iter().filter(is_asked).cloned().collect())
}

fn names(rows: &[Value]) -> Vec<&str> {
    let mut names: Vec<&str> = rows.iter().filter_map(|row| row["sat"].as_str()).collect();
    names.sort_unstable();
    names
}

/// Acquires these samples, written in a type.
fn acquire(bytes: &[u8], options: &[&str]) -> Result<Answer, Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("capture.bin");
    std::fs::write(&path, bytes)?;
    let path = path.to_string_lossy();
    run(&[&["acquire", &path], options].concat())
}

/// The capture's numbers, I and Q in turn.
fn numbers() -> Result<Vec<f32>, Failed> {
    Ok(std::fs::read(CAPTURE)?.into_iter().map(|b| f32::from(b as i8)).collect())
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

#[test]
fn all_satellites_of_both_systems_are_found_where_they_are_and_no_other() -> Tested {
    let rows = sent("GE")?;
    let answer = run(&["acquire", CAPTURE, "-r", "4M"])?;
    assert_eq!(answer.satellites(), names(&rows));
    for row in &rows {
        let sv = row["sat"].as_str().unwrap_or_default();
        let number = |name: &str| row[name].as_f64().unwrap_or(f64::NAN);
        let doppler = answer.acquired(sv, "doppler_hz") - number("doppler_hz");
        let chips = answer.acquired(sv, "code_phase_chips") - number("code_phase_chips");
        assert!(doppler.abs() < 2.0 && chips.abs() < 0.05, "{sv}: {doppler} Hz, {chips} chips");
    }
    Ok(())
}

#[test]
fn every_sample_type_shows_the_same_satellites() -> Tested {
    let (rows, numbers) = (sent("G")?, numbers()?);
    let words = |scale: f32| -> Vec<u8> {
        numbers.iter().flat_map(|x| ((x * scale) as i16).to_le_bytes()).collect()
    };
    let offset: Vec<u8> = numbers.iter().map(|x| (*x as i8 as u8) ^ 0x80).collect();
    let signs: Vec<u8> = numbers
        .as_chunks::<8>()
        .0
        .iter()
        .map(|eight| eight.iter().fold(0, |byte, x| byte << 1 | u8::from(*x < 0.0)))
        .collect();
    for (name, bytes) in
        [("cs16", words(200.0)), ("cf32", floats(&numbers)), ("cu8", offset), ("b1", signs)]
    {
        let answer = acquire(&bytes, &["-f", name, "-r", "4M", "--prn", "G"])?;
        assert_eq!(answer.satellites(), names(&rows), "{name}");
    }
    Ok(())
}

/// A twentieth of the samples with 2000 times the variance, which cost 20 dB untreated.
#[test]
fn impulses_hide_no_satellite() -> Tested {
    let (rows, mut numbers) = (sent("G")?, numbers()?);
    let rms = (numbers.iter().map(|x| x * x).sum::<f32>() / numbers.len() as f32).sqrt();
    let mut random = ChaCha8Rng::seed_from_u64(11);
    for sample in numbers.as_chunks_mut::<2>().0 {
        if random.random::<f32>() < 0.05 {
            for x in sample {
                let noise: f32 = StandardNormal.sample(&mut random);
                *x += 45.0 * rms * noise;
            }
        }
    }
    let bytes = floats(&numbers);
    let found = acquire(&bytes, &["-f", "cf32", "-r", "4M", "--prn", "G"])?;
    assert_eq!(found.satellites(), names(&rows));
    let untreated =
        acquire(&bytes, &["-f", "cf32", "-r", "4M", "--prn", "G", "--suppress", "off"])?;
    assert!(untreated.satellites().len() < rows.len() / 2, "{:?}", untreated.satellites());
    Ok(())
}

/// A carrier 30 dB over the noise is told and removed.
#[test]
fn a_jammer_hides_no_satellite_and_is_named() -> Tested {
    let (rows, mut numbers) = (sent("G")?, numbers()?);
    let power = numbers.iter().map(|x| x * x).sum::<f32>() / (numbers.len() / 2) as f32;
    let amplitude = (1000.0 * power).sqrt();
    for (n, sample) in numbers.as_chunks_mut::<2>().0.iter_mut().enumerate() {
        let (sin, cos) = (std::f64::consts::TAU * 301e3 / RATE_HZ * n as f64).sin_cos();
        sample[0] += amplitude * cos as f32;
        sample[1] += amplitude * sin as f32;
    }
    let answer = acquire(&floats(&numbers), &["-f", "cf32", "-r", "4M", "--prn", "G"])?;
    assert_eq!(answer.satellites(), names(&rows));
    assert!(answer.messages().contains("CW at +301.0 kHz"), "{}", answer.messages());
    Ok(())
}

/// What is wrong, and what the advice names.
#[test]
fn mistaken_options_are_named() -> Tested {
    let cases: [(&[&str], &str); 8] = [
        (&["-f", "cs8", "-r", "2M"], "--rate 4000000"),
        (&["-f", "cs8", "-r", "2.048M"], "--rate 4000000"),
        (&["-f", "cs8", "-r", "5M"], "--rate 4000000"),
        (&["-f", "cs16", "-r", "4M"], "--format cs8"),
        (&["-f", "b1", "-r", "4M"], "--format cs8"),
        (&["-f", "rs8", "-r", "4M", "--if", "1M"], "--format cs8 --if 0"),
        (&["-f", "cs8", "-r", "4M", "--if", "420k"], "--if 0"),
        (&["-f", "cs8", "-r", "4M", "--channels", "2"], "--channels 1"),
    ];
    for (options, named) in cases {
        let answer = run(&[&["acquire", CAPTURE, "--prn", "G"], options].concat())?;
        let said = answer.messages();
        let advice = said.lines().find(|line| line.contains("satellites are there with"));
        assert!(
            advice.is_some_and(|a| a.contains(&format!("with {named}:"))),
            "{options:?}: {said}"
        );
    }
    // All that was asked for is there, and too little signal to say more.
    let few = run(&["acquire", CAPTURE, "-r", "4M", "--prn", "G05,17"])?;
    assert_eq!((few.satellites().len(), few.messages().contains("next to no")), (2, false));
    let start = &std::fs::read(CAPTURE)?[..16_000];
    let options = ["-f", "cs8", "-r", "5M", "--prn", "G", "--search-ms", "1"];
    let short = acquire(start, &options)?;
    assert!(short.messages().contains("1.600 ms of signal"), "{}", short.messages());
    Ok(())
}
