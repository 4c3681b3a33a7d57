//! One receiver of a network without a centre, as a process: `sdr-rx-node CONFIG.toml`.
//!
//! Algorithms are in the library ([`sdr_rx_network`]), transport in zenoh.

mod config;
mod engine;
mod run;
mod status;

use anyhow::{Context, Result, anyhow};
use clap::Parser;
use config::Setup;
use engine::Engine;
use run::Member;
use serde_json::Value;
use signal_hook::consts::{SIGINT, SIGTERM};
use status::Log;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// One receiver of a network without a centre.
///
/// Communicates with its neighbours only, and converges to the least-squares solution of a centre. Runs until it
/// is stopped (Ctrl-C, SIGTERM), and writes status records as JSON Lines.
#[derive(Debug, Parser)]
#[command(
    version,
    after_help = "Example of CONFIG.toml:\n  network = \"network.toml\"\n  node = \"B\""
)]
struct Arguments {
    /// The node's file.
    config: PathBuf,
    /// Check the files, print the messaging engine's configuration (JSON), and end.
    #[arg(long)]
    check: bool,
}

fn main() -> ExitCode {
    match start(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("sdr-rx-node: {error:#}");
            ExitCode::from(2)
        }
    }
}

/// Whether the reader of the status records has closed the pipe.
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    let kind = error.root_cause().downcast_ref::<std::io::Error>().map(std::io::Error::kind);
    kind == Some(std::io::ErrorKind::BrokenPipe)
}

fn start(arguments: &Arguments) -> Result<()> {
    let setup = Setup::read(&arguments.config)?;
    let mut member = Member::new(&setup)?;
    let mut config = setup.zenoh(member.longest_packet())?;
    if arguments.check {
        if let Some(password) = config.pointer_mut("/transport/auth/usrpwd/password") {
            *password = if password.is_null() { Value::Null } else { "(not shown)".into() };
        }
        println!("{}", serde_json::to_string_pretty(&config)?);
        return Ok(());
    }
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, stop.clone()).context("cannot listen to signals")?;
    }
    let mut log = Log::open(&setup.status())?;
    let config = zenoh::Config::from_json5(&config.to_string());
    let config = config.map_err(|error| anyhow!("zenoh refuses its configuration: {error}"))?;
    let hubs = setup.stars();
    let mut engine = Engine::open(config, &setup.network.file.name, setup.id, &hubs)?;
    member.run(&mut engine, &mut log, &stop)
}
