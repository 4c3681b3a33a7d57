//! Files and pipes as a source of samples.

use super::lane::{Data, Lane};
use super::options::{Layout, OpenOptions, check_rate};
use super::{Block, CaptureError, Note, SampleFormat, SampleSource, SourceError, StreamInfo};
use crate::gnss::GpsTime;
use crate::gnss::antenna::ArrayDescription;
use std::path::Path;

/// A capture according to metadata, name or header; what is `None` must come from the options.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Description {
    pub format: Option<SampleFormat>,
    pub rate_hz: Option<f64>,
    pub if_hz: Option<f64>,
    pub channels_per_file: Option<usize>,
    pub start_time: Option<GpsTime>,
    pub array: Option<ArrayDescription>,
    pub data: Vec<Data>,
    pub notes: Vec<Note>,
}

impl Description {
    /// A file without metadata.
    pub fn unknown(data: Data) -> Self {
        Self {
            format: None,
            rate_hz: None,
            if_hz: None,
            channels_per_file: None,
            start_time: None,
            array: None,
            data: vec![data],
            notes: Vec::new(),
        }
    }
}

/// The samples of a capture in one or more files, or of standard input.
pub struct FileSource {
    info: StreamInfo,
    lanes: Vec<Lane>,
    channels_per_lane: usize,
    position: u64,
    limit: u64,
    ended: bool,
    notes: Vec<Note>,
}

impl FileSource {
    /// Joins the description with the options, and opens the data.
    pub(super) fn open(
        described: Description,
        options: &OpenOptions,
    ) -> Result<Self, CaptureError> {
        let Description { data, mut notes, .. } = described;
        let path = data.first().map(|d| d.path.clone()).ok_or(CaptureError::NoInput)?;
        let mut format =
            described.format.ok_or_else(|| CaptureError::FormatNeeded(path.clone()))?;
        let stated = described.rate_hz.map(|r| (r, "sample rate"));
        let rate_hz = prefer(options.rate_hz, stated, &mut notes)
            .ok_or_else(|| CaptureError::RateNeeded(path.clone()))?;
        check_rate(rate_hz)?;
        let stated = described.if_hz.map(|f| (f, "intermediate frequency"));
        let if_hz = match prefer(options.if_hz, stated, &mut notes) {
            Some(f) => f,
            None if format.is_real() => {
                return Err(CaptureError::IfNeeded { path, format: format.name().to_owned() });
            }
            None => 0.0,
        };
        if if_hz.abs() > rate_hz / 2.0 {
            notes.push(Note::Aliased { if_hz, rate_hz });
        }
        if options.conjugate {
            format = format.conjugated();
        }
        let (data, channels_per_lane) =
            arrange(data, &format, described.channels_per_file, options)?;
        let lengths: Vec<Option<u64>> =
            data.iter().map(|d| whole_samples(d, &format, channels_per_lane)).collect();
        for (d, length) in data.iter().zip(&lengths) {
            if *length == Some(0) {
                let (path, bytes) = (d.path.clone(), d.bytes.unwrap_or(0));
                return Err(CaptureError::Empty { path, bytes, format: format.name().to_owned() });
            }
        }
        notes.extend(data.iter().filter_map(|d| {
            let trailing = trailing_bytes(d, &format, channels_per_lane)?;
            (trailing > 0).then(|| trailing_note(&d.path, trailing, &format, channels_per_lane))
        }));
        let length = lengths.iter().copied().min().flatten();
        if let (Some(shortest), Some(longest)) = (length, lengths.iter().copied().max().flatten())
            && shortest != longest
        {
            notes.push(Note::LengthsDiffer { shortest, longest });
        }
        let skip = (options.start_s * rate_hz).round() as u64;
        if length.is_some_and(|length| skip >= length) {
            let length_s = length.unwrap_or(0) as f64 / rate_hz;
            return Err(CaptureError::StartBeyondEnd { path, start_s: options.start_s, length_s });
        }
        let left = length.map(|l| l - skip);
        let asked = options.duration_s.map(|d| ((d * rate_hz).round() as u64).max(1));
        if let (Some(left), Some(asked)) = (left, asked)
            && asked > left
        {
            let (asked_s, given_s) = (asked as f64 / rate_hz, left as f64 / rate_hz);
            notes.push(Note::Shorter { asked_s, given_s });
        }
        let lanes = data
            .iter()
            .map(|d| Lane::open(d, &format, channels_per_lane, skip))
            .collect::<Result<Vec<_>, _>>()?;
        let mirrored_real = options.conjugate && format.is_real();
        let info = StreamInfo {
            rate_hz,
            if_hz: if mirrored_real { -if_hz } else { if_hz },
            channels: lanes.len() * channels_per_lane,
            real: format.is_real(),
            samples: left.map(|l| asked.map_or(l, |a| a.min(l))),
            start_time: options
                .start_time
                .or(described.start_time)
                .map(|t| t + skip as f64 / rate_hz),
            format: format.name().to_owned(),
            array: described.array.filter(|a| a.len() == lanes.len() * channels_per_lane),
        };
        let limit = [left, asked].into_iter().flatten().min().unwrap_or(u64::MAX);
        Ok(Self { info, lanes, channels_per_lane, position: 0, limit, ended: false, notes })
    }
}

