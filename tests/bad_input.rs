//! Errors in captures and options: each message names the error and what is valid.

use sdr_rx::capture::{self, Block, Datatype, Layout, OpenOptions, SigmfWriter, StreamInfo};
use std::path::PathBuf;

/// A folder with files of the given names and contents.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new(files: &[(&str, &[u8])]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in files {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        Self(folder)
    }

    fn paths(&self, names: &[&str]) -> Vec<PathBuf> {
        let path = |n: &&str| if **n == *"-" { PathBuf::from("-") } else { self.0.path().join(n) };
        names.iter().map(path).collect()
    }

    /// The message with which opening fails, which must name all of `parts`.
    fn refused(&self, names: &[&str], options: OpenOptions, parts: &[&str]) {
        let Err(error) = capture::open(&self.paths(names), &options) else {
            panic!("{names:?} was opened, and should fail with {parts:?}");
        };
        let message = error.to_string();
        assert!(!message.contains('\n'), "one line: {message}");
        for part in parts {
            assert!(message.contains(part), "'{part}' is not in: {message}");
        }
    }

    /// Opens, reads all, and gives the number of samples; the notes must name all of `parts`.
    fn warned(&self, names: &[&str], options: OpenOptions, parts: &[&str]) -> usize {
        let mut source = capture::open(&self.paths(names), &options).unwrap();
        let (mut block, mut total) = (Block::default(), 0);
        loop {
            match source.read(&mut block, 64).unwrap() {
                0 => break,
                n => total += n,
            }
        }
        let notes: Vec<String> = source.notes().iter().map(ToString::to_string).collect();
        let notes = notes.join("; ");
        for part in parts {
            assert!(notes.contains(part), "'{part}' is not in: {notes}");
        }
        total
    }
}

fn none() -> OpenOptions {
    OpenOptions::default()
}

fn rate() -> OpenOptions {
    OpenOptions { rate_hz: Some(4e6), ..none() }
}

#[test]
fn wrong_files_are_named() {
    let f = Folder::new(&[("a.cs8", &[0; 40]), ("empty.cs8", &[]), ("x.cs16", &[0; 3])]);
    f.refused(&[], none(), &["no capture was given", "'-' for standard input"]);
    f.refused(&["nofile.cs8"], rate(), &["cannot open capture", "nofile.cs8", "No such file"]);
    f.refused(&["."], rate(), &["is a directory", "name the capture file"]);
    f.refused(&["empty.cs8"], rate(), &["empty.cs8", "0 bytes", "cs8", "empty, cut off"]);
    f.refused(&["x.cs16"], rate(), &["3 bytes", "less than one sample of type cs16"]);
    f.refused(&["a.cs8", "-"], rate(), &["standard input", "give it alone"]);
    f.refused(&["a.cs8", "x.cs16"], rate(), &["differ in sample type (cs8 and cs16)"]);
}

#[test]
fn missing_and_impossible_options_are_named() {
    let f = Folder::new(&[("a.cs8", &[0; 40]), ("a.bin", &[0; 40]), ("a.rs8", &[0; 40])]);
    let format = |name: &str| OpenOptions { format: Some(name.into()), ..rate() };
    f.refused(&["a.bin"], rate(), &["a.bin", "must be given", "cu8, cs8, cs16"]);
    f.refused(&["a.bin"], format("cs9"), &["'cs9' is unknown", "cu8, cs8, cs16"]);
    f.refused(&["a.bin"], format(""), &["'' is unknown"]);
    f.refused(&["a.cs8"], none(), &["sample rate", "a.cs8", "must be given"]);
    for bad in [0.0, -4e6, f64::NAN, f64::INFINITY] {
        let options = OpenOptions { rate_hz: Some(bad), ..none() };
        f.refused(&["a.cs8"], options, &["sample rate", "is impossible", "above 0"]);
    }
    f.refused(&["a.rs8"], rate(), &["real samples", "intermediate frequency", "must be given"]);
    let options = OpenOptions { if_hz: Some(f64::NAN), ..rate() };
    f.refused(&["a.cs8"], options, &["intermediate frequency NaN Hz is impossible"]);
    for bad in [0, 5000] {
        let options = OpenOptions { channels: Some(bad), ..rate() };
        f.refused(&["a.cs8"], options, &["channels are impossible", "1 to 1024"]);
    }
    let options = OpenOptions { channels: Some(3), ..rate() };
    f.refused(
        &["a.cs8", "a.cs8"],
        options,
        &["3 channels were asked for", "2 channels", "number of files"],
    );
    let planar = OpenOptions { layout: Some(Layout::Planar), channels: Some(3), ..rate() };
    f.refused(&["a.cs8"], planar, &["40 bytes", "3 planes"]);
}

