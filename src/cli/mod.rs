//! The commands: one file each, and no signal processing.

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// A software-defined GNSS receiver: from baseband samples to a position.
#[derive(Parser)]
#[command(name = "sdr-rx", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {}

/// Runs the command line and gives the exit code: 0 the asked result, 1 no fix, 2 usage or input.
pub fn main() -> ExitCode {
    match Cli::parse().command {}
}
