//! The command line of sdr-rx.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
