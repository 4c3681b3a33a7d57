//! Captures of every kind give the correct samples.

mod common;

use common::{Tested, data};
use num_complex::Complex32;
use proptest::prelude::*;
use sdr_rx::capture::{
    self, BitOrder, Block, Datatype, Encoding, Layout, OpenOptions, SampleSource, SigmfWriter,
    StreamInfo,
};
use sdr_rx::gnss::GpsTime;
use std::path::PathBuf;

fn open(inputs: &[PathBuf], options: OpenOptions) -> Box<dyn SampleSource> {
    capture::open(inputs, &options).unwrap_or_else(|e| panic!("{inputs:?}: {e}"))
}

/// All samples, read in blocks of the given sizes in turn.
fn read_all(source: &mut dyn SampleSource, sizes: &[usize]) -> Vec<Vec<Complex32>> {
    let mut channels = vec![Vec::new(); source.info().channels];
    let mut block = Block::default();
    for size in sizes.iter().cycle() {
        let got = source.read(&mut block, *size).unwrap();
        assert_eq!((block.len(), block.channels()), (got, channels.len()));
        if got > 0 {
            assert_eq!(block.first_sample(), channels[0].len() as u64);
        }
        channels.iter_mut().enumerate().for_each(|(c, all)| all.extend(block.channel(c)));
        if got < *size {
            break;
        }
    }
    channels
}

fn raw(format: &str, rate_hz: f64) -> OpenOptions {
    OpenOptions { format: Some(format.into()), rate_hz: Some(rate_hz), ..OpenOptions::default() }
}

fn complex(re: impl Into<f32>, im: impl Into<f32>) -> Complex32 {
    Complex32::new(re.into(), im.into())
}

fn cs8(bytes: &[u8]) -> Vec<Complex32> {
    bytes.chunks_exact(2).map(|b| complex(b[0] as i8, b[1] as i8)).collect()
}

fn cf32(bytes: &[u8]) -> Vec<Complex32> {
    let number = |b: &[u8]| f32::from_le_bytes(b.try_into().unwrap());
    bytes.chunks_exact(8).map(|b| complex(number(&b[..4]), number(&b[4..]))).collect()
}

/// -1 where the bit is set.
fn sign(word: u32, bit: u32) -> f32 {
    1.0 - 2.0 * (word >> bit & 1) as f32
}

