//! Opening a capture of any kind.

use super::file_source::{Description, FileSource};
use super::lane::{Data, is_stdin};
use super::sigmf::joined;
use super::{CaptureError, Note, OpenOptions, SampleFormat, SampleSource, ion, sigmf, wav};
use std::path::{Path, PathBuf};

/// Opens the capture in `inputs` as a stream of blocks; memory does not grow with its length.
///
/// One input is a raw file (type by its suffix `.cu8 .cs8 .cs16 .cf32 ...` or by the options), a SigMF
/// `.sigmf-meta` or `.sigmf-data`, ION metadata `.sdrx .smfx .xml` (perhaps followed by data files in
/// place of those it names), a `.wav`, or `-` for standard input. Several inputs of one kind are one
/// channel (or group of channels) each.
///
/// # Errors
/// [`CaptureError`] names what is missing or inconsistent, and what is valid.
pub fn open(
    inputs: &[PathBuf],
    options: &OpenOptions,
) -> Result<Box<dyn SampleSource>, CaptureError> {
    options.check()?;
    let first = inputs.first().ok_or(CaptureError::NoInput)?;
    if inputs.len() > 1 && inputs.iter().any(|p| is_stdin(p)) {
        return Err(CaptureError::StdinWithOthers);
    }
    let asked_format = asked_format(options)?;
    let mut description = if matches!(suffix(first).as_str(), "sdrx" | "smfx" | "xml") {
        ion::describe(first, &inputs[1..], options)?
    } else {
        let described = inputs.iter().map(|p| describe_file(p, options));
        merge(described.collect::<Result<_, _>>()?)?
    };
    if let Some(format) = asked_format {
        if let Some(stated) = &description.format
            && stated.name() != format.name()
        {
            description.notes.push(Note::FormatOverridden {
                asked: format.name().to_owned(),
                stated: stated.name().to_owned(),
            });
        }
        description.format = Some(format);
    }
    Ok(Box::new(FileSource::open(description, options)?))
}

fn asked_format(options: &OpenOptions) -> Result<Option<SampleFormat>, CaptureError> {
    match options.format.as_deref() {
        None | Some("wav") => Ok(None),
        Some(name) => SampleFormat::named(name, options.bit_order, options.encoding)
            .map(Some)
            .ok_or_else(|| CaptureError::UnknownFormat(name.to_owned())),
    }
}

fn describe_file(path: &Path, options: &OpenOptions) -> Result<Description, CaptureError> {
    match suffix(path).as_str() {
        "sigmf-meta" | "sigmf-data" | "sigmf" => sigmf::describe(path, options),
        "wav" => wav::describe(path),
        _ if options.format.as_deref() == Some("wav") => wav::describe(path),
        suffix => {
            let name = match suffix {
                "cfile" | "fc32" => "cf32",
                "sc16" => "cs16",
                "sc8" => "cs8",
                other => other,
            };
            let format = SampleFormat::named(name, options.bit_order, options.encoding);
            Ok(Description { format, ..Description::unknown(Data::whole(path)?) })
        }
    }
}

/// Several files of one capture: all but their samples must be equal.
fn merge(described: Vec<Description>) -> Result<Description, CaptureError> {
    let mut all = described.into_iter();
    let mut merged = all.next().ok_or(CaptureError::NoInput)?;
    for other in all {
        let (a, b) = (&merged, &other);
        let name = |d: &Description| d.format.as_ref().map(|f| f.name().to_owned());
        let compared = [
            ("sample type", shown(name(a)), shown(name(b))),
            ("sample rate", shown(a.rate_hz), shown(b.rate_hz)),
            ("intermediate frequency", shown(a.if_hz), shown(b.if_hz)),
            ("number of channels", shown(a.channels_per_file), shown(b.channels_per_file)),
            ("time of the first sample", shown(a.start_time), shown(b.start_time)),
        ];
        for (what, first_value, second_value) in compared {
            if first_value != second_value {
                let [first, second] = [&merged, &other].map(|d| d.data[0].path.clone());
                return Err(CaptureError::FilesDiffer {
                    first,
                    second,
                    what,
                    first_value,
                    second_value,
                });
            }
        }
        merged.array = joined(merged.array, other.array);
        merged.data.extend(other.data);
        merged.notes.extend(other.notes);
    }
    Ok(merged)
}

fn shown(value: Option<impl ToString>) -> String {
    value.map_or_else(|| "unknown".to_owned(), |v| v.to_string())
}

/// Lower-case suffix of a file name without its dot.
fn suffix(path: &Path) -> String {
    path.extension().map(|s| s.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}
