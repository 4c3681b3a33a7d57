//! Position solvers against an independent reference and real observations (needs `SDR_RX_DATA`).

#[path = "../common/mod.rs"]
mod common;
mod constellations;
mod descent;
mod mistakes;
mod observables;
mod real;
mod sky;
mod vectors;
