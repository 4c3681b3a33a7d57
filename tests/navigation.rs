//! Navigation files of many receivers and the navigation message (needs `SDR_RX_DATA`).

mod common;
#[path = "navigation/files.rs"]
mod files;

use libtest_mimic::Arguments;

fn main() {
    let tests = files::trials();
    libtest_mimic::run(&Arguments::from_args(), tests).exit();
}
