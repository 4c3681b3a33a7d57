//! Navigation, orbit and observation files of many sources, and their contents through the signal (needs `SDR_RX_DATA`).

mod common;
#[path = "navigation/files.rs"]
mod files;
#[path = "navigation/orbits.rs"]
mod orbits;
#[path = "navigation/signal.rs"]
mod signal;

use libtest_mimic::Arguments;

fn main() {
    let tests =
        files::trials().into_iter().chain(orbits::trials()).chain(signal::trials()).collect();
    libtest_mimic::run(&Arguments::from_args(), tests).exit();
}
