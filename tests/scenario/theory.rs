//! Captures against their own truth and against closed forms.

use super::correlator::{code_sigma, doppler_sigma, measure, periods};
use crate::common::{Failed, Tested};
use num_complex::Complex32;
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::scenario::{FrontEnd, Scenario, ScenarioSource};

const BASE: &str = r#"
start = "2190:525600"
duration_s = 1.0
seed = 7
[orbits.walker]
pattern = "24/6/1"
node_longitude_deg = 12.0
eccentricity = 0.01
[receiver]
position.geodetic = { latitude_deg = 48.0, longitude_deg = 11.0, height_m = 500.0 }
"#;

pub fn scenario(rest: &str) -> Scenario {
    Scenario::parse(&format!("{BASE}{rest}"), "test").expect("a valid scenario")
}

/// All samples of channel 0, read in blocks of `len`.
pub fn samples(source: &mut ScenarioSource, len: usize) -> Result<Vec<Complex32>, Failed> {
    let mut block = Block::default();
    let mut all = Vec::new();
    while source.read(&mut block, len).map_err(|e| e.to_string())? > 0 {
        assert_eq!(block.first_sample(), all.len() as u64);
        all.extend_from_slice(block.channel(0));
    }
    Ok(all)
}

#[test]
fn code_carrier_and_doppler_of_a_dynamic_capture_agree_with_its_truth() -> Tested {
    let rate = 4.1e6;
    let scenario = scenario(&format!(
        "motion.circle = {{ radius_m = 30.0, speed_mps = 30.0 }}
        clock_offset_s = 3e-4
        clock_drift_ppm = -1.3
        [atmosphere]
        ionosphere = \"klobuchar\"
        klobuchar = {{ alpha = [1e-8, 2e-8, -6e-8, -1e-7], beta = [1e5, 1e5, -6e4, -3e5] }}
        troposphere = \"saastamoinen\"
        [signal]
        cn0_dbhz = 50.0
        [front_end]
        rate_hz = {rate}"
    ));
    let mut source = ScenarioSource::new(&scenario)?;
    let all = samples(&mut source, 100_000)?;
    let satellites: Vec<_> = source.satellites().collect();
    assert_eq!(satellites.len(), 8);
    for sv in satellites {
        let list = periods(&source, &all, rate, sv);
        let m = measure(&list);
        let seconds = list.len() as f64 * 1e-3;
        // Seven other codes of 50 dB-Hz raise the noise by 7 x 1e5 x 2/(3 x 1.023e6 Hz) = 0.46: x 1.21.
        // Curvature within the 20 ms replicas, a t^2 / 8 = 30 x 4e-4 / 8 = 1.5 mm = 0.008 cycles.
        let (code, doppler) =
            (1.21 * code_sigma(50.0, seconds), 1.21 * doppler_sigma(50.0, seconds));
        let phase = 1.21 * (0.5 / (1e5 * seconds)).sqrt() / std::f64::consts::TAU;
        // Replica edges fall between samples: 1 / (chip edges x periods) of a sample, below 1e-3 chips.
        assert!(m.code_chips.abs() < 5.0 * code + 1e-3, "{sv} code {} {code}", m.code_chips);
        assert!(
            m.doppler_hz.abs() < 5.0 * doppler + 0.01,
            "{sv} Doppler {} {doppler}",
            m.doppler_hz
        );
        // Phase at the start of a line fit is twice as uncertain as in its middle.
        let bound = 10.0 * phase + 0.008;
        assert!(m.phase_cycles.abs() < bound, "{sv} phase {} {bound}", m.phase_cycles);
    }
    Ok(())
}

#[test]
fn measured_cn0_and_fading_are_as_specified() -> Tested {
    for (asked, fading, expected) in [(38.0, "[]", 38.0), (50.0, "[[0.0, 0.0], [0.1, -6.0]]", 44.0)]
    {
        let scenario = Scenario {
            satellites: Some(vec!["G21".parse()?]),
            duration_s: 4.0,
            ..scenario(&format!(
                "[signal]\ncn0_dbhz = {asked}\nfading = {fading}\n[front_end]\nrate_hz = 2.6e6\nbits = 8"
            ))
        };
        let mut source = ScenarioSource::new(&scenario)?;
        let all = samples(&mut source, 1 << 16)?;
        let list = periods(&source, &all, 2.6e6, "G21".parse()?);
        let got = measure(&list[200..]).cn0_dbhz;
        // Noise power from 3700 values: 4.34 sqrt(2 / 3700) = 0.10 dB. Replica and signal chips differ at
        // none, 8 bits lose 0.01 dB.
        assert!((got - expected).abs() < 0.5, "asked {expected}, measured {got}");
    }
    Ok(())
}

