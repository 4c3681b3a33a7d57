//! Common to the integration tests.
#![allow(dead_code, reason = "each suite compiles this file, and not every one needs all of it")]

use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// Why a test failed.
pub type Failed = Box<dyn Error + Send + Sync>;
/// Result of a test.
pub type Tested = Result<(), Failed>;

/// The folder of test data, of the environment variable `SDR_RX_DATA`; without it `None`, and one line for the
/// process that reports it.
pub fn data() -> Option<&'static Path> {
    static FOLDER: LazyLock<Option<PathBuf>> = LazyLock::new(|| {
        let folder = std::env::var_os("SDR_RX_DATA").map(PathBuf::from);
        if folder.is_none() {
            print("skipped: set SDR_RX_DATA to the folder of test data for the tests that need it");
        }
        folder
    });
    FOLDER.as_deref()
}

/// As [`data`], for a test that also needs this external program.
pub fn data_and(program: &str) -> Option<&'static Path> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    if !std::env::split_paths(&path).any(|folder| folder.join(program).is_file()) {
        print(&format!("skipped: install {program} for the test that needs it"));
        return None;
    }
    data()
}

/// A line on standard error that the harness does not withhold.
fn print(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}
