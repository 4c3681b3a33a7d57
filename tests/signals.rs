//! Signals other than GPS L1 C/A through the ordinary stages: search, tracking, message.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use sdr_rx::acquisition::{Acquisition, Refined, Refiner, SearchOptions, SearchPlan};
use sdr_rx::capture::{self, Block, OpenOptions, SampleSource};
use sdr_rx::correlator::{CodeTable, SampleBuffer};
use sdr_rx::front_end::Conditioner;
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::gnss::message::sbas::{self, SbasContent, SbasMessage};
use sdr_rx::gnss::message::{Content, NavigationCollector, Page, Update};
use sdr_rx::gnss::orbit::broadcast::sample_ephemeris;
use sdr_rx::gnss::{Ephemeris, GpsTime, NavigationData, Sv, Transmission, signal};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use sdr_rx::tracking::{Channel, LockState, TrackStart, TrackingOptions};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

type Failure = Box<dyn std::error::Error + Send + Sync>;

const RATE_HZ: f64 = 2.048e6;

/// Searches, refines and tracks a satellite, and reads its message.
fn receive(
    samples: &[num_complex::Complex32],
    transmission: Transmission,
) -> Result<(Channel, Vec<Page>), Failure> {
    let options = SearchOptions {
        satellites: vec![transmission],
        coherent_ms: 1,
        max_windows: 20,
        ..SearchOptions::default()
    };
    let found = SearchPlan::new(RATE_HZ, options)?.search(samples)?;
    let coarse = found.first().ok_or("the search finds nothing")?;
    let mut buffer = SampleBuffer::default();
    buffer.push(samples);
    let table = CodeTable::new(transmission, RATE_HZ);
    let refined = Refiner::new(&buffer, RATE_HZ, 0, (0.5 * RATE_HZ) as u64)
        .refine(coarse, &table, 500.0)
        .ok_or("too short to refine")?;
    let start = TrackStart::from_refined(&refined, 0);
    let mut channel = Channel::new(&start, RATE_HZ, TrackingOptions::default());
    let mut symbols = Vec::new();
    channel.process(&buffer, &mut Vec::new(), &mut symbols);
    let mut decoder = transmission.decoder().ok_or("a pilot has no message")?;
    let cycle = transmission.timing().cycle as u64;
    let pages = symbols.iter().filter_map(|s| decoder.push(s.value, s.first_period / cycle));
    let pages = pages.collect();
    Ok((channel, pages))
}

/// Messages of types 63, 9, 1, 25, 63 and 63, with the preambles in their turn.
fn messages() -> Result<Vec<SbasMessage>, sbas::OutOfRange> {
    let navigation = sbas::GeoNavigation {
        t0_s: 68_752.0,
        position_m: [36e6, 21e6, 0.0],
        velocity_m_s: [1.25, -2.5, 0.04],
        ..Default::default()
    };
    let mask = sbas::PrnMask { slots: (1..=32).collect(), iodp: 2 };
    let long_term = sbas::LongTermHalf {
        corrections: vec![
            sbas::LongTermCorrection {
                satellite: 7,
                iode: 39,
                position_m: [-1.125, 0.875, 0.25],
                ..Default::default()
            };
            2
        ],
        iodp: 2,
    };
    let bodies = [
        (63, SbasContent::Null(sbas::RawData::default())),
        (9, SbasContent::GeoNavigation(navigation)),
        (1, SbasContent::PrnMask(mask)),
        (25, SbasContent::LongTerm([long_term.clone(), long_term])),
        (63, SbasContent::Null(sbas::RawData::default())),
        (63, SbasContent::Null(sbas::RawData::default())),
    ];
    let message = |(k, (kind, content)): (usize, (u8, SbasContent))| SbasMessage {
        kind,
        preamble: (k % 3) as u8,
        content,
    };
    Ok(bodies.into_iter().enumerate().map(message).collect())
}

