//! Galileo E1: search, code loop, pilot and I/NAV against theory, on the own simulator; and captures of an independent
//! simulator and of a real front end, whose truth is by others.

use crate::common::{Failed, Tested, data};
use crate::program::{Answer, file, median, run, vector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use sdr_rx::acquisition::{Acquisition, SearchOptions, SearchPlan};
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::correlator::SampleBuffer;
use sdr_rx::gnss::message::{NavigationCollector, Update};
use sdr_rx::gnss::{GpsTime, Sv, Transmission, signal};
use sdr_rx::scenario::{Scenario, ScenarioSource, TruthEpoch};
use sdr_rx::tracking::{Channel, LockState, TrackStart, TrackingOptions};
use serde_json::Value;
use std::path::Path;

const RATE_HZ: f64 = 4e6;

/// One satellite of the scenario of both systems.
fn scene(
    sv: Sv,
    cn0_dbhz: f64,
    start_s: f64,
    duration_s: f64,
    seed: u64,
) -> Result<Scenario, Failed> {
    let mut scenario = Scenario::read("signals/static_gps_galileo.toml".as_ref())?;
    scenario.satellites = Some(vec![sv]);
    scenario.start = GpsTime::from_week_tow(2190, 525_600.0 + start_s);
    scenario.duration_s = duration_s;
    scenario.seed = seed;
    scenario.signal.cn0_dbhz = cn0_dbhz;
    scenario.front_end.bits = None;
    Ok(scenario)
}

fn truth(source: &ScenarioSource, transmission: Transmission) -> Result<Acquisition, Failed> {
    let TruthEpoch { satellites, .. } = source.truth_at(0);
    let seen = satellites.first().ok_or("no satellite")?;
    Ok(Acquisition {
        transmission,
        doppler_hz: seen.doppler_hz,
        code_phase_chips: seen.code_phase_chips,
        cn0_dbhz: seen.cn0_dbhz,
        statistic: 0.0,
        false_alarm: 0.0,
    })
}

/// Fraction of the detections that theory gives for a search at this C/N0 (of E1): the power of each of ten looks, B and C
/// in five code periods, over the threshold. Code phase and Doppler lie anywhere between the cells, signs change with
/// probability one half, at one place in all windows.
fn expected(cn0_dbhz: f64, threshold: f64) -> f64 {
    const DRAWS: u64 = 4000;
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    // Half of the power in each component, whose BOC(1,1) part has ten elevenths.
    let snr = 10f64.powf(cn0_dbhz / 10.0) * 4e-3 * 0.5 * 10.0 / 11.0;
    let detected = (0..DRAWS).filter(|_| {
        let [delay, doppler, edge]: [f64; 3] = std::array::from_fn(|_| rng.random());
        // Cells are a quarter of a chip and 125 Hz apart; of four neighbours the best counts.
        let cell = |at: f64| (1.0 - 3.0 * 0.25 * at).max(-0.5);
        let mut best = 0f64;
        let signs: Vec<bool> = (0..10).map(|_| rng.random()).collect();
        let noise: Vec<f64> = (0..20).map(|_| StandardNormal.sample(&mut rng)).collect();
        for (code, row) in [delay, 1.0 - delay].into_iter().zip([doppler, doppler - 1.0, doppler]) {
            let power: f64 = (0..10)
                .map(|look| {
                    // exp(j 2 pi f t) over the window before the edge, and after it with the other sign.
                    let turn = std::f64::consts::TAU * 0.5 * row;
                    let part = |from: f64, to: f64| {
                        let half = 0.5 * turn * (to - from);
                        let size = if half == 0.0 { 1.0 } else { half.sin() / half } * (to - from);
                        num_complex::Complex64::from_polar(size, turn * 0.5 * (from + to))
                    };
                    let sign = if signs[look] { 1.0 } else { -1.0 };
                    let signal =
                        (part(0.0, edge) + part(edge, 1.0) * sign) * snr.sqrt() * cell(code);
                    let noisy = signal
                        + num_complex::Complex64::new(noise[2 * look], noise[2 * look + 1])
                            / 2f64.sqrt();
                    noisy.norm_sqr()
                })
                .sum();
            best = best.max(power);
        }
        best > threshold
    });
    detected.count() as f64 / DRAWS as f64
}

/// 20 ms of B and C. The best of few cells by theory, of more by the search: half a decibel either way, and four standard
/// deviations of 100 draws.
#[test]
fn detections_of_e1_are_those_of_theory() -> Tested {
    const DRAWS: u64 = 100;
    let transmission = signal::of("E11".parse()?);
    for cn0_dbhz in [35.0, 37.0] {
        let mut found = 0.0;
        let mut threshold = 0.0;
        for seed in 0..DRAWS {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let start_s = rng.random_range(0.0..20.0);
            let scenario = scene(transmission.sv, cn0_dbhz, start_s, 0.0205, seed)?;
            let mut source = ScenarioSource::new(&scenario)?;
            let near = truth(&source, transmission)?;
            let mut block = Block::default();
            source.read(&mut block, usize::MAX)?;
            // The threshold of a search of 36 satellites over 10 kHz with a false-alarm probability of 1e-3.
            let whole = SearchOptions {
                satellites: Sv::all(transmission.sv.constellation()).map(signal::of).collect(),
                ..SearchOptions::default()
            };
            let all = SearchPlan::new(RATE_HZ, whole)?;
            threshold = all.threshold(10);
            let mut options = SearchOptions {
                satellites: vec![transmission],
                doppler_hz: (near.doppler_hz - 250.0, near.doppler_hz + 250.0),
                ..SearchOptions::default()
            };
            let cells = SearchPlan::new(RATE_HZ, options.clone())?.cells();
            options.false_alarm *= cells / all.cells();
            let plan = SearchPlan::new(RATE_HZ, options)?;
            let hits = plan.search(block.channel(0))?;
            let off = |a: &Acquisition| {
                let chips = a.code_phase_chips - near.code_phase_chips;
                (chips + 2046.0).rem_euclid(4092.0) - 2046.0
            };
            found += f64::from(u8::from(hits.iter().any(|a| off(a).abs() < 0.75))) / DRAWS as f64;
        }
        let [least, most] = [-0.5, 0.5].map(|db| expected(cn0_dbhz + db, threshold));
        println!("{cn0_dbhz} dB-Hz: {found:.2} found, {least:.2} to {most:.2} by theory");
        let sigma = |p: f64| 4.0 * (p * (1.0 - p) / DRAWS as f64).sqrt();
        assert!(found > least - sigma(least) && found < most + sigma(most), "{found}");
    }
    Ok(())
}

/// 20 seeds at 33 dB-Hz of E1, started half a chip early and late: all on the main peak after 2 s, and at the end.
#[test]
fn code_loops_leave_the_side_peaks_of_boc() -> Tested {
    let transmission = signal::of("E11".parse()?);
    for seed in 0..20 {
        let scenario = scene(transmission.sv, 33.0, 0.37 * seed as f64, 3.0, seed)?;
        let mut source = ScenarioSource::new(&scenario)?;
        let exact = truth(&source, transmission)?;
        let (mut block, mut buffer) = (Block::default(), SampleBuffer::default());
        source.read(&mut block, usize::MAX)?;
        buffer.push(block.channel(0));
        for off in [-0.5, 0.5] {
            let code_phase_chips = (exact.code_phase_chips + off).rem_euclid(4092.0);
            let start = TrackStart {
                sample: 0,
                acquisition: Acquisition { code_phase_chips, ..exact },
                doppler_rate_hz_s: 0.0,
                carrier_phase: 0.0,
                symbol_edge: None,
            };
            let mut channel = Channel::new(&start, RATE_HZ, TrackingOptions::default());
            for end_s in [2.0, 2.5, 2.99] {
                let end = (end_s * RATE_HZ) as u64;
                let mut held = SampleBuffer::default();
                held.push(&block.channel(0)[..end as usize]);
                channel.process(&held, &mut Vec::new(), &mut Vec::new());
                let epoch = source.truth_at(end);
                let code = channel.code_phase_chips(end) - epoch.satellites[0].code_phase_chips;
                let error = (code + 2046.0).rem_euclid(4092.0) - 2046.0;
                // The loop's own noise is 0.02 chip; the nearest side peak lies at 0.5.
                assert!(error.abs() < 0.15, "seed {seed} from {off}: {error} chips at {end_s} s");
            }
        }
    }
    Ok(())
}

/// At 30 dB-Hz of E1, 2 dB above what I/NAV needs (Eb/N0 of 5 dB is 28), the pilot stays in lock and the ephemeris comes.
#[test]
fn the_pilot_and_inav_hold_at_30_dbhz() -> Tested {
    let transmission = signal::of("E11".parse()?);
    let (scenario, seconds) = (scene(transmission.sv, 30.0, 0.0, 34.0, 3)?, 34.0);
    let mut source = ScenarioSource::new(&scenario)?;
    let acquisition = truth(&source, transmission)?;
    let start = TrackStart {
        sample: 0,
        acquisition,
        doppler_rate_hz_s: 0.0,
        carrier_phase: 0.0,
        symbol_edge: None,
    };
    let mut channel = Channel::new(&start, RATE_HZ, TrackingOptions::default());
    let (mut block, mut buffer) = (Block::default(), SampleBuffer::default());
    let mut decoder = transmission.decoder().ok_or("no decoder")?;
    let mut collector = NavigationCollector::new(2190);
    let (mut symbols, mut pages, mut updates) = (Vec::new(), 0, Vec::new());
    while source.read(&mut block, 400_000)? > 0 {
        buffer.push(block.channel(0));
        channel.process(&buffer, &mut Vec::new(), &mut symbols);
        buffer.discard_before(buffer.end() - 40_000);
        for symbol in symbols.drain(..) {
            if let Some(page) = decoder.push(symbol.value, symbol.first_period / 4) {
                pages += 1;
                updates.extend(collector.add(transmission.sv, &page.content));
            }
        }
        assert_ne!(channel.lock(), LockState::Lost);
    }
    println!("{pages} pages in {seconds} s, {updates:?}");
    let exact = source.truth_at((seconds * RATE_HZ) as u64 - 1).satellites[0].doppler_hz;
    assert!((channel.doppler_hz() - exact).abs() < 3.0, "{} {exact}", channel.doppler_hz());
    // 16 whole pages of 2 s; by the union bound one bit in 10^4 is wrong at Eb/N0 of 5 dB + 2 dB less 1 dB for the phase.
    assert!(pages >= 14, "{pages} pages");
    assert!(updates.contains(&Update::Ephemeris(transmission.sv)));
    Ok(())
}

/// Truth of the Oslo captures.
fn oslo(data: &Path) -> Result<Value, Failed> {
    let text = std::fs::read_to_string(data.join("captures/oslo_gps_gal_truth.json"))?;
    Ok(serde_json::from_str(&text)?)
}

const OSLO: &str = "captures/oslo_gps_gal_4MHz_40s_1bit.bin";
const OSLO_OPTIONS: [&str; 6] = ["-f", "b1", "-r", "4M", "--troposphere", "none"];

#[test]
fn all_17_satellites_of_two_systems_are_acquired_and_no_other() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let truth = &oslo(data)?["oslo_4000k_1bit.bin"]["satellites"];
    let rows = truth.as_array().ok_or("no satellites")?;
    let answer = run(&["acquire", &file(data, OSLO), "-f", "b1", "-r", "4M"])?;
    let mut names: Vec<&str> = rows.iter().filter_map(|row| row["sat"].as_str()).collect();
    names.sort_unstable();
    assert_eq!(answer.satellites(), names);
    for row in rows {
        let sv = row["sat"].as_str().unwrap_or_default();
        let number = |name: &str| row[name].as_f64().unwrap_or(f64::NAN);
        let doppler = answer.acquired(sv, "doppler_hz") - number("doppler_hz");
        let chips = answer.acquired(sv, "code_phase_chips") - number("code_phase_chips");
        assert!(doppler.abs() < 2.0 && chips.abs() < 0.05, "{sv}: {doppler} Hz, {chips} chips");
    }
    Ok(())
}