#[test]
fn wrong_intervals_are_named() {
    let f = Folder::new(&[("a.cs8", &[0; 40])]);
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        f.refused(&["a.cs8"], OpenOptions { start_s: bad, ..rate() }, &["start", "0 or more"]);
    }
    let late = OpenOptions { start_s: 1.0, ..rate() };
    f.refused(&["a.cs8"], late, &["start at 1 s", "beyond the end", "0.000005 s long"]);
    for bad in [0.0, -1.0, f64::NAN] {
        let options = OpenOptions { duration_s: Some(bad), ..rate() };
        f.refused(&["a.cs8"], options, &["duration", "more than 0"]);
    }
    let long = OpenOptions { duration_s: Some(2.0), ..rate() };
    assert_eq!(f.warned(&["a.cs8"], long, &["2 s were asked for"]), 20);
}

#[test]
fn doubtful_samples_are_reported_and_read() {
    let numbers = [1.0, f32::NAN, f32::INFINITY, 2.0].map(f32::to_le_bytes).concat();
    let f = Folder::new(&[("a.cf32", &numbers), ("a.cs16", &[0; 42]), ("b.cs16", &[0; 20])]);
    assert_eq!(f.warned(&["a.cf32"], rate(), &["2 numbers were NaN or infinite", "a.cf32"]), 2);
    assert_eq!(f.warned(&["a.cs16"], rate(), &["last 2 bytes", "no whole sample"]), 10);
    let both = ["differ in length", "5 to 10 samples"];
    assert_eq!(f.warned(&["a.cs16", "b.cs16"], rate(), &both), 5);
    let three = OpenOptions { channels: Some(3), ..rate() };
    assert_eq!(f.warned(&["b.cs16"], three, &["last 8 bytes", "3 channel(s)"]), 1);
    let aliased = OpenOptions { if_hz: Some(3e6), ..rate() };
    f.warned(&["a.cs16"], aliased, &["beyond half the rate", "aliased"]);
}

