//! Files that get their names only when they are complete.

use std::io;
use std::path::Path;
use tempfile::NamedTempFile;

/// A temporary file in the folder of `path`, to be persisted as `path`; others may read it as they may a
/// plain new file.
///
/// # Errors
/// When the folder is missing or cannot be written.
pub fn temporary_beside(path: &Path) -> io::Result<NamedTempFile> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".sdr-rx-");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}
