//! The whole receiver from outside: captures go in, the JSON record and the files come out (needs
//! `SDR_RX_DATA`; RTKLIB's `rnx2rtkp` and gpsd's `gpsdecode` where a test's name says so).

mod array;
mod beams;
mod brute_force;
#[path = "../common/mod.rs"]
mod common;
mod impulses;
mod mistakes;
mod navigation_fix;
mod program;
mod real_captures;
mod scenarios;
mod snapshots;
mod stream;
mod unknown_time;
