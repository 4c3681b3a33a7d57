#![no_main]
//! SigMF metadata of any content.

mod common;

use libfuzzer_sys::fuzz_target;
use sdr_rx::capture::OpenOptions;

fuzz_target!(|meta: &[u8]| {
    let files = [("a.sigmf-meta", meta), ("a.sigmf-data", &[0x5a; 4000])];
    common::open_and_read(&files, &OpenOptions::default());
});
