#![no_main]
//! ION metadata of any content: parsed, and every lane's samples decoded.

use libfuzzer_sys::fuzz_target;
use sdr_rx::capture::ion;
use std::path::Path;

fuzz_target!(|xml: &[u8]| {
    let path = Path::new("a.sdrx");
    let Ok(lanes) = ion::parse(&String::from_utf8_lossy(xml), path) else { return };
    for format in lanes.iter().filter_map(|lane| lane.format(path).ok()) {
        let bytes = vec![0x5a; 10 * format.word_bytes()];
        let mut out = vec![Default::default(); 10 * format.samples_per_word()];
        format.decode(&bytes, &mut out);
    }
});
