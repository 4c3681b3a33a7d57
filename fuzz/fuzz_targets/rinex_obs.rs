#![no_main]
//! A RINEX observation file of any content: an epoch or an error, and an end.

use libfuzzer_sys::fuzz_target;
use sdr_rx::gnss::format::rinex_obs::ObservationReader;

fuzz_target!(|text: &[u8]| {
    if let Ok(reader) = ObservationReader::new(text, "fuzz") {
        let _ = reader.collect::<Result<Vec<_>, _>>();
    }
});
