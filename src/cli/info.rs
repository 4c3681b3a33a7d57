//! `sdr-rx info`: what a capture holds.

use super::input::Input;
use std::process::ExitCode;

/// What a capture holds: format, rate, length, level and spectrum
#[derive(clap::Args)]
pub struct Info {
    #[command(flatten)]
    input: Input,
}

/// Prints what the capture holds.
pub fn run(args: &Info) -> anyhow::Result<ExitCode> {
    let source = args.input.open()?;
    println!("{:?}", source.info());
    Ok(ExitCode::SUCCESS)
}
