//! Position solvers against an independent reference and real observations (needs `SDR_RX_DATA`).

mod common;
#[path = "positioning/observables.rs"]
mod observables;
#[path = "positioning/real.rs"]
mod real;
#[path = "positioning/vectors.rs"]
mod vectors;

use libtest_mimic::Arguments;

fn main() {
    let tests =
        vectors::trials().into_iter().chain(real::trials()).chain(observables::trials()).collect();
    libtest_mimic::run(&Arguments::from_args(), tests).exit();
}
