//! Outputs never replace what somebody else needs.

use anyhow::bail;
use sdr_rx::report::{OutputDir, is_ours};
use std::path::{Path, PathBuf};

/// Refuses outputs that are inputs, or (without `force`) files that this program did not write. `-` is standard output.
///
/// # Errors
/// Which output it is, and why.
pub fn protect<'a>(
    outputs: impl IntoIterator<Item = &'a Path>,
    inputs: &[PathBuf],
    force: bool,
) -> anyhow::Result<()> {
    let read: Vec<PathBuf> = inputs
        .iter()
        .flat_map(|input| with_siblings(input))
        .filter_map(|p| p.canonicalize().ok())
        .collect();
    for output in outputs {
        let Ok(place) = output.canonicalize() else { continue };
        if read.contains(&place) {
            bail!("the output '{}' is an input, which it would replace", output.display());
        }
        if place.is_file() && !force && !is_replaceable(&place) {
            bail!(
                "the output '{}' exists, and sdr-rx did not write it: choose another name, or --force to replace it",
                output.display()
            );
        }
    }
    Ok(())
}

/// The same for the reports of a folder.
///
/// # Errors
/// As [`protect`].
pub fn protect_folder(folder: &OutputDir, inputs: &[PathBuf], force: bool) -> anyhow::Result<()> {
    let reports: Vec<PathBuf> = folder.reports().collect();
    protect(reports.iter().map(PathBuf::as_path), inputs, force)
}

/// A file, and what is read with it: of SigMF metadata the samples, and the other way round.
fn with_siblings(input: &Path) -> Vec<PathBuf> {
    let mut all = vec![input.to_owned()];
    if input.extension().is_some_and(|e| e == "sigmf-meta" || e == "sigmf-data") {
        all.extend(["sigmf-meta", "sigmf-data"].map(|suffix| input.with_extension(suffix)));
    }
    all
}

/// Whether this program wrote a file, or the truth of a simulated capture beside it.
fn is_replaceable(path: &Path) -> bool {
    let truth = path.with_extension("truth.json");
    is_ours(path) || (truth.is_file() && is_ours(&truth))
}

/// Arguments as clap shall see them: `--json` takes its value after an equals sign, or a name that ends in `.json`, or `-`;
/// anything else after it is a capture.
pub fn json_values(arguments: impl Iterator<Item = std::ffi::OsString>) -> Vec<std::ffi::OsString> {
    let mut all: Vec<std::ffi::OsString> = Vec::new();
    for argument in arguments {
        let is_value = argument == "-" || argument.to_string_lossy().ends_with(".json");
        match all.last_mut() {
            Some(last) if *last == "--json" && is_value => {
                last.push("=");
                last.push(argument);
            }
            _ => all.push(argument),
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_follows_json_is_its_value_only_where_it_cannot_be_a_capture() {
        let joined = |text: &str| {
            let words = text.split(' ').map(Into::into);
            let all = json_values(words);
            all.iter().map(|a| a.to_string_lossy()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(joined("process --json a.cs8 b.cs8"), "process --json a.cs8 b.cs8");
        assert_eq!(joined("process a.cs8 --json -"), "process a.cs8 --json=-");
        assert_eq!(joined("--json x.json a --json=y -r 4M"), "--json=x.json a --json=y -r 4M");
    }

    #[test]
    fn inputs_and_files_of_others_are_not_replaced() -> anyhow::Result<()> {
        let folder = tempfile::tempdir()?;
        let file = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).map(|()| path)
        };
        let capture = file("a.cs8", "samples")?;
        let ours = file("r.json", "{\"schema\":\"sdr-rx/1\"}")?;
        let new = folder.path().join("new.json");
        let refused = |output: &Path, force| {
            protect([output], std::slice::from_ref(&capture), force).is_err()
        };
        assert!(refused(&capture, false) && refused(&capture, true));
        assert!(!refused(&ours, false) && !refused(&new, false));
        // The samples that SigMF metadata name.
        let meta = file("b.sigmf-meta", "{}")?;
        let samples = file("b.sigmf-data", "sdr-rx")?;
        assert!(protect([samples.as_path()], &[meta], true).is_err());
        let other = file("notes.txt", "mine")?;
        assert!(refused(&other, false) && !refused(&other, true));
        Ok(())
    }
}
