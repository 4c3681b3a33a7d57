//! Files, written completely or not at all.

use super::{ReportError, Run, Summary, geojson, html, json, kml, nmea};
use crate::gnss::format::{rinex_nav, rinex_obs};
use crate::temporary::temporary_beside;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Writes a file under a temporary name beside `path` and renames it: a reader sees the old file or the
/// complete new one, also when the run is killed. A link's target is replaced, not the link; devices and pipes are
/// written to.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), ReportError> {
    let write = || -> std::io::Result<()> {
        // A path that does not exist yet is its own target.
        let target = path.canonicalize().unwrap_or(path.to_owned());
        if !is_replaceable(&target) {
            return std::fs::OpenOptions::new().write(true).open(&target)?.write_all(bytes);
        }
        let mut file = temporary_beside(&target)?;
        file.write_all(bytes)?;
        file.persist(&target)?;
        Ok(())
    };
    write().map_err(|source| ReportError::File { path: path.to_owned(), source })
}

/// Whether a file is empty or names this program near its start or end, as its files do; traces and NMEA have no room for a name.
pub fn is_ours(path: &Path) -> bool {
    const NAMED_WITHIN: u64 = 4096;
    const NAME: &[u8] = b"sdr-rx";
    const NAMELESS: [&[u8]; 2] = [b"gps_week,tow_s,", b"$GPRMC,"];
    let part = |from_end: bool| -> std::io::Result<Vec<u8>> {
        let mut file = std::fs::File::open(path)?;
        if from_end {
            let before = file.metadata()?.len().saturating_sub(NAMED_WITHIN);
            file.seek(SeekFrom::Start(before))?;
        }
        let mut bytes = Vec::new();
        file.take(NAMED_WITHIN).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    let (Ok(start), Ok(end)) = (part(false), part(true)) else { return false };
    let is_named = |bytes: &[u8]| bytes.windows(NAME.len()).any(|window| window == NAME);
    let is_nameless = NAMELESS.iter().any(|head| start.starts_with(head));
    start.is_empty() || is_named(&start) || is_named(&end) || is_nameless
}

/// Whether a path is free or an ordinary file, not a device or a pipe.
fn is_replaceable(path: &Path) -> bool {
    std::fs::metadata(path).map_or(true, |data| data.is_file())
}

/// Checks whether a file can be written.
///
/// # Errors
/// When it cannot.
pub fn write_check(path: &Path) -> Result<(), ReportError> {
    let target = path.canonicalize().unwrap_or(path.to_owned());
    if !is_replaceable(&target) && !target.is_dir() {
        return Ok(());
    }
    let found = temporary_beside(&target);
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

    /// The files in the folder that have names of reports.
    pub fn reports(&self) -> impl Iterator<Item = PathBuf> {
        const NAMES: [&str; 6] = [
            "result.json",
            "navigation.rnx",
            "track.nmea",
            "track.geojson",
            "track.kml",
            "report.html",
        ];
        let is_report = |path: &PathBuf| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            NAMES.contains(&name.as_ref()) || rinex_obs::is_file_name(&name)
        };
        let entries = std::fs::read_dir(&self.path).into_iter().flatten().flatten();
        entries.map(|entry| entry.path()).filter(is_report)
    }

    /// Removes reports of an earlier run that are not among `written`.
    fn remove_others(&self, written: &[PathBuf]) -> Result<(), ReportError> {
        let is_other = |path: &PathBuf| is_ours(path) && !written.contains(path);
        for path in self.reports().filter(is_other) {
            std::fs::remove_file(&path)
                .map_err(|source| ReportError::File { path: path.clone(), source })?;
        }
        Ok(())
    }

    /// Writes one file into the folder and gives its path.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<PathBuf, ReportError> {
        let path = self.path.join(name);
        write_atomically(&path, bytes.as_ref()).map(|()| path)
    }
}

/// Writes every report for which the run has data: `result.json` always; RINEX observations and
/// navigation; `track.nmea`, `track.geojson`, `track.kml` where there is a fix; `report.html` if asked.
/// Files of an earlier run that this one does not write are removed. Gives the paths in the order written.
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
    folder.remove_others(&paths)?;
    Ok(paths)
}
