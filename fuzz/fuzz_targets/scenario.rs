#![no_main]
//! A scenario of any content: read, or refused with a message.

use libfuzzer_sys::fuzz_target;
use sdr_rx::scenario::Scenario;

fuzz_target!(|text: &[u8]| {
    if let Err(error) = Scenario::parse(&String::from_utf8_lossy(text), "fuzz") {
        assert!(!error.to_string().is_empty());
    }
});
