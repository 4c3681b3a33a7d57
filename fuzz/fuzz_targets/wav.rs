#![no_main]
//! A WAV file of any content.

mod common;

use libfuzzer_sys::fuzz_target;
use sdr_rx::capture::OpenOptions;

fuzz_target!(|wav: &[u8]| {
    let options = OpenOptions { if_hz: Some(1e3), ..OpenOptions::default() };
    common::open_and_read(&[("a.wav", wav)], &options);
});
