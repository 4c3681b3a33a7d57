//! What the tests that need external data share.

use libtest_mimic::{Failed, Trial};
use std::path::{Path, PathBuf};

/// The folder of test data, from the environment variable `SDR_RX_DATA`, if it is set.
pub fn data_dir() -> Option<PathBuf> {
    std::env::var_os("SDR_RX_DATA").map(PathBuf::from)
}

/// A test that is given the data folder, and counts as ignored when `SDR_RX_DATA` is not set.
pub fn data_trial(name: &str, test: fn(&Path) -> Result<(), Failed>) -> Trial {
    let folder = data_dir();
    let missing = folder.is_none();
    let name = if missing { format!("{name} (needs SDR_RX_DATA)") } else { name.to_owned() };
    Trial::test(name, move || test(&folder.unwrap_or_default())).with_ignored_flag(missing)
}
