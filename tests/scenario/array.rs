//! Scenarios of antenna arrays: against closed forms, and against an independent simulator.

use super::correlator::periods;
use super::theory::scenario;
use crate::common::{Failed, Tested, data};
use num_complex::{Complex32, Complex64};
use sdr_rx::capture::{self, Block, Datatype, OpenOptions, SampleSource, SigmfWriter};
use sdr_rx::gnss::Sv;
use sdr_rx::gnss::signal::L1_WAVELENGTH;
use sdr_rx::scenario::{FrontEnd, Scenario, ScenarioSource};
use std::f64::consts::TAU;

fn block(scenario: &Scenario) -> Result<(ScenarioSource, Block), Failed> {
    let mut source = ScenarioSource::new(scenario)?;
    let mut block = Block::default();
    source.read(&mut block, usize::MAX).map_err(|e| e.to_string())?;
    Ok((source, block))
}

fn wide(x: &Complex32) -> Complex64 {
    Complex64::new(x.re.into(), x.im.into())
}

/// Least-squares factor of `b` against `a`, and the mean power of the residual over that of `a`.
fn ratio(a: &[Complex32], b: &[Complex32]) -> (Complex64, f64) {
    let power: f64 = a.iter().map(|x| f64::from(x.norm_sqr())).sum();
    let weight = b.iter().zip(a).map(|(b, a)| wide(b) * wide(a).conj()).sum::<Complex64>() / power;
    let rest = b.iter().zip(a).map(|(b, a)| (wide(b) - weight * wide(a)).norm_sqr());
    (weight, rest.sum::<f64>() / power)
}

fn with_satellites(list: &[&str], rest: &str) -> Scenario {
    let list = list.iter().map(|s| s.parse().expect("a satellite")).collect();
    Scenario { satellites: Some(list), duration_s: 0.02, ..scenario(rest) }
}

#[test]
fn each_element_receives_the_plane_wave_of_the_rotated_array() -> Tested {
    let scenario = with_satellites(
        &["G21"],
        "[array]
        elements_m = [[0.0, 0.0, 0.0], [0.3, -0.1, 0.05], [-0.2, 0.4, 0.1]]
        attitude = { yaw_deg = 30.0, pitch_deg = 20.0, roll_deg = -50.0 }
        errors = { gain_db = [0.0, 1.0, -2.0], phase_deg = [10.0, -20.0, 30.0] }
        [noise]
        enabled = false
        [front_end]
        rate_hz = 2e6",
    );
    let (source, block) = block(&scenario)?;
    let truth = &source.truth_at(20_000).satellites[0];
    let (sa, ca) = truth.azimuth_deg.to_radians().sin_cos();
    let (se, ce) = truth.elevation_deg.to_radians().sin_cos();
    // Into the platform: undo yaw (about up), then pitch (about right), then roll (about forward).
    let turned = |angle: f64, x: f64, y: f64| {
        let (s, c) = angle.to_radians().sin_cos();
        (c * x + s * y, c * y - s * x)
    };
    let (forward, right) = turned(30.0, ce * ca, ce * sa);
    let (forward, up) = turned(20.0, forward, se);
    let (right, up) = turned(50.0, right, up);
    let cosines = truth.arrival.ok_or("no arrival in the truth")?.direction_cosines;
    for (a, b) in cosines.iter().zip([right, forward, up]) {
        assert!((a - b).abs() < 1e-12, "{cosines:?} {right} {forward} {up}");
    }
    let phase = |[e, n, u]: [f64; 3]| TAU * (e * right + n * forward + u * up) / L1_WAVELENGTH;
    for (channel, position, gain, error) in
        [(1, [0.3, -0.1, 0.05], 1.0, -30.0f64), (2, [-0.2, 0.4, 0.1], -2.0, 20.0)]
    {
        let expected =
            Complex64::from_polar(10f64.powf(gain / 20.0), phase(position) + error.to_radians());
        let (weight, rest) = ratio(block.channel(0), block.channel(channel));
        // The phasor's single precision: 8e-6 rad at the end of a segment (`mix_add`). Directions turn by
        // 2e-4 rad/s x 0.45 m = 3 rad/s x 1e-3 in phase: 3e-6 rad over a segment.
        assert!((weight - expected).norm() < 1e-5, "channel {channel}: {weight} {expected}");
        assert!(rest < 1e-10, "channel {channel}: {rest}");
    }
    // Power of one signal at an element without gain: C/N0 over the rate.
    let power: f64 = block.channel(0).iter().map(|x| f64::from(x.norm_sqr())).sum::<f64>() / 4e4;
    assert!((power / (10f64.powf(4.5) / 2e6) - 1.0).abs() < 1e-5, "{power}");
    Ok(())
}

