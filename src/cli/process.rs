//! `sdr-rx process`: from a capture to a position.

use super::interrupt::{Interrupt, Interruptible};
use super::live::Live;
use super::output::{self, Printed};
use super::protect::{protect, protect_folder};
use super::receive::{self, Receive, Solve};
use anyhow::{Context, ensure};
use sdr_rx::capture::Block;
use sdr_rx::front_end::conditioned_rate_hz;
use sdr_rx::receiver::{Event, Receiver, ReceiverError, Recorder, Task};
use sdr_rx::report::{OutputDir, write_check};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// From a capture to a position
///
/// Example: sdr-rx process signals/static_8sv.toml --out fix --report
#[derive(clap::Args)]
pub struct Process {
    #[command(flatten)]
    receive: Receive,
    #[command(flatten)]
    solve: Solve,
    /// Write result.json, RINEX, NMEA, GeoJSON and KML files into this folder
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Write the result as one JSON object to a file, or - for standard output
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true, default_missing_value = "-", help_heading = "Output")]
    json: Option<PathBuf>,
    /// Add a page with plots, report.html, to --out
    #[arg(long, requires = "out", help_heading = "Output")]
    report: bool,
    /// Replace files that sdr-rx did not write
    #[arg(long, help_heading = "Output")]
    force: bool,
    /// Print each fix at once [default: where the capture is a pipe, a socket or a device]
    #[arg(long, help_heading = "Output")]
    follow: bool,
    /// Write events as they happen, as JSON Lines, to a file, or - for standard output
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    events: Option<PathBuf>,
}

/// Runs the receiver, prints and writes its results. Exit code 1 when there is no fix, 130 when Ctrl-C ended it.
pub fn run(args: &Process) -> anyhow::Result<ExitCode> {
    args.receive.start_threads()?;
    let mut source = args.receive.input.open()?;
    let info = source.info().clone();
    let mut options = args.receive.options(&info)?;
    args.solve.apply(&mut options)?;
    let inputs = [&args.receive.input.captures[..], &args.solve.nav[..]].concat();
    let outputs = args.json.iter().chain(&args.events).map(PathBuf::as_path);
    protect(outputs, &inputs, args.force)?;
    let to_stdout = |path: &Option<PathBuf>| path.as_deref() == Some(Path::new("-"));
    let (json_out, events_out) = (to_stdout(&args.json), to_stdout(&args.events));
    ensure!(!(json_out && events_out), "--json and --events cannot both go to standard output");
    // Checked first: hours of signal would be lost if the folder could not be written.
    let folder = args.out.as_ref().map(OutputDir::create).transpose()?;
    if let Some(folder) = &folder {
        folder.check()?;
        protect_folder(folder, &inputs, args.force)?;
    }
    if let Some(path) = args.json.as_deref().filter(|_| !json_out) {
        write_check(path)?;
    }

    let follow = args.follow || args.receive.input.is_stream();
    let mut live = Live::new(
        &info,
        conditioned_rate_hz(info.rate_hz, options.decimation),
        follow && !json_out && !events_out,
    );
    if let Some(path) = &args.events {
        live.write_events(path, &args.receive.input.name())
            .with_context(|| format!("writing events to '{}'", path.display()))?;
    }

    let interrupt = Interrupt::new().context("waiting for Ctrl-C")?;
    let mut receiver = Receiver::new(&info, options.clone(), Task::Track)?;
    let mut recorder = Recorder::default();
    let mut take = |event: &Event, live: &mut Live| {
        recorder.take(event);
        live.take(event);
    };
    let (mut block, mut next, chunk) = (Block::default(), Block::default(), receiver.chunk());
    let is_stream = args.receive.input.is_stream();
    if is_stream {
        // What may wait for samples is read by a thread of its own.
        source = Box::new(Interruptible::new(source, chunk, interrupt.clone()));
    }
    source.read(&mut block, chunk).map_err(ReceiverError::Source)?;
    while !block.is_empty() && !interrupt.pressed() {
        let mut read = || source.read(&mut next, chunk);
        let mut push = || receiver.push(&mut block, &mut |event| take(&event, &mut live));
        let (pushed, read) = match is_stream {
            true => (push(), read()),
            false => rayon::join(push, read),
        };
        pushed?;
        live.progress(receiver.samples());
        read.map_err(ReceiverError::Source)?;
        std::mem::swap(&mut block, &mut next);
    }
    let end = receiver.finish(&mut |event| take(&event, &mut live))?;
    let record = recorder.finish(end, &options, source.notes());
    live.finish().context("writing events")?;

    let interrupted = interrupt.pressed();
    let advice = match interrupted {
        true => Vec::new(),
        false => output::advise(&args.receive, &options, &record),
    };
    let printed = Printed {
        receive: &args.receive,
        info: &info,
        rate_hz: conditioned_rate_hz(info.rate_hz, options.decimation),
        record: &record,
        interrupted,
        advice,
        options: receive::echo(&options),
    };
    if let Some(folder) = &folder {
        printed.write_files(folder, args.report)?;
    }
    printed.print(args.json.as_deref(), !events_out, true)?;
    Ok(match (interrupted, record.fixes.iter().any(|f| f.integrity.is_proved())) {
        (true, _) => ExitCode::from(130),
        (false, true) => ExitCode::SUCCESS,
        (false, false) => ExitCode::from(1),
    })
}
