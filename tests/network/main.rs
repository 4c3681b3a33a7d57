//! Receivers without a centre: against reference networks, and on links that lose and delay.

mod command;
#[path = "../common/mod.rs"]
mod common;
mod stations;