#[test]
fn threads_change_nothing_and_the_origin_receives_as_a_single_antenna() -> Tested {
    let front_end = "[noise]\nimpulse_share = 0.1\nimpulse_variance_ratio = 50.0\n\
                     [front_end]\nrate_hz = 2e6\nbandwidth_hz = 1.8e6\nbits = 8";
    let array = with_satellites(
        &["G17", "G21"],
        &format!("[array]\nlinear = {{ count = 5 }}\n{front_end}"),
    );
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        pool.install(|| block(&array))
    };
    let (one, three) = (run(1)?.1, run(3)?.1);
    assert!(one == three);
    // Response 1 of an element at the origin; other elements draw other noise.
    let single = block(&with_satellites(&["G17", "G21"], front_end))?.1;
    assert!(one.channel(0) == single.channel(0));
    let same = one.channel(0).iter().zip(one.channel(1)).filter(|(a, b)| a == b).count();
    // Two independent 8-bit samples of 32 steps rms agree in 1 / (2 sqrt(pi) 32) of cases for each of I and Q.
    assert!(same < 40, "{same}");
    Ok(())
}

#[test]
fn a_custom_front_end_is_given_the_index_of_its_element() -> Tested {
    struct Number;
    impl FrontEnd for Number {
        fn delay(&self) -> usize {
            0
        }
        fn process(&mut self, channel: usize, samples: &mut [Complex32]) {
            samples.fill(Complex32::new(channel as f32, 0.0));
        }
    }
    let scenario =
        with_satellites(&["G21"], "[array]\nlinear = { count = 3 }\n[front_end]\nrate_hz = 2e6");
    let mut source = ScenarioSource::with_front_end(&scenario, Box::new(Number))?;
    let mut block = Block::default();
    source.read(&mut block, 1000).map_err(|e| e.to_string())?;
    assert_eq!((block.channels(), block.len()), (3, 1000));
    for channel in 0..3 {
        assert!(block.channel(channel).iter().all(|x| x.re == channel as f32));
    }
    Ok(())
}

#[test]
fn impulses_are_at_single_or_all_elements_as_specified() -> Tested {
    for common in [0.0, 0.5, 1.0] {
        let mut scenario = with_satellites(
            &["G21"],
            &format!(
                "[array]\nlinear = {{ count = 2 }}\n[signal]\ncn0_dbhz = 0.0\n[noise]\nimpulse_share = 0.1\n\
                 impulse_variance_ratio = 1e6\nimpulse_common_share = {common}\n[front_end]\nrate_hz = 2e6"
            ),
        );
        scenario.duration_s = 0.1;
        let (_, block) = block(&scenario)?;
        let n = block.len() as f64;
        // Background exceeds 16 in e^-16 of cases, impulses fall short in 1.6e-5: both below the bounds.
        let strikes = |c: usize| block.channel(c).iter().map(|x| x.norm_sqr() > 16.0);
        let [first, second] = [0, 1].map(|c| strikes(c).filter(|&s| s).count() as f64 / n);
        let both = strikes(0).zip(strikes(1)).filter(|&(a, b)| a && b).count() as f64 / n;
        let (together, own) = (0.1 * common, (0.1 - 0.1 * common) / (1.0 - 0.1 * common));
        let expected = together + (1.0 - together) * own * own;
        let bound = |p: f64| 5.0 * (p * (1.0 - p) / n).sqrt() + 2e-5;
        assert!((first - 0.1).abs() < bound(0.1) && (second - 0.1).abs() < bound(0.1));
        assert!((both - expected).abs() < bound(expected), "{common}: {both} {expected}");
        // Common impulses have independent values.
        let (weight, _) = ratio(block.channel(0), block.channel(1));
        assert!(weight.norm() < 5.0 / (n * expected).sqrt(), "{common}: {weight}");
    }
    Ok(())
}

