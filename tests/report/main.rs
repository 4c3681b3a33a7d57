//! Reports of a receiver at a known position, read back by other programs (needs `SDR_RX_DATA`, and
//! RTKLIB's `rnx2rtkp` and gpsd's `gpsdecode` where a test is named after them).

#[path = "../common/mod.rs"]
mod common;
mod formats;
mod outputs;
mod programs;
mod scene;
