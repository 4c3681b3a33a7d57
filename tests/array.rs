//! The array stages against an independent reference and theory (some need `SDR_RX_DATA`).

#[path = "array/capture.rs"]
mod capture;
#[path = "array/code_period_svd.rs"]
mod code_period_svd;
mod common;
#[path = "array/jammer.rs"]
mod jammer;
#[path = "array/routes.rs"]
mod routes;
#[path = "array/sky.rs"]
mod sky;

use libtest_mimic::Arguments;

fn main() {
    let tests = [code_period_svd::trials(), jammer::trials(), routes::trials(), capture::trials()];
    libtest_mimic::run(&Arguments::from_args(), tests.into_iter().flatten().collect()).exit();
}
