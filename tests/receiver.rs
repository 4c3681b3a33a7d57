//! The whole receiver from outside: captures go in, the JSON record and the files come out (needs
//! `SDR_RX_DATA`; RTKLIB's `rnx2rtkp` and gpsd's `gpsdecode` where a test's name says so).

#[path = "receiver/array.rs"]
mod array;
#[path = "receiver/beams.rs"]
mod beams;
#[path = "receiver/brute_force.rs"]
mod brute_force;
mod common;
#[path = "receiver/impulses.rs"]
mod impulses;
#[path = "receiver/mistakes.rs"]
mod mistakes;
#[path = "receiver/navigation_fix.rs"]
mod navigation_fix;
#[path = "receiver/program.rs"]
mod program;
#[path = "receiver/real_captures.rs"]
mod real_captures;
#[path = "receiver/scenarios.rs"]
mod scenarios;
#[path = "receiver/snapshots.rs"]
mod snapshots;
#[path = "receiver/unknown_time.rs"]
mod unknown_time;

use libtest_mimic::Arguments;

fn main() {
    let tests = [
        real_captures::trials(),
        navigation_fix::trials(),
        snapshots::trials(),
        unknown_time::trials(),
        mistakes::trials(),
        scenarios::trials(),
        array::trials(),
        beams::trials(),
        impulses::trials(),
    ];
    libtest_mimic::run(&Arguments::from_args(), tests.into_iter().flatten().collect()).exit();
}
