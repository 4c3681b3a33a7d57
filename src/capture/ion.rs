//! ION GNSS SDR metadata.
use super::file_source::Description;
use super::{CaptureError, OpenOptions};
use std::path::{Path, PathBuf};
pub(super) fn describe(
    path: &Path,
    _data: &[PathBuf],
    _options: &OpenOptions,
) -> Result<Description, CaptureError> {
    Err(super::sigmf::wrong(path, "metadata", "not yet read"))
}