/// Errors of the fixes, m, 3-D.
fn errors(answer: &Answer, place: &Value) -> Vec<f64> {
    let place = vector(place);
    answer.rows("fixes").iter().map(|fix| (vector(&fix["ecef_m"]) - place).norm()).collect()
}

/// By the truth of the independent simulator: pseudoranges of Galileo are 20 ns, 5.996 m, shorter than on GPS time.
#[test]
fn galileo_alone_and_with_gps_fixes_its_place_and_the_offset_of_its_time() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let place = &oslo(data)?["place"]["ecef_m"];
    for (systems, first_s, most_m) in [("E", 33.0, 1.0), ("G,E", 19.0, 0.5)] {
        let mut arguments = vec!["process"];
        let capture = file(data, OSLO);
        arguments.push(&capture);
        arguments.extend(OSLO_OPTIONS);
        arguments.extend(["--prn", systems]);
        let answer = run(&arguments)?;
        let error = median(errors(&answer, place));
        let first = answer.json["first_fix_s"].as_f64().unwrap_or(f64::NAN);
        println!("{systems}: first fix from {first} s, median error {error:.2} m");
        assert!(first <= first_s && error < most_m, "{systems}: {first} s, {error} m");
        let offsets = answer.rows("fixes").iter().filter_map(|fix| {
            let offset = &fix["system_offsets"][0];
            Some(offset["offset_s"].as_f64()? * 299_792_458.0)
        });
        let offsets: Vec<f64> = offsets.collect();
        if systems != "E" {
            assert!((median(offsets.clone()) + 5.996).abs() < 0.3, "{offsets:?}");
        }
    }
    Ok(())
}

