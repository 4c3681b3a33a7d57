//! `sdr-rx network`: receivers without a centre.

mod files;
mod make;
mod rinex;
mod run;

use std::process::ExitCode;

/// Receivers that communicate with their neighbours only, and each arrive at the solution of all
#[derive(clap::Args)]
pub(crate) struct Network {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Run(run::Run),
    Make(make::Make),
    Rinex(rinex::Rinex),
}

/// Runs the command.
pub fn run(args: &Network) -> anyhow::Result<ExitCode> {
    match &args.command {
        Command::Run(args) => run::run(args),
        Command::Make(args) => make::run(args),
        Command::Rinex(args) => rinex::run(args),
    }
}
