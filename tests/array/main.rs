//! The array stages against an independent reference and theory (some need `SDR_RX_DATA`).

mod capture;
mod code_period_svd;
#[path = "../common/mod.rs"]
mod common;
mod fan;
mod jammer;
mod look;
mod methods;
mod scene;
