//! Samples that are lost or doubled in a capture of an independent simulator (`SDR_RX_DATA`).

use crate::common::{Tested, data};
use crate::snapshots::TOKYO;
use sdr_rx::capture::{self, OpenOptions};
use sdr_rx::gnss::atmosphere::Troposphere;
use sdr_rx::position::PositioningOptions;
use sdr_rx::receiver::{self, Notice, ReceiverOptions};

/// Bytes of a second of samples of 1 bit at 2.6 MHz.
const BYTES_A_SECOND: f64 = 650e3;
/// Signal used, s.
const USED_S: usize = 36;

/// Whole and broken milliseconds and symbols, less than a symbol and more than ten: no fix is wrong, the loss is named to
/// half a millisecond, and fixes go on at most 3 s after it.
#[test]
fn samples_that_are_lost_or_double_are_told_and_make_no_fix_wrong() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let path = data.join("captures/sim_tokyo_2.6MHz_45s_1bit.bin");
    let mut capture = std::fs::read(path)?;
    capture.truncate(USED_S * BYTES_A_SECOND as usize);
    for (at_s, lost_ms) in [(20.0, 1.0), (20.0, 63.0), (25.3137, 137.3), (20.0, -37.123)] {
        let at = (at_s * BYTES_A_SECOND) as usize;
        let bytes = (lost_ms * 1e-3 * BYTES_A_SECOND) as isize;
        let rest = &capture[at.saturating_add_signed(bytes)..];
        let cut = [&capture[..at], rest].concat();
        let file = std::env::temp_dir().join(format!("sdr-rx-{}-{bytes}.bin", std::process::id()));
        std::fs::write(&file, cut)?;
        let open = OpenOptions {
            format: Some("b1".to_owned()),
            rate_hz: Some(2.6e6),
            ..OpenOptions::default()
        };
        let options = ReceiverOptions {
            positioning: PositioningOptions {
                troposphere: Troposphere::None,
                ..PositioningOptions::default()
            },
            ..ReceiverOptions::default()
        };
        let mut source = capture::open(std::slice::from_ref(&file), &open)?;
        let record = receiver::process(source.as_mut(), &options, &mut |_| ())?;
        std::fs::remove_file(&file)?;
        for fix in &record.fixes {
            let error_m = (fix.position_m - TOKYO).norm();
            let limit_m = (5.0 * fix.covariance.trace().sqrt()).max(25.0);
            assert!(error_m < limit_m, "{lost_ms} ms: {error_m} m at {}", fix.sample / 2.6e6);
        }
        let after = |from_s: f64| record.fixes.iter().find(|f| f.sample > from_s * 2.6e6);
        let first = after(at_s).ok_or(format!("{lost_ms} ms: no fix after it"))?;
        assert!(first.sample / 2.6e6 < at_s + 3.0, "{lost_ms} ms");
        let told = record.notices.iter().find_map(|notice| match notice {
            Notice::Lost { lost_s, .. } => Some(lost_s * 1e3),
            _ => None,
        });
        let told = told.ok_or(format!("{lost_ms} ms: {:?}", record.notices))?;
        assert!((told - lost_ms).abs() < 0.6, "{lost_ms} ms is told as {told}");
    }
    Ok(())
}
