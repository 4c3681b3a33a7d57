//! Simulated captures: against their own truth, theory, an independent simulator, and bad input.

#[path = "scenario/array.rs"]
mod array;
mod common;
#[path = "scenario/correlator.rs"]
mod correlator;
#[path = "scenario/independent.rs"]
mod independent;
#[path = "scenario/refusals.rs"]
mod refusals;
#[path = "scenario/theory.rs"]
mod theory;

use libtest_mimic::Arguments;

fn main() {
    let groups = [theory::trials(), array::trials(), refusals::trials(), independent::trials()];
    libtest_mimic::run(&Arguments::from_args(), groups.into_iter().flatten().collect()).exit();
}