#[test]
fn any_blocks_give_the_same_samples_and_seeds_differ() -> Tested {
    let mut scenario = Scenario {
        duration_s: 0.03,
        ..scenario(
            "[noise]\nimpulse_share = 0.05\nimpulse_variance_ratio = 100.0\n[front_end]\nrate_hz = 2.6e6\n\
             bandwidth_hz = 2e6\nif_hz = 1.5e5\nagc_time_constant_s = 0.01\nbits = 4\ndc_offset = [0.1, -0.1]\n\
             iq_gain_db = 0.5\niq_phase_deg = 2.0",
        )
    };
    let whole = samples(&mut ScenarioSource::new(&scenario)?, usize::MAX)?;
    assert_eq!(whole.len(), 78_000);
    for len in [1000, 4097, 16_384] {
        assert!(samples(&mut ScenarioSource::new(&scenario)?, len)? == whole, "blocks of {len}");
    }
    scenario.seed += 1;
    let other = samples(&mut ScenarioSource::new(&scenario)?, 5000)?;
    let same = other.iter().zip(&whole).filter(|(a, b)| a == b).count();
    // Two independent 4-bit samples agree in at most 1 of 15 cases for each of I and Q, with the middle levels
    // favoured: 0.1 squared.
    assert!(same < 78_000 / 25, "{same}");
    Ok(())
}

#[test]
fn satellites_and_noise_draw_from_streams_of_their_own() -> Tested {
    let with = |satellites: &[&str], noise: bool| -> Result<Vec<Complex32>, Failed> {
        let list = satellites.iter().map(|s| s.parse()).collect::<Result<Vec<_>, _>>()?;
        let scenario = Scenario {
            satellites: Some(list),
            duration_s: 0.01,
            ..scenario(&format!("[noise]\nenabled = {noise}\n[front_end]\nrate_hz = 2e6"))
        };
        samples(&mut ScenarioSource::new(&scenario)?, 5000)
    };
    let (one, two) = (with(&["G21"], true)?, with(&["G17", "G21"], true)?);
    let alone = with(&["G17"], false)?;
    for ((one, two), alone) in one.iter().zip(&two).zip(&alone) {
        // The second satellite adds to the same noise: rounding of single precision around 5.
        assert!((two - one - alone).norm() < 2e-6);
    }
    // A^2 = C/N0 / rate for unit background.
    let power = alone.iter().map(|x| f64::from(x.norm_sqr())).sum::<f64>() / alone.len() as f64;
    assert!((power / (10f64.powf(4.5) / 2e6) - 1.0).abs() < 1e-5, "{power}");
    Ok(())
}

#[test]
fn a_custom_front_end_replaces_the_standard_one() -> Tested {
    struct Mirror;
    impl FrontEnd for Mirror {
        fn delay(&self) -> usize {
            5
        }
        fn process(&mut self, _channel: usize, samples: &mut [Complex32]) {
            samples.iter_mut().for_each(|x| *x = x.conj());
        }
    }
    let scenario = Scenario { duration_s: 0.002, ..scenario("[front_end]\nrate_hz = 2e6") };
    let plain = samples(&mut ScenarioSource::new(&scenario)?, 4000)?;
    let mut source = ScenarioSource::with_front_end(&scenario, Box::new(Mirror))?;
    let mirrored = samples(&mut source, 4000)?;
    // The stated delay is removed: the first sample is five samples on.
    assert!(plain[5..].iter().zip(&mirrored).all(|(a, b)| a.conj() == *b));
    Ok(())
}

#[test]
fn the_scenarios_of_the_repository_are_complete() -> Tested {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("signals");
    let mut count = 0;
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|s| s == "toml") {
            let scenario = Scenario { duration_s: 0.002, ..Scenario::read(&path)? };
            let mut source = ScenarioSource::new(&scenario)?;
            assert!(source.satellites().count() >= 5, "{}", path.display());
            assert!(!samples(&mut source, 1000)?.is_empty());
            count += 1;
        }
    }
    assert!(count >= 3);
    Ok(())
}
