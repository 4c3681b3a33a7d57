//! The array stages against an independent reference and theory (some need `SDR_RX_DATA`).

mod common;
#[path = "array/solvers.rs"]
mod solvers;

use libtest_mimic::Arguments;

fn main() {
    let tests = [solvers::trials()];
    libtest_mimic::run(&Arguments::from_args(), tests.into_iter().flatten().collect()).exit();
}
