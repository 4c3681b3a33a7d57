//! `sdr-rx look`: number and directions of sources.

use super::output::Printed;
use super::protect::protect;
use super::receive::{self, Receive};
use anyhow::Context;
use sdr_rx::front_end::conditioned_rate_hz;
use sdr_rx::receiver;
use sdr_rx::report::{arrival_plot, write_atomically};
use std::path::PathBuf;
use std::process::ExitCode;

/// Number and directions of the sources at an array, before any code is searched; then their satellites
///
/// Example: sdr-rx look signals/ula16.toml --svg sky.svg
#[derive(clap::Args)]
pub struct Look {
    #[command(flatten)]
    receive: Receive,
    /// Seconds of signal to look at
    #[arg(long, value_name = "S", default_value_t = 0.1, help_heading = "Array")]
    seconds: f64,
    /// Draw the directions into this file
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    svg: Option<PathBuf>,
    /// Write the result as one JSON object to a file, or - for standard output
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true, default_missing_value = "-", help_heading = "Output")]
    json: Option<PathBuf>,
    /// Replace files that sdr-rx did not write
    #[arg(long, help_heading = "Output")]
    force: bool,
}

/// Looks and prints. Exit code 1 when nothing is found.
pub fn run(args: &Look) -> anyhow::Result<ExitCode> {
    args.receive.start_threads()?;
    let outputs = args.json.iter().chain(&args.svg).map(PathBuf::as_path);
    protect(outputs, &args.receive.input.captures, args.force)?;
    anyhow::ensure!(args.seconds >= 0.002, "--seconds must be 0.002 or more: two code periods");
    let mut source = args.receive.input.open()?;
    let info = source.info().clone();
    let options = args.receive.options(&info)?;
    let record = receiver::look(source.as_mut(), &options, args.seconds)?;
    let sky = record.sky.as_ref();
    if let (Some(path), Some(sky)) = (&args.svg, sky) {
        write_atomically(path, arrival_plot(sky, &[])?.as_bytes())
            .with_context(|| format!("writing '{}'", path.display()))?;
    }
    Printed {
        receive: &args.receive,
        info: &info,
        rate_hz: conditioned_rate_hz(info.rate_hz, options.decimation),
        record: &record,
        interrupted: false,
        advice: Vec::new(),
        options: receive::echo(&options),
    }
    .print(args.json.as_deref(), true, false)?;
    let seen = sky.is_some_and(|s| !s.satellites.is_empty() || s.sources() > 0);
    Ok(if seen || !record.acquisitions.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}
