//! Why a network's files cannot be used.

use crate::NetworkError;
use std::path::{Path, PathBuf};

/// Why a network's files cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum NetworkFileError {
    /// A file cannot be read.
    #[error("reading '{}': {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// No TOML, an unknown key, or a value of the wrong kind; with line and column.
    #[error("reading '{}': {}", path.display(), source.to_string().trim_end())]
    Toml {
        /// The file.
        path: PathBuf,
        /// What was wrong, and where.
        source: Box<toml::de::Error>,
    },
    /// No JSON, an unknown key, or a value of the wrong kind; with line and column.
    #[error("reading '{}': {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What was wrong, and where.
        source: serde_json::Error,
    },
    /// Values that do not fit together.
    #[error("reading '{}': {what}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Which, and what is valid.
        what: String,
    },
    /// A network that cannot work.
    #[error("reading '{}': {source}", path.display())]
    Network {
        /// The file.
        path: PathBuf,
        /// Why.
        source: NetworkError,
    },
}

/// The text of a file.
pub(super) fn read(path: &Path) -> Result<String, NetworkFileError> {
    std::fs::read_to_string(path)
        .map_err(|source| NetworkFileError::Read { path: path.into(), source })
}
