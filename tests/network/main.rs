//! Receivers without a centre: against reference networks, and on links with losses and delays.

mod command;
#[path = "../common/mod.rs"]
mod common;
mod stations;
