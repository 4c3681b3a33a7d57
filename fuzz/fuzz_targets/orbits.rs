#![no_main]
//! SP3 files and element sets of any content: what is read gives states.

use libfuzzer_sys::fuzz_target;
use sdr_rx::gnss::Sv;
use sdr_rx::gnss::format::{sp3, tle};

fuzz_target!(|text: &[u8]| {
    let text = String::from_utf8_lossy(text);
    if let Ok(file) = sp3::parse(&text, "fuzz") {
        let data = file.into_navigation_data();
        for sv in Sv::all_gps() {
            for hours in 0..1000 {
                let t = sdr_rx::gnss::GpsTime::from_week_tow(
                    1590,
                    345_600.0 + 3600.0 * f64::from(hours),
                );
                let _ = data.orbit(sv, t).map(|orbit| orbit.state(t));
            }
        }
    }
    for satellite in tle::parse(&text, "fuzz").unwrap_or_default() {
        let _ = satellite.state(satellite.epoch + 1e5);
    }
});