#[test]
fn jammers_have_the_power_frequency_time_and_direction_specified() -> Tested {
    let rate = 2e6;
    let with = |jammer: &str| {
        block(&with_satellites(
            &["G21"],
            &format!(
                "[array]\nlinear = {{ count = 3 }}\n[signal]\ncn0_dbhz = 0.0\n\
                 [noise]\nenabled = false\nbackground_variance = 4.0\n\
                 [[jammer]]\n{jammer}\n[front_end]\nrate_hz = {rate}"
            ),
        ))
    };
    let power =
        |x: &[Complex32]| x.iter().map(|x| f64::from(x.norm_sqr())).sum::<f64>() / x.len() as f64;
    // Cycles per sample between neighbours.
    let frequency =
        |x: &[Complex32], k: usize| (wide(&x[k + 1]) * wide(&x[k]).conj()).arg() / TAU * rate;

    // A tone: 30 dB over a variance of 4; the satellite lies 63 dB below the background.
    let (source, tone) = with(
        "kind = \"cw\"\npower_db = 30.0\nfrequency_hz = -123456.7\ndirection.cone_deg = 25.0\n\
         start_s = 0.004\nstop_s = 0.015",
    )?;
    let x = tone.channel(2);
    assert!(power(&x[..8000]) < 1e-5 && power(&x[30_000..]) < 1e-5);
    // Amplitude of the satellite over the jammer's: 2^-0.5 x 10^-(63 + 30)/20 = 2e-5, twice in power.
    assert!((power(&x[8000..30_000]) / 4000.0 - 1.0).abs() < 1e-4);
    let turns = (wide(&x[29_999]) * wide(&x[8000]).conj()).arg() / TAU;
    let expected = -123_456.7 * 21_999.0 / rate;
    assert!(((turns - expected + 0.5).rem_euclid(1.0) - 0.5).abs() < 1e-4);
    let (weight, _) = ratio(tone.channel(0), x);
    let expected = Complex64::cis(TAU * 25f64.to_radians().sin());
    assert!((weight - expected).norm() < 1e-4, "{weight} {expected}");
    let truth = &source.truth().jammers[0];
    let angle = truth.arrival.and_then(|a| a.array_angle_deg).ok_or("no angle in the truth")?;
    assert!((angle - 25.0).abs() < 1e-9);
    // The array lies east-west: the cone's direction before it is azimuth 25.
    assert!((truth.azimuth_deg - 25.0).abs() < 1e-9 && truth.elevation_deg.abs() < 1e-9);

    // A chirp of 1 MHz about 200 kHz in 0.5 ms: frequency f + sweep (x - 1/2) at the middle between samples.
    let (_, chirp) = with(
        "kind = \"chirp\"\npower_db = 20.0\nfrequency_hz = 2e5\nsweep_hz = 1e6\nperiod_s = 5e-4\n\
         direction.sky = { azimuth_deg = 90.0, elevation_deg = 60.0 }",
    )?;
    let x = chirp.channel(1);
    assert!((power(x) / 400.0 - 1.0).abs() < 1e-4);
    for k in [0, 100, 499, 998, 1000, 12_345, 39_998] {
        let fraction = ((k as f64 + 0.5) / 1000.0).fract();
        let expected = 2e5 + 1e6 * (fraction - 0.5);
        // Roundings of 6e-8 and a satellite of 6e-5 of the amplitude: 1e-4 rad / 2 pi x 2 MHz = 32 Hz.
        assert!((frequency(x, k) - expected).abs() < 50.0, "{k}: {} {expected}", frequency(x, k));
    }
    // Azimuth 90, elevation 60: the cosine along east is 1/2.
    let (weight, _) = ratio(chirp.channel(0), x);
    assert!((weight - Complex64::cis(TAU / 4.0)).norm() < 1e-3, "{weight}");

    let (_, noise) = with("kind = \"noise\"\npower_db = 50.0\ndirection.cone_deg = -90.0")?;
    // Standard deviation of the mean of 40 000 exponential powers: 1 / 200.
    assert!((power(noise.channel(0)) / 4e5 - 1.0).abs() < 0.025);
    let (weight, rest) = ratio(noise.channel(0), noise.channel(1));
    assert!((weight + 1.0).norm() < 1e-4 && rest < 1e-8, "{weight} {rest}");
    Ok(())
}

