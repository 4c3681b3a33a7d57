//! Why a report cannot be made.

use std::path::PathBuf;

/// Why a report cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The folder cannot be made.
    #[error("making the output folder {path}: {source}; it must be where files may be written")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file cannot be written.
    #[error("writing {path}: {source}; nothing was left under that name")]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A plot cannot be drawn.
    #[error("drawing the {plot}: {problem}")]
    Plot {
        /// The plot.
        plot: &'static str,
        /// The drawing library's error.
        problem: String,
    },
}
