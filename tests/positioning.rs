//! Position solvers against an independent reference and real observations (needs `SDR_RX_DATA`).

mod common;
#[path = "positioning/constellations.rs"]
mod constellations;
#[path = "positioning/descent.rs"]
mod descent;
#[path = "positioning/mistakes.rs"]
mod mistakes;
#[path = "positioning/observables.rs"]
mod observables;
#[path = "positioning/real.rs"]
mod real;
#[path = "positioning/sky.rs"]
mod sky;
#[path = "positioning/vectors.rs"]
mod vectors;

use libtest_mimic::Arguments;

fn main() {
    let tests = [
        vectors::trials(),
        constellations::trials(),
        descent::trials(),
        mistakes::trials(),
        real::trials(),
        observables::trials(),
    ];
    let tests = tests.into_iter().flatten().collect();
    libtest_mimic::run(&Arguments::from_args(), tests).exit();
}