#[test]
fn raw_captures_give_the_samples_of_their_bytes() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    type Decode = fn(&[u8]) -> Vec<Complex32>;
    let one_bit: Decode = |bytes| {
        let pairs = |b: &u8| {
            [7, 5, 3, 1].map(|i| complex(sign(u32::from(*b), i), sign(u32::from(*b), i - 1)))
        };
        bytes.iter().flat_map(pairs).collect()
    };
    let real8: Decode = |bytes| bytes.iter().map(|b| complex(*b as i8, 0.0)).collect();
    let cases: [(&str, &str, f64, f64, u64, Decode); 6] = [
        ("pocketsdr_L1_4MHz_iq_cs8.bin", "cs8", 4e6, 0.0, 2_000_000, cs8),
        ("pocketsdr_L1_12MHz_real_s8.bin", "s8", 12e6, 3e6, 1_200_000, real8),
        ("cttc_L1_4MHz_4ms_cf32.bin", "cf32", 4e6, 0.0, 16_000, cf32),
        ("gnss-sdr_prn1_4MHz_2ms_cf32.bin", "cf32", 4e6, 0.0, 8_000, cf32),
        ("sim_tokyo_2.6MHz_1s_cs8.bin", "cs8", 2.6e6, 0.0, 2_600_000, cs8),
        ("sim_tokyo_2.6MHz_45s_1bit.bin", "b1", 2.6e6, 0.0, 117_000_000, one_bit),
    ];
    for (name, format, rate_hz, if_hz, samples, expected) in cases {
        let path = data.join("captures").join(name);
        let options = OpenOptions { if_hz: Some(if_hz), ..raw(format, rate_hz) };
        for conjugate in [false, true] {
            // 0.1 s from the middle of the file, against a plain decoding of its bytes.
            let options = OpenOptions {
                conjugate,
                start_s: samples as f64 / rate_hz / 2.0,
                duration_s: Some(0.1),
                ..options.clone()
            };
            let whole = OpenOptions { start_s: 0.0, duration_s: None, ..options.clone() };
            let info = open(std::slice::from_ref(&path), whole).info().clone();
            assert_eq!((info.samples, info.rate_hz, info.channels), (Some(samples), rate_hz, 1));
            let expected_if = if info.real && conjugate { -if_hz } else { if_hz };
            assert_eq!((info.if_hz, info.real), (expected_if, format == "s8"));
            let got = read_all(open(std::slice::from_ref(&path), options).as_mut(), &[4096]);
            let bytes = std::fs::read(&path)?;
            let length = (bytes.len() as f64 * 0.1 * rate_hz / samples as f64).ceil() as usize;
            let middle = &bytes[bytes.len() / 2..];
            let mut expected = expected(&middle[..length.min(middle.len())]);
            if conjugate {
                expected.iter_mut().for_each(|x| *x = complex(x.re, -x.im));
            }
            assert!(got[0] == expected, "{name}");
        }
    }
    // As MANIFEST.md states of the Pocket SDR front end.
    let path = data.join("captures/pocketsdr_L1_4MHz_iq_cs8.bin");
    let samples = read_all(open(&[path], raw("cs8", 4e6)).as_mut(), &[4096]);
    let is_level = |v: f32| [-3.0, -1.0, 1.0, 3.0].contains(&v);
    assert!(samples[0].iter().all(|x| is_level(x.re) && is_level(x.im)));
    Ok(())
}

#[test]
fn jrc_metadata_pick_the_bits_of_l1_with_q_inverted() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let folder = data.join("captures");
    let file = folder.join("jrc_L1L2L5_5MHz_1bit.bin");
    let mut source = open(&[folder.join("jrc.sdrx"), file.clone()], OpenOptions::default());
    let info = source.info().clone();
    assert_eq!((info.rate_hz, info.if_hz, info.channels), (5e6, -48_750.0, 1));
    assert_eq!((info.samples, info.real), (Some(524_288), false));
    let notes: Vec<String> = source.notes().iter().map(ToString::to_string).collect();
    assert!(notes.iter().any(|n| n.contains("reading L1 of the streams L1, L2, L5")));
    assert!(notes.iter().any(|n| n.contains("two times of the first sample")));
    let words = std::fs::read(&file)?;
    let words = words.chunks_exact(2).map(|b| u32::from(b[0]) | u32::from(b[1]) << 8);
    let expected: Vec<Complex32> = words.map(|w| complex(sign(w, 15), -sign(w, 14))).collect();
    assert!(read_all(source.as_mut(), &[1000])[0] == expected);
    // The other streams can be chosen by name.
    let l5 = OpenOptions { stream: Some("L5".into()), ..OpenOptions::default() };
    let l5 = open(&[folder.join("jrc.sdrx"), file], l5);
    assert_eq!((l5.info().rate_hz, l5.info().samples), (30e6, Some(6 * 524_288)));
    Ok(())
}

