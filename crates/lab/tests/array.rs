//! Sparse solvers and JANE on the paper's scene (some need `SDR_RX_DATA`).

#[path = "../../../tests/common/mod.rs"]
mod common;
#[path = "array/jane.rs"]
mod jane;
#[path = "array/solvers.rs"]
mod solvers;

use libtest_mimic::Arguments;

fn main() {
    let tests = [solvers::trials(), jane::trials()];
    libtest_mimic::run(&Arguments::from_args(), tests.into_iter().flatten().collect()).exit();
}
