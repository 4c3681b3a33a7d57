//! The commands: one file each, and no signal processing.

mod acquire;
mod corrections;
mod experiment;
mod info;
mod input;
mod interrupt;
mod live;
mod look;
mod network;
mod output;
mod process;
mod progress;
mod protect;
mod receive;
mod simulate;
mod solve;
mod words;

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
enum Command {
    Process(process::Process),
    Acquire(acquire::Acquire),
    Experiment(experiment::Experiment),
    Look(look::Look),
    Info(info::Info),
    Network(network::Network),
    Simulate(simulate::Simulate),
    Solve(solve::Solve),
}

/// Runs the command line and gives the exit code: 0 the requested result, 1 no fix, 2 usage or input.
pub fn main() -> ExitCode {
    let arguments = protect::json_values(std::env::args_os());
    let result = match Cli::parse_from(arguments).command {
        Command::Process(args) => process::run(&args),
        Command::Acquire(args) => acquire::run(&args),
        Command::Experiment(args) => experiment::run(&args),
        Command::Look(args) => look::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Network(args) => network::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Solve(args) => solve::run(&args),
    };
    result.unwrap_or_else(|error| {
        let advice = words::advice(&error).map_or(String::new(), |advice| format!("; {advice}"));
        eprintln!("sdr-rx: {}{advice}", chained(&error));
        ExitCode::from(2)
    })
}

/// An error with its causes, each said once.
fn chained(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |text, cause| match text {
        text if text.contains(&cause) => text,
        text if text.is_empty() => cause,
        text => format!("{text}: {cause}"),
    })
}