#[test]
fn ifen_metadata_give_two_coherent_channels() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let folder = data.join("captures");
    let files = [0, 1].map(|k| folder.join(format!("ifen_ant{k}_L1_20MHz_2bit.bin")));
    let inputs = [folder.join("ifen.smfx"), files[0].clone(), files[1].clone()];
    let mut source = open(&inputs, OpenOptions::default());
    let info = source.info().clone();
    assert_eq!((info.rate_hz, info.if_hz, info.channels), (20e6, 5_000_445.885_658_34, 2));
    assert_eq!((info.samples, info.real), (Some(838_864), true));
    assert_eq!(info.start_time, Some("2016-01-19T09:00:00Z".parse()?));
    let got = read_all(source.as_mut(), &[20_000]);
    for (channel, file) in got.iter().zip(&files) {
        let codes = std::fs::read(file)?;
        let codes = codes.iter().flat_map(|b| [0, 2, 4, 6].map(|s| usize::from(b >> s & 3)));
        let expected: Vec<Complex32> =
            codes.map(|c| complex([1.0, 3.0, -3.0, -1.0][c], 0.0)).collect();
        assert!(*channel == expected);
    }
    // The same without metadata.
    let options = OpenOptions {
        if_hz: Some(info.if_hz),
        bit_order: Some(BitOrder::LeastFirst),
        encoding: Some(Encoding::TwosComplementAdjusted),
        ..raw("rb2", 20e6)
    };
    assert!(read_all(open(&files, options).as_mut(), &[4093]) == got);
    // One file alone is one channel.
    assert_eq!(open(&inputs[..2], OpenOptions::default()).info().channels, 1);
    Ok(())
}

#[test]
fn four_interleaved_channels_come_apart() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let path = data.join("captures/sim_array4_2MHz_0.5s_cs8.bin");
    let options = OpenOptions { channels: Some(4), ..raw("cs8", 2e6) };
    let mut source = open(std::slice::from_ref(&path), options);
    assert_eq!((source.info().channels, source.info().samples), (4, Some(1_000_000)));
    let got = read_all(source.as_mut(), &[10_007]);
    let expected = cs8(&std::fs::read(&path)?);
    for (c, channel) in got.iter().enumerate() {
        assert!(channel.iter().eq(expected[c..].iter().step_by(4)));
    }
    Ok(())
}

#[test]
fn standard_input_equals_the_file() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let path = data.join("captures/cttc_L1_4MHz_4ms_cf32.bin");
    let run = |input: &str, pipe: bool| {
        let mut command = assert_cmd::Command::cargo_bin("sdr-rx").unwrap();
        command.args(["info", input, "-f", "cf32", "-r", "4M", "--start", "0.001", "--json"]);
        if pipe {
            command.pipe_stdin(&path).unwrap();
        }
        let output = command.assert().success().get_output().stdout.clone();
        serde_json::from_slice::<serde_json::Value>(&output).unwrap()
    };
    let [file, pipe] = [run(path.to_str().ok_or("path")?, false), run("-", true)];
    for key in ["levels", "spectra_db", "looked_at_s", "rate_hz"] {
        assert_eq!(file[key], pipe[key], "{key}");
    }
    assert_eq!(file["levels"][0]["samples"], 12_000);
    Ok(())
}

/// 64 cases; a failure is printed, not stored.
fn config() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(64) }
}

fn info(channels: usize, real: bool) -> StreamInfo {
    StreamInfo {
        rate_hz: 2.6e6,
        if_hz: 1234.5,
        channels,
        real,
        samples: None,
        start_time: Some(GpsTime::from_week_tow(2190, 525_600.000_123_456)),
        format: "cs8".into(),
        array: None,
    }
}

fn block_of(samples: &[Complex32], channels: usize) -> Block {
    let mut block = Block::zeros(channels, samples.len() / channels);
    for c in 0..channels {
        let of_channel = samples.iter().skip(c).step_by(channels);
        block.channel_mut(c).iter_mut().zip(of_channel).for_each(|(b, x)| *b = *x);
    }
    block
}

