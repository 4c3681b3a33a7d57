//! WAV recordings: hound reads the header, the rest is raw samples.
//!
//! One column is a real channel; 2N columns are I and Q of N channels.

use super::file_source::Description;
use super::lane::{Data, is_stdin};
use super::number::Number;
use super::{CaptureError, Note, SampleFormat};
use hound::{SampleFormat as WavFormat, WavReader, WavSpec};
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::Path;

/// Describes a WAV file, or a WAV stream on standard input whose header is read thereby.
pub(super) fn describe(path: &Path) -> Result<Description, CaptureError> {
    let data = Data::whole(path)?;
    if data.bytes == Some(0) {
        return Err(wrong(path, "it is empty"));
    }
    let (spec, offset, bytes) = if is_stdin(path) {
        let (spec, bytes, _) = header(io::stdin().lock(), path)?;
        (spec, 0, bytes)
    } else {
        let open = |cause| CaptureError::Open { path: path.to_owned(), cause };
        let (spec, bytes, mut file) = header(File::open(path).map_err(open)?, path)?;
        (spec, file.stream_position().map_err(open)?, bytes)
    };
    let (format, channels) = sample_format(spec, path)?;
    let mut notes = Vec::new();
    let present = data.bytes.map(|b| b.saturating_sub(offset));
    if let (Some(present), Some(stated)) = (present, bytes)
        && present < stated
    {
        notes.push(Note::WavCutOff { path: path.to_owned(), stated, present });
    }
    Ok(Description {
        format: Some(format),
        rate_hz: Some(f64::from(spec.sample_rate)),
        channels_per_file: Some(channels),
        notes,
        ..Description::unknown(data.part(offset, bytes))
    })
}

/// Reads the header: the specification, the stated bytes of samples (unless the writer could not
/// know them and left 0 or the largest number), and the reader at the first sample.
fn header<R: Read>(reader: R, path: &Path) -> Result<(WavSpec, Option<u64>, R), CaptureError> {
    let wav = WavReader::new(reader).map_err(|e| wrong(path, e))?;
    let spec = wav.spec();
    let bytes = u64::from(wav.len()) * u64::from(spec.bits_per_sample.div_ceil(8));
    let is_known = bytes > 0 && bytes < u64::from(u32::MAX) - 64;
    Ok((spec, is_known.then_some(bytes), wav.into_inner()))
}

fn sample_format(spec: WavSpec, path: &Path) -> Result<(SampleFormat, usize), CaptureError> {
    let number = match (spec.sample_format, spec.bits_per_sample) {
        (WavFormat::Int, 8) => Number::U8,
        (WavFormat::Int, 16) => Number::I16,
        (WavFormat::Int, 24) => Number::I24,
        (WavFormat::Int, 32) => Number::I32,
        (WavFormat::Float, 32) => Number::F32,
        (kind, bits) => {
            let reason = format!(
                "{bits}-bit {kind:?} samples are not supported: write 8, 16, 24 or 32-bit integers \
                 or 32-bit floating-point numbers"
            );
            return Err(wrong(path, reason));
        }
    };
    match spec.channels {
        1 => Ok((SampleFormat::numbers(number, false, true), 1)),
        n if n > 0 && n % 2 == 0 => {
            Ok((SampleFormat::numbers(number, false, false), usize::from(n / 2)))
        }
        n => Err(wrong(path, format!("it has {n} columns: 1 (real) or I and Q of each channel"))),
    }
}

fn wrong(path: &Path, reason: impl ToString) -> CaptureError {
    CaptureError::Wav { path: path.to_owned(), reason: reason.to_string() }
}
