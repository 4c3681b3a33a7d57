//! Whether what the elements have in common is a jammer, or noise that they share.

use super::find::search;
use crate::acquisition::SearchOptions;
use crate::capture::Block;

/// Signal by which it is judged, s.
const JUDGED_S: f64 = 0.025;

/// Satellites below this C/N0 do not count for that, dB-Hz: noise that the elements share makes some.
const SOUND_DBHZ: f64 = 30.0;

/// Whether one element of an array as it is shows more satellites (of those `asked` for) than all elements do
/// without what looked like a jammer: then that was the elements' common noise, and should stay.
pub(super) fn share_noise(
    untouched: &Block,
    cleaned: &Block,
    rate_hz: f64,
    asked: &SearchOptions,
) -> bool {
    let seen = |block: &Block, most: usize| {
        let mut start = block.clone();
        start.truncate((JUDGED_S * rate_hz) as usize);
        let found = search(&start, rate_hz, asked, most, None, &[]).unwrap_or_default();
        found.iter().filter(|a| a.cn0_dbhz > SOUND_DBHZ).count()
    };
    seen(untouched, 1) > seen(cleaned, cleaned.channels())
}
