//! Receivers without a centre: against reference networks, and on links that lose and delay.

#[path = "network/command.rs"]
mod command;
mod common;
#[path = "network/figures.rs"]
mod figures;
#[path = "network/filter.rs"]
mod filter;
#[path = "network/quality.rs"]
mod quality;
#[path = "network/reference.rs"]
mod reference;
#[path = "network/stations.rs"]
mod stations;

use libtest_mimic::Arguments;

fn main() {
    let groups = [
        reference::trials(),
        command::trials(),
        quality::trials(),
        figures::trials(),
        stations::trials(),
        filter::trials(),
    ];
    libtest_mimic::run(&Arguments::from_args(), groups.into_iter().flatten().collect()).exit();
}
