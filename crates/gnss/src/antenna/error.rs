//! Errors of descriptions of arrays.

use std::path::PathBuf;

/// Why the description of an array is refused.
#[derive(Debug, thiserror::Error)]
pub enum ArrayError {
    /// The array's file cannot be read.
    #[error("reading array '{}': {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// No TOML, an unknown key, or a value outside its range; with line and column.
    #[error("reading array '{name}': {}", source.to_string().trim_end())]
    Toml {
        /// The file.
        name: String,
        /// What was wrong, and where.
        source: Box<toml::de::Error>,
    },
    /// An invalid short form.
    #[error(
        "array '{text}': {reason}; write ula:8 or ula:8:0.5 (elements, spacing in wavelengths), ura:2x2 or \
         ura:2x2:0.5 (columns x rows, spacing), uca:8:0.5 (elements, radius), or name a .toml file"
    )]
    Short {
        /// What was given.
        text: String,
        /// What is wrong with it.
        reason: String,
    },
}
