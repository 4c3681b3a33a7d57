//! Sparse solvers and JANE on the paper's scene (some need `SDR_RX_DATA`).

#[path = "../../../../tests/common/mod.rs"]
mod common;
mod jane;
mod solvers;
