//! Position solvers against an independent reference and real observations (needs `SDR_RX_DATA`).

mod common;
#[path = "positioning/constellations.rs"]
mod constellations;
#[path = "positioning/descent.rs"]
mod descent;
#[path = "positioning/mistakes.rs"]
mod mistakes;
#[path = "positioning/real.rs"]
mod real;
#[path = "positioning/sky.rs"]
mod sky;
#[path = "positioning/vectors.rs"]
mod vectors;

use libtest_mimic::Arguments;

fn main() {
    let tests = vectors::trials()
        .into_iter()
        .chain(constellations::trials())
        .chain(descent::trials())
        .chain(mistakes::trials())
        .chain(real::trials())
        .collect();
    libtest_mimic::run(&Arguments::from_args(), tests).exit();
}