/// Searched by others in numpy, with a false-alarm probability of 1e-15; offsets on a grid of 0.25 us behind a filter.
#[test]
fn satellites_of_real_captures_are_those_that_others_found() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let text = std::fs::read_to_string(data.join("captures/real_other_signals.json"))?;
    let known: Value = serde_json::from_str(&text)?;
    let captures: [(&str, &str, &[&str]); 2] = [
        ("pocketsdr_L1_12MHz_real_s8.bin", "", &["-f", "rs8", "-r", "12M", "--if", "3M"]),
        (
            "pocketsdr_L1_4MHz_iq_cs8.bin",
            " (conjugated)",
            &["-f", "cs8", "-r", "4M", "--conjugate"],
        ),
    ];
    for (name, suffix, options) in captures {
        let path = format!("captures/{name}");
        let pilots = &known[&format!("{path}{suffix}")]["E1C"];
        let rows = pilots.as_object().ok_or("no pilots")?;
        let capture = file(data, &path);
        let mut arguments = vec!["acquire", &capture, "--prn", "E"];
        arguments.extend(options);
        let answer = run(&arguments)?;
        let mut names: Vec<String> = rows.keys().map(|prn| format!("E{prn:0>2}")).collect();
        names.sort();
        assert_eq!(answer.satellites(), names, "{name}");
        for (prn, row) in rows {
            let sv = format!("E{prn:0>2}");
            let number = |name: &str| row[name].as_f64().unwrap_or(f64::NAN);
            let doppler = answer.acquired(&sv, "doppler_hz") - number("doppler_hz");
            let offset_ms = 4.0 - answer.acquired(&sv, "code_phase_chips") / 1023.0;
            let late_us = (offset_ms - number("offset_ms")) * 1e3;
            println!("{name} {sv}: {doppler:+.1} Hz, {late_us:+.2} us");
            // Their Dopplers have a grid of 125 Hz, interpolated; ours come from all of the capture.
            assert!(doppler.abs() < 15.0 && late_us.abs() < 0.45, "{sv}: {doppler} {late_us}");
        }
    }
    Ok(())
}
