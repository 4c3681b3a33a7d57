//! Reports of a receiver at a known place, read back by other programs (needs `SDR_RX_DATA`, and
//! RTKLIB's `rnx2rtkp` and gpsd's `gpsdecode` where a test's name says so).

#[path = "../common/mod.rs"]
mod common;
mod formats;
mod programs;
mod scene;
