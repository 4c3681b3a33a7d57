//! Files, written completely or not at all.

use super::{ReportError, Run, Summary, geojson, html, json, kml, nmea};
use crate::gnss::format::{rinex_nav, rinex_obs};
use crate::temporary::temporary_beside;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes a file under a temporary name beside `path` and renames it: a reader sees the old file or the
/// complete new one, also when the run is killed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), ReportError> {
    let write = || -> std::io::Result<()> {
        let mut file = temporary_beside(path)?;
        file.write_all(bytes)?;
        file.persist(path)?;
        Ok(())
    };
    write().map_err(|source| ReportError::File { path: path.to_owned(), source })
}

/// Checks whether a file can be written.
///
/// # Errors
/// When it cannot.
pub fn write_check(path: &Path) -> Result<(), ReportError> {
    let found = temporary_beside(path);
    found.map(|_| ()).map_err(|source| ReportError::File { path: path.to_owned(), source })
}

/// A folder for reports.
#[derive(Clone, Debug)]
pub struct OutputDir {
    path: PathBuf,
}

impl OutputDir {
    /// Makes the folder, and missing ones above it.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self, ReportError> {
        let path = path.into();
        match std::fs::create_dir_all(&path) {
            Ok(()) => Ok(Self { path }),
            Err(source) => Err(ReportError::Folder { path, source }),
        }
    }

    /// Checks whether files can be written there.
    ///
    /// # Errors
    /// When none can.
    pub fn check(&self) -> Result<(), ReportError> {
        write_check(&self.path.join("result.json"))
    }

    /// Writes one file into the folder and gives its path.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<PathBuf, ReportError> {
        let path = self.path.join(name);
        write_atomically(&path, bytes.as_ref()).map(|()| path)
    }
}

/// Writes every report for which the run has data: `result.json` always; RINEX observations and
/// navigation; `track.nmea`, `track.geojson`, `track.kml` where there is a fix; `report.html` if asked.
/// Gives the paths in the order written.
pub fn write_all(run: &Run, folder: &OutputDir, page: bool) -> Result<Vec<PathBuf>, ReportError> {
    let mut paths = vec![folder.write("result.json", json(run))?];
    if let (Some(first), Some(last)) = (run.epochs.first(), run.epochs.last()) {
        let name = rinex_obs::file_name(first.receive_time, last.receive_time, run.epochs.len());
        let summary = Summary::new(run.fixes, run.input.rate_hz());
        let of = match &summary {
            None => "no position was found".to_owned(),
            Some(s) => format!(
                "approximate position: {} of {} {}",
                if s.moving { "last" } else { "median" },
                s.fixes,
                if s.proved { "fixes" } else { "UNVERIFIED positions" }
            ),
        };
        let place_m = summary.map(|s| s.place_m).unwrap_or_default();
        let text = rinex_obs::write(run.epochs, place_m, &of);
        paths.push(folder.write(&name, text)?);
    }
    if !run.navigation.is_empty() {
        paths.push(folder.write("navigation.rnx", rinex_nav::write(run.navigation))?);
    }
    if !run.fixes.is_empty() {
        paths.push(folder.write("track.nmea", nmea(run))?);
        paths.push(folder.write("track.geojson", geojson(run))?);
        paths.push(folder.write("track.kml", kml(run))?);
    }
    if page {
        paths.push(folder.write("report.html", html(run)?)?);
    }
    Ok(paths)
}
