//! `sdr-rx acquire`: the satellites in a capture.

use super::output::{self, Printed};
use super::protect::protect;
use super::receive::{self, Receive};
use sdr_rx::front_end::conditioned_rate_hz;
use sdr_rx::receiver;
use std::path::PathBuf;
use std::process::ExitCode;

/// Which satellites are in a capture: Doppler, code phase and C/N0 of each
///
/// Example: sdr-rx acquire signals/static_8sv.toml --prn G01-G32,J193-J199
#[derive(clap::Args)]
pub struct Acquire {
    #[command(flatten)]
    receive: Receive,
    /// Seconds of signal that the measurements use
    #[arg(long, value_name = "S", default_value_t = 0.2, help_heading = "Search")]
    seconds: f64,
    /// Write the result as one JSON object to a file, or - for standard output
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true, default_missing_value = "-", help_heading = "Output")]
    json: Option<PathBuf>,
    /// Replace files that sdr-rx did not write
    #[arg(long, help_heading = "Output")]
    force: bool,
}

/// Searches and prints. Exit code 1 when nothing is found.
pub fn run(args: &Acquire) -> anyhow::Result<ExitCode> {
    args.receive.start_threads()?;
    let outputs = args.json.iter().map(PathBuf::as_path);
    protect(outputs, &args.receive.input.captures, args.force)?;
    let mut source = args.receive.input.open()?;
    let info = source.info().clone();
    let options = args.receive.options(&info)?;
    anyhow::ensure!(args.seconds > 0.0, "--seconds must be above 0");
    let record = receiver::acquire(source.as_mut(), &options, args.seconds)?;
    Printed {
        receive: &args.receive,
        info: &info,
        rate_hz: conditioned_rate_hz(info.rate_hz, options.decimation),
        record: &record,
        interrupted: false,
        advice: output::advise(&args.receive, &options, &record),
        options: receive::echo(&options),
    }
    .print(args.json.as_deref(), true, false)?;
    Ok(if record.acquisitions.is_empty() { ExitCode::from(1) } else { ExitCode::SUCCESS })
}