#[test]
fn sigmf_gives_back_what_was_written() {
    let number = prop_oneof![-200f32..200.0, -1e5f32..1e5];
    proptest!(config(), |(
        numbers in prop::collection::vec((number.clone(), number), 12..200),
        channels in 1usize..4, kind in 0usize..3, real: bool, cut in 0usize..12,
    )| {
        let (datatype, step, limit) = [
            (Datatype::I8, 1.0, 127.0), (Datatype::I16, 1.0, 32_767.0), (Datatype::F32, 0.0, 1e9),
        ][kind];
        let samples: Vec<Complex32> = numbers
            .chunks_exact(channels)
            .flatten()
            .map(|&(i, q)| complex(i, if real { 0.0 } else { q }))
            .collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.sigmf-meta");
        let info = info(channels, real);
        let mut writer = SigmfWriter::create(&path, &info, datatype, "test").unwrap();
        let (a, b) = samples.split_at(cut / channels * channels);
        writer.write(&block_of(a, channels)).unwrap();
        writer.write(&block_of(b, channels)).unwrap();
        let out_of_range = |v: f32| usize::from(v.round_ties_even().abs() > limit);
        let clipped: usize = samples.iter().map(|x| out_of_range(x.re) + out_of_range(x.im)).sum();
        prop_assert_eq!(writer.clipped(), clipped as u64);
        writer.finish().unwrap();
        let mut source = open(&[path], OpenOptions::default());
        let got = source.info().clone();
        prop_assert_eq!((got.rate_hz, got.channels, got.real), (2.6e6, channels, real));
        // A frequency near 1.5 GHz in f64 is good to 2.4e-7 Hz; the time is written in nanoseconds.
        prop_assert!((got.if_hz - info.if_hz).abs() < 1e-6);
        prop_assert!((got.start_time.unwrap() - info.start_time.unwrap()).abs() < 0.6e-9);
        let back = read_all(source.as_mut(), &[7]);
        for (c, channel) in back.iter().enumerate() {
            prop_assert_eq!(channel.len(), samples.len() / channels);
            for (x, y) in samples[c..].iter().step_by(channels).zip(channel) {
                let clip = |v: f32| v.clamp(-limit, limit);
                let bound = step / 2.0;
                prop_assert!((clip(x.re) - y.re).abs() <= bound && (clip(x.im) - y.im).abs() <= bound);
            }
        }
        prop_assert!(source.notes().is_empty(), "{:?}", source.notes());
    });
}

#[test]
fn wav_gives_back_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wav");
    for (bits, kind) in [
        (8, hound::SampleFormat::Int),
        (16, hound::SampleFormat::Int),
        (24, hound::SampleFormat::Int),
        (32, hound::SampleFormat::Int),
        (32, hound::SampleFormat::Float),
    ] {
        for columns in [1, 2, 6] {
            let spec = hound::WavSpec {
                channels: columns,
                sample_rate: 2_600_000,
                bits_per_sample: bits,
                sample_format: kind,
            };
            let value = |k: u16| (i32::from(k * 37 % 251) - 125) * if bits > 8 { 100 } else { 1 };
            let mut writer = hound::WavWriter::create(&path, spec).unwrap();
            for k in 0..60 {
                match kind {
                    hound::SampleFormat::Int => writer.write_sample(value(k)).unwrap(),
                    hound::SampleFormat::Float => writer.write_sample(value(k) as f32).unwrap(),
                }
            }
            writer.finalize().unwrap();
            let options = OpenOptions { if_hz: Some(1e5), ..OpenOptions::default() };
            let mut source = open(std::slice::from_ref(&path), options);
            let info = source.info().clone();
            let channels = usize::from(columns.div_ceil(2));
            assert_eq!((info.rate_hz, info.channels, info.real), (2.6e6, channels, columns == 1));
            // Eight bits of WAV are unsigned with 128 for hound's zero, and ours is 127.5.
            let offset = if bits == 8 { 0.5 } else { 0.0 };
            let got = read_all(source.as_mut(), &[3]);
            for (c, channel) in got.iter().enumerate() {
                assert_eq!(channel.len(), 60 / usize::from(columns));
                for (k, x) in channel.iter().enumerate() {
                    let at = k * usize::from(columns) + 2 * c;
                    let number = |at: usize| value(at as u16) as f32 + offset;
                    let im = if columns == 1 { 0.0 } else { number(at + 1) };
                    assert_eq!(*x, complex(number(at), im), "{bits} bits, {columns} columns");
                }
            }
        }
    }
}

