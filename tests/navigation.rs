//! Navigation files of many receivers, and their contents through the signal (needs `SDR_RX_DATA`).

mod common;
#[path = "navigation/files.rs"]
mod files;
#[path = "navigation/signal.rs"]
mod signal;

use libtest_mimic::Arguments;

fn main() {
    let tests = files::trials().into_iter().chain(signal::trials()).collect();
    libtest_mimic::run(&Arguments::from_args(), tests).exit();
}
