//! `sdr-rx network`: receivers without a centre.

use super::{network_make, network_rinex, network_run};
use std::process::ExitCode;

/// Receivers that talk to their neighbours only, and each arrive at the solution of all
#[derive(clap::Args)]
pub struct Network {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Run(network_run::Run),
    Make(network_make::Make),
    Rinex(network_rinex::Rinex),
}

/// Runs the command.
pub fn run(args: &Network) -> anyhow::Result<ExitCode> {
    match &args.command {
        Command::Run(args) => network_run::run(args),
        Command::Make(args) => network_make::run(args),
        Command::Rinex(args) => network_rinex::run(args),
    }
}
