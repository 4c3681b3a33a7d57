//! Navigation, orbit and observation files of many sources, and their contents through the signal (needs `SDR_RX_DATA`).

#[path = "../common/mod.rs"]
mod common;
mod files;
mod orbits;
mod signal;