#[test]
fn block_size_and_start_do_not_change_the_samples() {
    proptest!(config(), |(
        bytes in prop::collection::vec(any::<u8>(), 48..400),
        format in prop::sample::select(vec!["b1", "b2", "rb2", "cs8", "cu8", "cs16", "rs16", "rs8"]),
        channels in 1usize..4,
        sizes in prop::collection::vec(1usize..60, 1..6),
        skip in 0u64..4,
        lsb: bool,
    )| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("capture");
        std::fs::write(&path, &bytes).unwrap();
        let options = OpenOptions {
            channels: Some(channels),
            if_hz: Some(100.0),
            bit_order: lsb.then_some(BitOrder::LeastFirst),
            ..raw(format, 1e3)
        };
        let whole = read_all(open(std::slice::from_ref(&path), options.clone()).as_mut(), &[100_000]);
        let source = &mut open(std::slice::from_ref(&path), options.clone());
        prop_assert_eq!(source.info().samples, Some(whole[0].len() as u64));
        prop_assert_eq!(&read_all(source.as_mut(), &sizes), &whole);
        let later = OpenOptions { start_s: skip as f64 * 1e-3, ..options };
        let later = read_all(open(&[path], later).as_mut(), &sizes);
        for (a, b) in later.iter().zip(&whole) {
            prop_assert_eq!(&a[..], &b[skip as usize..]);
        }
    });
}

#[test]
fn planar_interleaved_and_one_file_per_channel_agree() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let channel = |c: u8| (0..20u8).map(|k| 40 * c + k).collect::<Vec<u8>>();
    let channels: Vec<Vec<u8>> = (0..3).map(channel).collect();
    let together: Vec<u8> = (0..10)
        .flat_map(|k| channels.iter().flat_map(move |c| c[2 * k..2 * k + 2].to_vec()))
        .collect();
    let interleaved = file("interleaved.cs8", &together);
    let planar = file("planar.cs8", &channels.concat());
    let files = [0, 1, 2].map(|c| file(&format!("{c}.cs8"), &channels[c]));
    let options = OpenOptions { rate_hz: Some(1e6), ..OpenOptions::default() };
    let three = OpenOptions { channels: Some(3), ..options.clone() };
    let in_planes = OpenOptions { layout: Some(Layout::Planar), ..three.clone() };
    let expected: Vec<Vec<Complex32>> = channels.iter().map(|c| cs8(c)).collect();
    assert_eq!(read_all(open(&[interleaved], three).as_mut(), &[4]), expected);
    assert_eq!(read_all(open(&[planar], in_planes).as_mut(), &[4]), expected);
    assert_eq!(read_all(open(&files, options).as_mut(), &[4]), expected);
}

#[test]
fn an_unfinished_recording_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sigmf-meta");
    let mut writer = SigmfWriter::create(&path, &info(1, false), Datatype::I8, "").unwrap();
    writer.write(&Block::zeros(1, 10)).unwrap();
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Dialects of SigMF: a byte order mark, times with an offset, empty or without a time of day, extensions as an object.
/// The samples are the same.
#[test]
fn dialects_of_sigmf_are_read_and_what_is_no_time_is_told() {
    let Some(data) = std::env::var_os("SDR_RX_DATA").map(std::path::PathBuf::from) else {
        println!("SDR_RX_DATA is not set: files of others are not read");
        return;
    };
    let folder = data.join("cases/17-sigmf-dialects");
    let read = |name: &str| {
        let path = folder.join(format!("{name}.sigmf-meta"));
        let mut source = capture::open(&[path], &OpenOptions::default()).expect(name);
        let mut block = Block::default();
        source.read(&mut block, 1000).expect(name);
        (source.info().start_time, source.notes().len(), block)
    };
    let (time, notes, samples) = read("base");
    assert!(time.is_some() && notes == 0);
    for name in ["bom", "extobj", "dt_offset"] {
        assert_eq!(read(name), (time, 0, samples.clone()), "{name}");
    }
    for name in ["dt_date", "dt_empty"] {
        assert_eq!(read(name), (None, 1, samples.clone()), "{name}");
    }
}
