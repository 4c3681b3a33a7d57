//! Receivers without a centre, on the paper's networks (some need `SDR_RX_DATA`).

#[path = "../../../tests/common/mod.rs"]
mod common;
#[path = "network/figures.rs"]
mod figures;
#[path = "network/filter.rs"]
mod filter;
#[path = "network/quality.rs"]
mod quality;
#[path = "network/reference.rs"]
mod reference;

use libtest_mimic::Arguments;

fn main() {
    let groups = [reference::trials(), quality::trials(), figures::trials(), filter::trials()];
    libtest_mimic::run(&Arguments::from_args(), groups.into_iter().flatten().collect()).exit();
}