/// A satellite of SBAS at 42 dB-Hz, 13 dB above what its message needs (Eb/N0 of 5 dB is 29 dB-Hz), from the middle of
/// a message and of a symbol on: all whole messages are read, and the orbit and corrections are kept.
#[test]
fn messages_of_sbas_come_through_search_tracking_and_decoder() -> Result<(), Failure> {
    const DOPPLER_HZ: f64 = -1234.0;
    const CN0_DBHZ: f64 = 42.0;
    let sv: Sv = "S36".parse()?;
    let transmission = signal::of(sv);
    let sent = messages()?;
    let bits = sent.iter().map(SbasMessage::encode).collect::<Result<Vec<_>, _>>()?;
    let symbols = sbas::encode(&bits);
    let (code, clock) = (transmission.code(), transmission.clock(DOPPLER_HZ));
    let (delay_s, cycle) = (0.3e-3, transmission.timing().cycle as i64);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let amplitude = (10f64.powf(CN0_DBHZ / 10.0) / RATE_HZ).sqrt();
    let samples: Vec<_> = (0..(4.5 * RATE_HZ) as usize)
        .map(|n| {
            let t = n as f64 / RATE_HZ;
            let chips = (t - delay_s) * clock.chip_rate_hz;
            let period = (chips / clock.chips).floor() as i64;
            let chip = f64::from(code[(chips - period as f64 * clock.chips) as usize]);
            // The first period is the second of a symbol; the first message has 100 symbols left.
            let at = 400 + (period + 1).div_euclid(cycle);
            let symbol = symbols[at as usize];
            let signal = num_complex::Complex64::cis(TAU * DOPPLER_HZ * t)
                * (amplitude * chip * f64::from(symbol));
            let mut noise = || rng.sample::<f64, _>(StandardNormal) * 0.5f64.sqrt();
            num_complex::Complex32::new((signal.re + noise()) as f32, (signal.im + noise()) as f32)
        })
        .collect();
    let (channel, pages) = receive(&samples, transmission)?;
    assert_eq!(channel.lock(), LockState::Locked);
    // 4500 pairs of periods: relative standard deviation of S/N sqrt((1 + 2 S/N) / N) / (S/N) = 0.5 %, five of
    // them and 1 % of
    // sampling loss (chips of 2 samples).
    assert!((channel.cn0_dbhz().ok_or("no C/N0")? - CN0_DBHZ).abs() < 0.5);
    assert!((channel.doppler_hz() - DOPPLER_HZ).abs() < 5.0 * channel.doppler_sigma_hz());
    let read: Vec<Content> = pages.iter().map(|p| p.content.clone()).collect();
    assert_eq!(
        read,
        sent[1..5].iter().cloned().map(|m| Content::Sbas(Box::new(m))).collect::<Vec<_>>()
    );
    let mut collector = NavigationCollector::default();
    let updates: Vec<_> = read.iter().filter_map(|c| collector.add(sv, c)).collect();
    assert_eq!(updates, [9, 1, 25, 63].map(|kind| Update::Sbas(sv, kind)));
    assert_eq!(collector.sbas(sv).map(|m| m.kind).collect::<Vec<_>>(), [1, 9, 25, 63]);
    Ok(())
}

/// A satellite in an orbit as QZS-2's (e 0.075, 42 164 km, 41 degrees), with the health word that it sends, in an
/// ordinary scenario over Tokyo.
#[test]
fn an_ephemeris_of_qzss_comes_through_an_ordinary_scenario() -> Result<(), Failure> {
    let sv: Sv = "J02".parse()?;
    // On a frame's start, near apogee: at the north end of the eight, over 139 degrees east.
    let start = GpsTime::from_week_tow(2190, 525_600.0);
    let sent = Ephemeris {
        sv,
        health: 1,
        toe: start,
        toc: start,
        sqrt_a: 42.164e6f64.sqrt(),
        e: 0.075,
        i0: 41f64.to_radians(),
        omega: -90f64.to_radians(),
        m0: 180f64.to_radians(),
        // The node is a quarter of a turn east of the apogee.
        omega0: (139.0 - 90f64).to_radians() + 7.292_115_146_7e-5 * start.tow(),
        ..sample_ephemeris()
    };
    let wrapped = (sent.omega0 + std::f64::consts::PI).rem_euclid(TAU) - std::f64::consts::PI;
    let sent = Ephemeris { omega0: wrapped, ..sent };
    let mut data = NavigationData::default();
    data.insert(sent.clone());
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("qzss.rnx");
    std::fs::write(&file, rinex_nav::write(&data))?;
    let text = format!(
        "start = \"2190:525600\"\nduration_s = 20.0\nsatellites = [\"J02\"]\norbits.navigation_file = {:?}\n\
         receiver.position.geodetic = {{ latitude_deg = 35.68, longitude_deg = 139.69, height_m = 40.0 }}\n\
         signal.cn0_dbhz = 45.0\nfront_end = {{ rate_hz = {RATE_HZ}, bits = 2 }}\n",
        file.display().to_string()
    );
    let mut source = ScenarioSource::new(&Scenario::parse(&text, "qzss.toml")?)?;
    let truth = source.truth_at(0).satellites.remove(0);
    assert!(truth.elevation_deg > 60.0, "{truth:?}");
    let mut block = Block::default();
    source.read(&mut block, (20.0 * RATE_HZ) as usize)?;
    let (channel, pages) = receive(block.channel(0), signal::of(sv))?;
    assert_eq!(channel.lock(), LockState::Locked);
    let mut collector = NavigationCollector::new(start.week());
    for page in &pages {
        collector.add(sv, &page.content);
    }
    let read =
        collector.data().iter().next().ok_or(format!("{} pages, no ephemeris", pages.len()))?;
    // What the file's twelve digits and the message's fields leave (0.02 m, a fifth of it by either).
    let off_m = (read.state(start).position_m - sent.state(start).position_m).norm();
    assert!(off_m < 0.1, "{off_m} m");
    assert_eq!((read.sv, read.health, read.toe), (sv, 1, start));
    assert!(collector.data().orbit(sv, start).is_ok(), "a health word of 1 is good");
    Ok(())
}

