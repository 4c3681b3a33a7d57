//! Whether a strong common component of the elements is a jammer, or common noise.

use super::find::{Channels, search};
use crate::acquisition::SearchOptions;
use crate::capture::Block;

/// Signal that is searched, s.
const JUDGED_S: f64 = 0.025;

/// Satellites below this C/N0 do not count, dB-Hz: common noise makes false ones.
const SOUND_DBHZ: f64 = 30.0;

/// Whether one `untouched` element shows more satellites (of those `asked` for) than all elements after the removal
/// of a supposed jammer: then that was common noise of the elements, and should not be removed.
pub(super) fn is_common_noise(
    untouched: &Block,
    cleaned: &Block,
    rate_hz: f64,
    asked: &SearchOptions,
) -> bool {
    let seen = |block: &Block, most: usize| {
        let mut start = block.clone();
        start.truncate((JUDGED_S * rate_hz) as usize);
        let used = Channels::new(most, None, None);
        let found = search(&start, rate_hz, asked, used, &[]).unwrap_or_default();
        found.iter().filter(|a| a.cn0_dbhz > SOUND_DBHZ).count()
    };
    seen(untouched, 1) > seen(cleaned, cleaned.channels())
}
