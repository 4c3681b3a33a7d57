//! The receiver as a stream: independence of blocks, latency, interruption, an hour of signal.

use crate::common::{Failed, Tested, data};
use crate::program::{Answer, file, run};
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::gnss::GpsTime;
use sdr_rx::position::Fix;
use sdr_rx::receiver::{Event, Receiver, ReceiverOptions, Record, Recorder, Task};
use sdr_rx::report::event_line;
use sdr_rx::scenario::{Scenario, ScenarioSource};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};

/// Navigation data known beforehand: a subframe of 6 s dates the satellites.
const SECONDS: f64 = 14.0;

fn scenario(seconds: f64) -> Result<Scenario, Failed> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("signals/static_8sv.toml");
    let mut scenario = Scenario::read(&path)?;
    scenario.duration_s = seconds;
    Ok(scenario)
}

/// Results of a stream: each event with the samples that had been pushed by then, and the record.
struct Streamed {
    events: Vec<(u64, Event)>,
    record: Record,
    rate_hz: f64,
}

impl Streamed {
    /// Pushes a scenario in blocks of so many samples.
    fn new(scenario: &Scenario, block_s: f64, known: bool) -> Result<Self, Failed> {
        let mut source = ScenarioSource::new(scenario)?;
        let rate_hz = source.info().rate_hz;
        let navigation = if known { scenario.navigation()? } else { Default::default() };
        let options = ReceiverOptions { navigation, ..ReceiverOptions::default() };
        let mut receiver = Receiver::new(source.info(), options.clone(), Task::Track)?;
        let (mut recorder, mut events, mut block) =
            (Recorder::default(), Vec::new(), Block::default());
        let mut pushed = 0;
        while source.read(&mut block, (block_s * rate_hz).round() as usize)? > 0 {
            pushed += block.len() as u64;
            receiver.push(&mut block, &mut |event| {
                recorder.take(&event);
                events.push((pushed, event));
            })?;
        }
        let end = receiver.finish(&mut |event| {
            recorder.take(&event);
            events.push((pushed, event));
        })?;
        Ok(Self { events, record: recorder.finish(end, &options, Vec::new()), rate_hz })
    }

    fn fixes(&self) -> impl Iterator<Item = (u64, &Fix)> {
        self.events.iter().filter_map(|(pushed, event)| match event {
            Event::Fix(fix) => Some((*pushed, &**fix)),
            _ => None,
        })
    }

    fn text(&self) -> String {
        let lines: String = self.events.iter().map(|(_, e)| event_line(e, self.rate_hz)).collect();
        format!("{lines}{:?}{:?}", self.record.epochs, self.record.fixes)
    }
}

#[test]
fn blocks_of_any_length_and_any_number_of_threads_give_the_same_bytes() -> Tested {
    let scenario = scenario(SECONDS)?;
    let mut texts = Vec::new();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        for block_s in [1e-3, 0.1, 1.0] {
            texts.push(pool.install(|| Streamed::new(&scenario, block_s, true))?.text());
        }
    }
    assert!(texts[0].matches("\"event\":\"fix\"").count() > 3, "too few fixes to compare");
    assert!(texts.iter().all(|text| *text == texts[0]));
    Ok(())
}

#[test]
fn the_first_fix_comes_when_four_satellites_are_ready_and_later_ones_within_a_second() -> Tested {
    // From the signals alone: three subframes of 6 s hold an ephemeris.
    let streamed = Streamed::new(&scenario(24.0)?, 0.1, false)?;
    let ready_s = streamed.record.first_fix_s.ok_or("no fix")?;
    let mut last: Option<&Fix> = None;
    let mut count = 0;
    for (pushed, fix) in streamed.fixes() {
        let (reported_s, at_s) = (pushed as f64 / streamed.rate_hz, fix.sample / streamed.rate_hz);
        assert!(reported_s - at_s <= 1.0, "the fix of {at_s} s came at {reported_s} s");
        match last {
            None => assert!(
                reported_s - ready_s <= 1.0,
                "ready at {ready_s} s, reported at {reported_s} s"
            ),
            // Instants that are left out would be lost.
            Some(last) => assert!(fix.time - last.time < 1.5, "{:?} {:?}", fix.time, last.time),
        }
        (last, count) = (Some(fix), count + 1);
    }
    // 24 s less the 18 s of three subframes, and what is under way at the end.
    assert!(count >= 5, "{count} fixes");
    Ok(())
}

#[test]
fn instants_lie_on_round_seconds_once_a_fix_has_given_the_time() -> Tested {
    // The recording starts 0.3 s past a second, by a clock that is 2 ms off and drifts by 2 ppm.
    let mut scenario = scenario(20.0)?;
    scenario.start = scenario.start + 0.3;
    scenario.receiver.clock_offset_s = 2e-3;
    scenario.receiver.clock_drift_ppm = 2.0;
    let streamed = Streamed::new(&scenario, 0.1, true)?;
    let times: Vec<GpsTime> = streamed.fixes().map(|(_, fix)| fix.time).collect();
    let late = |t: &GpsTime| t.tow() - t.tow().round();
    // Half a sample is 0.19 us; the clock is known to 5 m of range, 0.02 us.
    let round = times.iter().filter(|t| late(t).abs() < 0.25e-6).count();
    assert!(times.len() >= 8 && round >= times.len() - 2, "{:?}", times.iter().map(late));
    assert!((late(&times[0]) - 0.3).abs() < 0.01, "before the first fix they cannot");
    Ok(())
}

/// The arguments that read the 45 s capture from `input`.
fn tokyo(input: &str) -> Vec<&str> {
    vec!["process", input, "-f", "b1", "-r", "2.6M", "--troposphere", "none"]
}