#[test]
fn wrong_sigmf_is_named() {
    let meta = |global: &str, captures: &str| {
        format!(r#"{{"global": {{{global}}}, "captures": [{captures}], "annotations": []}}"#)
    };
    let good = r#""core:datatype": "ci8", "core:sample_rate": 4e6, "core:version": "1.2.5""#;
    let file =
        |text: &str| Folder::new(&[("a.sigmf-meta", text.as_bytes()), ("a.sigmf-data", &[0; 40])]);
    let refused = |text: &str, parts: &[&str]| file(text).refused(&["a.sigmf-meta"], none(), parts);
    refused("{\n\"global\": ", &["a.sigmf-meta", "line 2, column 10", "EOF"]);
    refused(r#"{"captures": []}"#, &["line 1", "missing field `global`"]);
    refused(&meta("", ""), &["missing field `core:datatype`"]);
    refused(&meta(r#""core:datatype": "ci64""#, ""), &["core:datatype", "'ci64' is not supported"]);
    refused(&meta(r#""core:datatype": "ci8""#, ""), &["sample rate", "must be given"]);
    let zero = good.replace("4e6", "0");
    refused(&meta(&zero, ""), &["core:sample_rate", "is no rate of a converter"]);
    let many = format!(r#"{good}, "core:num_channels": 0"#);
    refused(&meta(&many, ""), &["core:num_channels", "0 is not in 1 to 1024"]);
    let only = format!(r#"{good}, "core:metadata_only": true"#);
    refused(&meta(&only, ""), &["core:metadata_only", "no samples"]);
    let f = Folder::new(&[("a.sigmf-meta", meta(good, "").as_bytes()), ("b.sigmf-data", &[0; 8])]);
    f.refused(&["a.sigmf-meta"], none(), &["a.sigmf-data", "is missing", "beside its metadata"]);
    f.refused(&["b.sigmf-data"], none(), &["b.sigmf-meta", "is missing", "sample type and rate"]);
    f.refused(&["c.sigmf"], none(), &["archives are not read", "tar -xf"]);
    let f = file(&meta(good, ""));
    let options = OpenOptions { rate_hz: Some(5e6), format: Some("cu8".into()), ..none() };
    let parts = ["sample rate 5000000 Hz", "overrides 4000000 Hz", "cu8", "overrides cs8"];
    assert_eq!(f.warned(&["a.sigmf-meta"], options, &parts), 20);
    f.warned(&["a.sigmf-data"], none(), &["states no core:frequency"]);
    let channels = OpenOptions { channels: Some(2), ..none() };
    f.refused(
        &["a.sigmf-meta"],
        channels,
        &["2 channels were asked for", "1 channels", "the metadata"],
    );
}

#[test]
fn wrong_ion_metadata_are_named() {
    let xml = include_str!("bad_input/good.sdrx");
    let refused = |from: &str, to: &str, parts: &[&str]| {
        assert!(xml.contains(from), "{from}");
        let f =
            Folder::new(&[("a.sdrx", xml.replacen(from, to, 1).as_bytes()), ("a.dat", &[0; 40])]);
        f.refused(&["a.sdrx"], none(), parts);
    };
    let good = Folder::new(&[("a.sdrx", xml.as_bytes()), ("a.dat", &[0; 40]), ("b.dat", &[0; 40])]);
    assert_eq!(good.warned(&["a.sdrx"], none(), &[]), 160);
    good.refused(&["a.sdrx", "a.dat", "b.dat"], none(), &["2 data files are given for 1 lanes"]);
    let other = OpenOptions { stream: Some("L9".into()), ..none() };
    good.refused(&["a.sdrx"], other, &["L9", "not among its streams: S1"]);
    refused("</block>", "</blok>", &["a.sdrx", "line 9", "block"]);
    refused("a.dat", "c.dat", &["c.dat", "is missing"]);
    refused("<url>a.dat</url>", "", &["names no data file"]);
    refused("<sizeword>1", "<sizeword>3", &["sizeword", "1, 2, 4 or 8 bytes"]);
    refused("<sizeword>1</sizeword>", "", &["chunk (line 6), sizeword: is missing"]);
    refused("<countwords>1", "<countwords>99", &["99 words", "16 bytes in all"]);
    refused("<packedbits>8", "<packedbits>9", &["9 bits", "the chunk has 8"]);
    refused("<packedbits>8", "<packedbits>4", &["needs 8 bits", "4 packedbits"]);
    refused("<quantization>2", "<quantization>two", &["quantization", "'two' is no whole number"]);
    refused("TCA", "FP", &["encoding", "'FP' is unknown"]);
    refused("<format>IF", "<format>XY", &["format", "'XY' is not supported"]);
    refused("format=\"MHz\"", "format=\"mph\"", &["unit 'mph'", "Hz, kHz, MHz, GHz"]);
    refused("1575.42", "1227.6", &["a stream of GPS L1", "not among its streams: S1"]);
    refused("<band id=\"L1\"/>", "<band id=\"L7\"/>", &["band 'L7'", "nowhere defined"]);
}

#[test]
fn wrong_wav_is_named() {
    let wav = |channels, bits, kind| {
        let spec = hound::WavSpec {
            channels,
            sample_rate: 48_000,
            bits_per_sample: bits,
            sample_format: kind,
        };
        let mut bytes = std::io::Cursor::new(Vec::new());
        let mut writer = hound::WavWriter::new(&mut bytes, spec).unwrap();
        for _ in 0..30 {
            writer.write_sample(1i32).unwrap();
        }
        writer.finalize().unwrap();
        bytes.into_inner()
    };
    let good = wav(2, 16, hound::SampleFormat::Int);
    let f = Folder::new(&[
        ("noise.wav", b"This is no WAV file, whatever its name says."),
        ("empty.wav", &[]),
        ("three.wav", &wav(3, 16, hound::SampleFormat::Int)),
        ("cut.wav", &good[..good.len() - 10]),
    ]);
    f.refused(&["noise.wav"], none(), &["noise.wav", "is no WAV file", "RIFF"]);
    f.refused(&["empty.wav"], none(), &["is no WAV file", "empty"]);
    f.refused(&["three.wav"], none(), &["3 columns", "I and Q of each channel"]);
    assert_eq!(f.warned(&["cut.wav"], none(), &["states 60 bytes", "holds 50", "cut off"]), 12);
}

#[test]
fn wrong_outputs_are_named() {
    let info = StreamInfo {
        rate_hz: 4e6,
        if_hz: 0.0,
        channels: 2,
        real: false,
        samples: None,
        start_time: None,
        format: "cs8".into(),
        array: None,
    };
    let folder = tempfile::tempdir().unwrap();
    let create =
        |name: &str| SigmfWriter::create(&folder.path().join(name), &info, Datatype::I8, "");
    let message = |r: Result<(), capture::CaptureError>| r.unwrap_err().to_string();
    assert!(message(create("a.bin").map(drop)).contains("must end in .sigmf-meta"));
    assert!(message(create("no/folder/a.sigmf-meta").map(drop)).contains("cannot write"));
    let mut writer = create("a.sigmf-meta").unwrap();
    assert!(message(writer.write(&Block::zeros(1, 4))).contains("a block of 1 channels, not 2"));
}

#[test]
fn the_command_line_reports_errors_in_one_line_and_exits_with_2() {
    let f = Folder::new(&[("a.bin", &[0; 40])]);
    let run = |args: &[&str]| {
        let mut command = assert_cmd::Command::cargo_bin("sdr-rx").unwrap();
        let output = command.arg("info").args(args).assert().failure().code(2).get_output().clone();
        assert!(output.stdout.is_empty());
        String::from_utf8(output.stderr).unwrap()
    };
    let path = f.paths(&["a.bin"])[0].display().to_string();
    assert!(run(&[&path]).contains("; give --format TYPE"));
    assert!(run(&["no.cs8", "-r", "4M"]).contains("sdr-rx: cannot open capture 'no.cs8'"));
    assert!(run(&[&path, "-f", "cs8", "-r", "4 MHz"]).contains("write it as 4000000, 4e6, 4M"));
    assert!(run(&[&path, "--encoding", "gray"]).contains("one of sign, tc, tca"));
    assert!(run(&[&path, "--time", "noon"]).contains("'noon' is no time"));
    assert!(run(&[&path, "-f", "cs8", "-r", "4M", "--start", "-1"]).contains("correct --start"));
    assert_eq!(run(&["no.cs8", "-r", "4M"]).lines().count(), 1);
}
