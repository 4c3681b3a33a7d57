//! Receivers without a centre: against reference networks, and on links that lose and delay.

#[path = "network/command.rs"]
mod command;
mod common;
#[path = "network/stations.rs"]
mod stations;

use libtest_mimic::Arguments;

fn main() {
    let groups = [command::trials(), stations::trials()];
    libtest_mimic::run(&Arguments::from_args(), groups.into_iter().flatten().collect()).exit();
}
