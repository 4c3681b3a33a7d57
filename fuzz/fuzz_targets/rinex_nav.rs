#![no_main]
//! A RINEX navigation file of any content: what is read is written and read back unchanged.

use libfuzzer_sys::fuzz_target;
use sdr_rx::gnss::format::rinex_nav;

fuzz_target!(|text: &[u8]| {
    if let Ok(file) = rinex_nav::parse(&String::from_utf8_lossy(text), "fuzz") {
        let _ = rinex_nav::parse(&rinex_nav::write(&file.data), "ours");
    }
});
