//! `sdr-rx process`: from a capture to a position.

use super::output::{self, Printed};
use super::receive::{self, Receive, Solve};
use super::words;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use sdr_rx::receiver;
use std::path::PathBuf;
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
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-", help_heading = "Output")]
    json: Option<PathBuf>,
    /// Add a page with plots, report.html, to --out
    #[arg(long, requires = "out", help_heading = "Output")]
    report: bool,
}

/// Runs the receiver, prints and writes what it found. Exit code 1 when there is no fix.
pub fn run(args: &Process) -> anyhow::Result<ExitCode> {
    args.receive.start_threads()?;
    let mut source = args.receive.input.open()?;
    let info = source.info().clone();
    let mut options = args.receive.options(&info);
    args.solve.apply(&mut options)?;
    let bar = bar(info.samples);
    let step = options.decimation as u64;
    let outcome =
        receiver::process(source.as_mut(), &options, &mut |done| bar.set_position(done * step));
    bar.finish_and_clear();
    let mut outcome = outcome.map_err(anyhow::Error::from)?;
    outcome.warnings.splice(0..0, words::notes(source.as_ref()));
    output::advise(&args.receive, &options, &mut outcome);
    let printed = Printed {
        receive: &args.receive,
        info: &info,
        decimation: options.decimation,
        outcome: &outcome,
        options: receive::echo(&options),
    };
    if let Some(folder) = &args.out {
        printed.write_files(folder, args.report)?;
    }
    printed.print(args.json.as_deref(), true)?;
    Ok(if outcome.fixes.is_empty() { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// A progress bar on a terminal, nothing elsewhere.
fn bar(samples: Option<u64>) -> ProgressBar {
    let style = "{elapsed_precise} [{bar:40}] {percent} % {eta}";
    let bar = match samples {
        Some(n) => ProgressBar::with_draw_target(Some(n), ProgressDrawTarget::stderr_with_hz(5)),
        None => ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(5)),
    };
    match ProgressStyle::with_template(style) {
        Ok(style) if samples.is_some() => bar.with_style(style),
        _ => bar,
    }
}