/// Satellites in a capture by an independent search (`captures/real_other_signals.json`).
#[derive(serde::Deserialize)]
struct Known {
    offset_ms: f64,
    doppler_hz: f64,
    cn0_component_dbhz: f64,
}

/// Every SBAS and QZSS satellite that an independent search finds in a real capture is found at the same code
/// phase and Doppler.
#[test]
fn satellites_of_sbas_and_qzss_in_real_captures_are_found_and_refined() -> Result<(), Failure> {
    let Some(folder) = std::env::var_os("SDR_RX_DATA") else {
        println!("skipped: SDR_RX_DATA names no folder of captures");
        return Ok(());
    };
    let captures = Path::new(&folder).join("captures");
    let text = std::fs::read_to_string(captures.join("real_other_signals.json"))?;
    let all: serde_json::Value = serde_json::from_str(&text)?;
    let real = |format: &str, rate_hz, if_hz, conjugate| OpenOptions {
        format: Some(format.to_owned()),
        rate_hz: Some(rate_hz),
        if_hz: Some(if_hz),
        conjugate,
        ..OpenOptions::default()
    };
    for (file, key, options, decimation) in [
        ("pocketsdr_L1_4MHz_iq_cs8.bin", " (conjugated)", real("cs8", 4e6, 0.0, true), 1),
        ("pocketsdr_L1_12MHz_real_s8.bin", "", real("rs8", 12e6, 3e6, false), 3),
    ] {
        let known = &all[format!("captures/{file}{key}")]["L1CA"];
        let known: BTreeMap<u8, Known> = serde_json::from_value(known.clone())?;
        let satellites =
            known.keys().filter_map(|&prn| Sv::from_prn(prn)).map(signal::of).collect();
        let mut source = capture::open(&[captures.join(file)], &options)?;
        let found = acquire(&mut *source, decimation, satellites)?;
        assert_eq!(found.len(), known.len(), "{file}");
        for a in found.iter().map(|r| r.acquisition) {
            let Known { offset_ms, doppler_hz, cn0_component_dbhz } = known[&a.sv().prn()];
            let late_us = ((a.code_offset_s() * 1e3 - offset_ms + 0.5).rem_euclid(1.0) - 0.5) * 1e3;
            let (hz, db) = (a.doppler_hz - doppler_hz, a.cn0_dbhz - cn0_component_dbhz);
            println!("{file}: {} {late_us:+.2} us {hz:+.0} Hz {db:+.1} dB", a.sv());
            // Theirs is the best cell of a grid: 0.25 us, a mean of two Dopplers up to 63 Hz apart, and a C/N0 that
            // loses up to 2.5 dB by a quarter of a chip and 0.9 dB by half a bin, give or take 0.5 dB of noise.
            assert!(late_us.abs() < 0.5 && hz.abs() < 32.0, "{}: {late_us} us, {hz} Hz", a.sv());
            assert!((-1.0..3.9).contains(&db), "{}: {db} dB", a.sv());
        }
    }
    Ok(())
}

/// Satellites in 80 ms, in sums of one code period (symbols of 2 ms allow no more), refined.
fn acquire(
    source: &mut dyn SampleSource,
    decimation: usize,
    satellites: Vec<Transmission>,
) -> Result<Vec<Refined>, Failure> {
    let mut conditioner = Conditioner::new(source.info(), decimation);
    let (mut raw, mut block) = (Block::default(), Block::default());
    source.read(&mut raw, (0.081 * source.info().rate_hz) as usize)?;
    conditioner.process(&raw, &mut block);
    let rate_hz = conditioner.info().rate_hz;
    let (coherent_ms, max_windows) = (1, 80);
    let options =
        SearchOptions { satellites, coherent_ms, max_windows, ..SearchOptions::default() };
    let found = SearchPlan::new(rate_hz, options)?.search(block.channel(0))?;
    let mut buffer = SampleBuffer::default();
    buffer.push(block.channel(0));
    let refiner = Refiner::new(&buffer, rate_hz, 0, buffer.end());
    let refine = |a: &Acquisition| {
        refiner.refine(a, &CodeTable::new(a.transmission, rate_hz), 300.0).ok_or("too short".into())
    };
    found.iter().map(refine).collect()
}