#[test]
fn a_spoofer_sends_its_satellites_from_one_direction() -> Tested {
    let run = |satellites: &[&str], sent: &str| {
        block(&with_satellites(
            satellites,
            &format!(
                "[array]\nrectangular = {{ columns = 2, rows = 2 }}\n[noise]\nenabled = false\n\
                 [spoofer]\n{sent}\ndirection.sky = {{ azimuth_deg = 30.0, elevation_deg = 60.0 }}\n\
                 [front_end]\nrate_hz = 2e6"
            ),
        ))
    };
    // Cosines: east 1/4, north sqrt(3)/4; half a wavelength makes pi of each.
    let expected = [0.25, 3f64.sqrt() / 4.0, 0.25 + 3f64.sqrt() / 4.0];
    let (source, all) = run(&["G17", "G21"], "")?;
    for (channel, expected) in expected.iter().enumerate() {
        let (weight, rest) = ratio(all.channel(0), all.channel(channel + 1));
        assert!((weight - Complex64::cis(TAU / 2.0 * expected)).norm() < 1e-5 && rest < 1e-10);
    }
    let satellites = source.truth_at(0).satellites;
    assert!(satellites.iter().all(|s| s.spoofed));
    let cosines = satellites[0].arrival.ok_or("no arrival")?.direction_cosines;
    assert!((cosines[0] - 0.25).abs() < 1e-12 && (cosines[1] - expected[1]).abs() < 1e-12);
    // Of two, one: a single wave no longer explains the other channels, and ranges are as they were.
    let (some, mixed) = run(&["G17", "G21"], "satellites = [\"G17\"]")?;
    assert!(ratio(mixed.channel(0), mixed.channel(1)).1 > 0.01);
    assert!(mixed.channel(0) == all.channel(0));
    assert!(some.truth_at(0).satellites.iter().map(|s| s.spoofed).eq([true, false]));
    Ok(())
}

#[test]
fn an_array_survives_its_sigmf_metadata() -> Tested {
    let scenario = with_satellites(
        &["G21"],
        "[array]
        circular = { count = 3, radius_wavelengths = 0.4 }
        attitude = { yaw_deg = 200.0, pitch_deg = -15.0, roll_deg = 3.0 }
        errors = { gain_rms_db = 1.0, phase_rms_deg = 10.0 }
        calibration = { gain_db = [0.0, 1.0, -1.0], phase_deg = [0.0, 45.0, -45.0] }
        [front_end]
        rate_hz = 2e6
        bits = 8",
    );
    let (source, block) = block(&scenario)?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("a.sigmf-meta");
    let mut writer = SigmfWriter::create(&path, source.info(), Datatype::I8, "array")?;
    writer.write(&block)?;
    writer.finish()?;
    let text = std::fs::read_to_string(&path)?;
    assert!(text.contains("spatial:element_geometry") && text.contains("aperture_bearing"));
    let read = capture::open(&[path], &OpenOptions::default())?.info().array.clone();
    let (read, given) = (read.ok_or("no array")?, scenario.array.ok_or("no array")?);
    // A receiver is not given the errors; the rest it is, to the digits of JSON.
    assert!(read.errors.iter().all(|e| *e == Complex64::ONE));
    assert_eq!(read.attitude, given.attitude);
    let pairs = read.array.elements_m.iter().zip(&given.array.elements_m);
    assert!(read.len() == 3 && pairs.into_iter().all(|(a, b)| (a - b).norm() < 1e-15));
    let weights = read.calibration.iter().flatten().zip(given.calibration.iter().flatten());
    assert!(weights.count() == 3);
    assert_eq!(read.calibration, given.calibration);
    Ok(())
}

/// The form of the extension: a file for each channel, X along the boresight and Y to its left.
#[test]
fn files_of_one_channel_each_make_the_array() -> Tested {
    let folder = tempfile::tempdir()?;
    let mut paths = Vec::new();
    for (index, y, phase) in [(0, 0.3, 0.0), (1, -0.3, 90.0)] {
        let path = folder.path().join(format!("{index}.sigmf-meta"));
        std::fs::write(
            &path,
            format!(
                r#"{{"global": {{"core:datatype": "ci8", "core:sample_rate": 2e6, "core:version": "1.2.5",
                    "spatial:num_elements": 2, "spatial:channel_index": {index}}},
                  "captures": [{{"core:sample_start": 0, "core:frequency": 1575.42e6,
                    "spatial:aperture_azimuth": 270.0, "spatial:phase_offset": {phase},
                    "spatial:element_geometry": [{{"point": [0, {y}, 0]}}]}}], "annotations": []}}"#
            ),
        )?;
        std::fs::write(path.with_extension("sigmf-data"), [1, 2, 3, 4])?;
        paths.push(path);
    }
    let source = capture::open(&paths, &OpenOptions::default())?;
    let array = source.info().array.clone().ok_or("no array")?;
    // The boresight is west: left, where the first element is, is south.
    let elements = array.in_enu().elements_m;
    assert!((elements[0].y + 0.3).abs() < 1e-12 && (elements[1].y - 0.3).abs() < 1e-12);
    assert!(elements.iter().all(|p| p.x.abs() < 1e-12 && p.z.abs() < 1e-12));
    let weights = array.calibration.ok_or("no calibration")?;
    assert!((weights[0] - 1.0).norm() < 1e-15 && (weights[1] + Complex64::I).norm() < 1e-15);
    // A list that is neither this file's element nor holds it.
    let text = std::fs::read_to_string(&paths[1])?;
    std::fs::write(&paths[1], text.replace("[{\"point\": [0, -0.3, 0]}]", "[]"))?;
    let error = capture::open(&paths, &OpenOptions::default()).err().ok_or("accepted")?.to_string();
    assert!(error.contains("spatial:element_geometry: 0 elements"), "{error}");
    Ok(())
}