/// Bytes of a second of it.
const TOKYO_BYTES: usize = 650_000;

#[test]
fn a_pipe_gives_a_line_a_fix_in_time_and_the_record_of_the_file() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let path = file(data, "captures/sim_tokyo_2.6MHz_45s_1bit.bin");
    let bytes = std::fs::read(&path)?;
    let folder = tempfile::tempdir()?;
    let record = folder.path().join("record.json").display().to_string();
    let mut child = Command::new(env!("CARGO_BIN_EXE_sdr-rx"))
        .args(tokyo("-"))
        .arg(format!("--json={record}"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    let mut input = child.stdin.take().ok_or("no input")?;
    // 19.2 s of signal and no more, until the first fix has come.
    let mut lines = BufReader::new(child.stdout.take().ok_or("no output")?).lines();
    let first = (19.2 * TOKYO_BYTES as f64) as usize;
    input.write_all(&bytes[..first])?;
    let line = lines.next().ok_or("no line")??;
    assert!(line.starts_with("2022-01-01T02:00:0"), "{line}");
    let feed = std::thread::spawn(move || input.write_all(&bytes[first..]));
    let fixes = 1 + lines.map_while(Result::ok).take_while(|l| l.contains("1 sigma")).count();
    feed.join().map_err(|_| "feeding panicked")??;
    assert!(child.wait()?.success());
    assert!(fixes >= 26, "{fixes} lines");

    let mut piped: Value = serde_json::from_slice(&std::fs::read(&record)?)?;
    let Answer { json: mut whole, .. } = run(&tokyo(&path))?;
    // A pipe has no name.
    piped["capture"]["name"].take();
    whole["capture"]["name"].take();
    assert!(piped == whole, "the records differ");
    Ok(())
}

#[cfg(unix)]
#[test]
fn an_interrupted_pipe_leaves_its_results_in_every_format() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let bytes = std::fs::read(file(data, "captures/sim_tokyo_2.6MHz_45s_1bit.bin"))?;
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("fix");
    let mut child = Command::new(env!("CARGO_BIN_EXE_sdr-rx"))
        .args(tokyo("-"))
        .args(["--out", &out.display().to_string(), "--report"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    let mut input = child.stdin.take().ok_or("no input")?;
    let lines = BufReader::new(child.stdout.take().ok_or("no output")?).lines();
    input.write_all(&bytes[..25 * TOKYO_BYTES])?;
    // The fixes of 18 to 24 s; the pipe stays open.
    let mut fixes = 0;
    for line in lines.map_while(Result::ok) {
        fixes += usize::from(line.contains("1 sigma"));
        if fixes == 6 {
            Command::new("kill").args(["-INT", &child.id().to_string()]).status()?;
        }
    }
    assert_eq!(child.wait()?.code(), Some(130));
    drop(input);
    let record: Value = serde_json::from_slice(&std::fs::read(out.join("result.json"))?)?;
    assert!(record["fixes"].as_array().is_some_and(|f| f.len() >= 22), "{}", record["reason"]);
    for name in ["navigation.rnx", "track.nmea", "track.geojson", "track.kml", "report.html"] {
        assert!(std::fs::metadata(out.join(name))?.len() > 100, "{name}");
    }
    let is_rinex = |e: &std::fs::DirEntry| e.file_name().to_string_lossy().ends_with("_MO.rnx");
    assert!(std::fs::read_dir(&out)?.flatten().any(|e| is_rinex(&e)));
    Ok(())
}

/// Resident memory of this process, MiB.
#[cfg(target_os = "linux")]
fn memory_mib() -> Result<f64, Failed> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:")).ok_or("no VmRSS")?;
    let kib: f64 = line.trim().trim_end_matches(" kB").parse()?;
    Ok(kib / 1024.0)
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "an hour of signal takes minutes"]
fn an_hour_of_signal_takes_no_more_memory_than_a_minute_and_loses_no_epoch() -> Tested {
    let mut source = ScenarioSource::new(&scenario(3600.0)?)?;
    let options = ReceiverOptions::default();
    let mut receiver = Receiver::new(source.info(), options.clone(), Task::Track)?;
    let (mut recorder, mut block, chunk) =
        (Recorder::default(), Block::default(), receiver.chunk());
    let (mut fixes, mut early, mut most): (Vec<GpsTime>, f64, f64) = (Vec::new(), 0.0, 0.0);
    let minute = (60.0 * source.info().rate_hz) as u64;
    while source.read(&mut block, chunk)? > 0 {
        receiver.push(&mut block, &mut |event| {
            recorder.take(&event);
            if let Event::Fix(fix) = event {
                fixes.push(fix.time);
            }
        })?;
        match receiver.samples() {
            samples if samples < minute => early = memory_mib()?,
            _ => most = most.max(memory_mib()?),
        }
    }
    println!("{early:.1} MiB after a minute, {most:.1} MiB at most, {} fixes", fixes.len());
    assert!(most - early < 10.0, "{early:.1} MiB after a minute, {most:.1} MiB later");
    let first = fixes.first().ok_or("no fix")?;
    assert!((*first - scenario(1.0)?.start) < 20.0, "first fix {first:?}");
    assert!(fixes.windows(2).all(|w| (w[1] - w[0]) < 1.5), "an epoch is missing");
    assert!(fixes.len() >= 3580, "{} fixes", fixes.len());
    let record = recorder.finish(receiver.finish(&mut |_| ())?, &options, Vec::new());
    assert!(record.epochs.len() >= 3590, "{} epochs", record.epochs.len());
    Ok(())
}
