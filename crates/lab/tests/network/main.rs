//! Receivers without a centre, on the paper's networks (some need `SDR_RX_DATA`).

#[path = "../../../../tests/common/mod.rs"]
mod common;
mod figures;
mod filter;
mod quality;
mod reference;