#[test]
fn directions_and_phases_agree_with_the_independent_simulator() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let folder = data.join("captures");
    let text = std::fs::read(folder.join("sim_array4_2MHz_0.5s_cs8.json"))?;
    let json: serde_json::Value = serde_json::from_slice(&text)?;
    let theirs = json["satellites"].as_object().ok_or("no satellites")?;
    let prns: Vec<String> = theirs.keys().map(|prn| format!("\"G{prn:0>2}\"")).collect();
    let scenario = Scenario::parse(
        &format!(
            r#"
            start = "2190:{}"
            duration_s = 0.5
            orbits.navigation_file = '{}'
            satellites = [{}]
            receiver.position.geodetic = {{ latitude_deg = {}, longitude_deg = {}, height_m = {} }}
            array.elements_m = {}
            atmosphere.ionosphere = "klobuchar"
            noise.enabled = false
            front_end.rate_hz = 2e6
            "#,
            json["gps_tow_first_sample_s"],
            data.join("nav/brdc0010.22n").display(),
            prns.join(", "),
            json["site_lat_lon_h"][0],
            json["site_lat_lon_h"][1],
            json["site_lat_lon_h"][2],
            json["elements_enu_m"],
        ),
        "array4",
    )?;
    let mut source = ScenarioSource::new(&scenario)?;
    for satellite in source.truth_at(0).satellites {
        let expected = &theirs[&satellite.sv.prn().to_string()];
        let value = |key: &str| expected[key].as_f64().unwrap_or(f64::NAN);
        let azimuth = (satellite.azimuth_deg - value("az") + 180.0).rem_euclid(360.0) - 180.0;
        let elevation = satellite.elevation_deg - value("el");
        assert!(azimuth.abs() < 0.01 && elevation.abs() < 0.01, "{}", satellite.sv);
    }
    let mut ours = Block::default();
    source.read(&mut ours, usize::MAX).map_err(|e| e.to_string())?;
    let inputs = [folder.join("sim_array4_2MHz_0.5s_cs8.bin")];
    let options = OpenOptions {
        format: Some("cs8".into()),
        rate_hz: Some(2e6),
        channels: Some(4),
        ..OpenOptions::default()
    };
    let mut theirs = Block::default();
    let mut input = capture::open(&inputs, &options)?;
    input.read(&mut theirs, 1_000_000).map_err(|e| e.to_string())?;
    for sv in ["G09", "G17", "G14"] {
        let sv: Sv = sv.parse()?;
        let phases = |block: &Block| -> [f64; 3] {
            let prompts: Vec<Vec<Complex64>> = (0..4)
                .map(|c| periods(&source, block.channel(c), 2e6, sv))
                .map(|list| list.iter().map(|p| p.prompt).collect())
                .collect();
            [1, 2, 3].map(|c| {
                let pairs = prompts[c].iter().zip(&prompts[0]);
                pairs.map(|(x, first)| x * first.conj()).sum::<Complex64>().arg()
            })
        };
        for (channel, (a, b)) in phases(&ours).iter().zip(phases(&theirs)).enumerate() {
            let difference = (a - b + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
            // 45 dB-Hz: 15 dB a period in each of two channels, 480 periods: sqrt(10^-1.5 / 480) = 0.008 rad.
            assert!(difference.abs() < 0.04, "{sv}, channel {}: {difference} rad", channel + 1);
        }
    }
    Ok(())
}
