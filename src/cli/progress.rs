//! Progress on a terminal; nothing elsewhere.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, stderr};

/// A progress bar of a thousand steps on a terminal, nothing elsewhere.
pub(super) fn thousandths() -> anyhow::Result<ProgressBar> {
    if !stderr().is_terminal() {
        return Ok(ProgressBar::hidden());
    }
    let style = ProgressStyle::with_template("{bar:40} {percent} %, {eta} left")?;
    Ok(ProgressBar::new(1000).with_style(style))
}