impl SampleSource for FileSource {
    fn info(&self) -> &StreamInfo {
        &self.info
    }

    fn read(&mut self, block: &mut Block, samples: usize) -> Result<usize, SourceError> {
        let left = usize::try_from(self.limit - self.position).unwrap_or(usize::MAX);
        let wanted = samples.min(left);
        block.reset(self.info.channels, wanted, self.position);
        let mut got = wanted;
        for (k, lane) in self.lanes.iter_mut().enumerate() {
            got = got.min(lane.read(block, k * self.channels_per_lane, wanted)?);
        }
        block.truncate(got);
        self.position += got as u64;
        self.ended = got < samples;
        Ok(got)
    }

    fn notes(&self) -> Vec<Note> {
        let mut all = self.notes.clone();
        for lane in &self.lanes {
            if lane.not_finite > 0 {
                let (path, format) = (lane.path().to_owned(), self.info.format.clone());
                all.push(Note::NotFinite { path, numbers: lane.not_finite, format });
            }
            if lane.trailing > 0 {
                let (trailing, channels) = (lane.trailing as u64, self.channels_per_lane);
                all.push(trailing_note(lane.path(), trailing, lane.format(), channels));
            }
        }
        match self.info.samples {
            _ if self.ended && self.position == 0 => all.push(Note::NoSample),
            Some(samples) if self.ended && self.position < samples => {
                all.push(Note::CutOff { read: self.position, samples });
            }
            _ => {}
        }
        all
    }
}

/// The option, else the capture's own value; a difference is noted.
fn prefer(
    asked: Option<f64>,
    stated: Option<(f64, &'static str)>,
    notes: &mut Vec<Note>,
) -> Option<f64> {
    if let (Some(a), Some((s, what))) = (asked, stated)
        && (a - s).abs() > 1e-9 * s.abs()
    {
        notes.push(Note::Overridden { what, asked_hz: a, stated_hz: s });
    }
    asked.or(stated.map(|(value, _)| value))
}

/// The lanes to read, and the channels of each.
fn arrange(
    data: Vec<Data>,
    format: &SampleFormat,
    channels_per_file: Option<usize>,
    options: &OpenOptions,
) -> Result<(Vec<Data>, usize), CaptureError> {
    let found = match (channels_per_file, data.len()) {
        (Some(n), files) => Some(n * files),
        (None, 1) => None,
        (None, files) => Some(files),
    };
    if let (Some(asked), Some(found)) = (options.channels, found)
        && asked != found
    {
        let what = if channels_per_file.is_some() { "the metadata" } else { "the number of files" };
        return Err(CaptureError::ChannelMismatch { asked, found, what: what.to_owned() });
    }
    let per_file = found.or(options.channels).unwrap_or(1) / data.len();
    match &data[..] {
        [file] if options.layout == Some(Layout::Planar) && per_file > 1 => {
            Ok((planes(file, format, per_file)?, 1))
        }
        _ => Ok((data, per_file)),
    }
}

/// The planes of a planar file.
fn planes(file: &Data, format: &SampleFormat, channels: usize) -> Result<Vec<Data>, CaptureError> {
    let path = || file.path.clone();
    let bytes = file.bytes.ok_or_else(|| CaptureError::PlanarStream(path()))?;
    if bytes % (channels * format.word_bytes()) as u64 != 0 {
        let format = format.name().to_owned();
        return Err(CaptureError::PlanarLength { path: path(), bytes, channels, format });
    }
    let plane = bytes / channels as u64;
    Ok((0..channels as u64).map(|c| file.clone().part(c * plane, Some(plane))).collect())
}

/// Whole samples of each channel, where the length is known.
fn whole_samples(data: &Data, format: &SampleFormat, channels: usize) -> Option<u64> {
    let words = data.bytes? / format.word_bytes() as u64;
    Some(words * format.samples_per_word() as u64 / channels as u64)
}

/// Bytes after the last whole sample of all channels, where the length is known.
fn trailing_bytes(data: &Data, format: &SampleFormat, channels: usize) -> Option<u64> {
    let units = whole_samples(data, format, channels)? * channels as u64;
    let words = units.div_ceil(format.samples_per_word() as u64);
    Some(data.bytes? - words * format.word_bytes() as u64)
}

fn trailing_note(path: &Path, bytes: u64, format: &SampleFormat, channels: usize) -> Note {
    Note::Trailing { path: path.to_owned(), bytes, format: format.name().to_owned(), channels }
}
