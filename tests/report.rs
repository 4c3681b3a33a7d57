//! Reports of a receiver at a known place, read back by other programs (needs `SDR_RX_DATA`, and
//! RTKLIB's `rnx2rtkp` and gpsd's `gpsdecode` where a test's name says so).

mod common;
#[path = "report/formats.rs"]
mod formats;
#[path = "report/programs.rs"]
mod programs;
#[path = "report/scene.rs"]
mod scene;

use libtest_mimic::Arguments;

fn main() {
    let tests = formats::trials().into_iter().chain(programs::trials()).collect();
    libtest_mimic::run(&Arguments::from_args(), tests).exit();
}
