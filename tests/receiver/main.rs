//! The whole program, from captures to the JSON record and the files (needs
//! `SDR_RX_DATA`; RTKLIB's `rnx2rtkp` and gpsd's `gpsdecode` where a test is named after them).

mod array;
mod beams;
mod brute_force;
#[path = "../common/mod.rs"]
mod common;
mod false_satellites;
mod galileo;
mod impulses;
mod interference;
mod losses;
mod mistakes;
mod navigation_fix;
mod oscillator;
mod program;
mod real_captures;
mod scenarios;
mod snapshots;
mod stream;
mod unknown_time;
