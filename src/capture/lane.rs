//! One sequence of bytes, such as a file, a plane of it or a pipe, as samples of one or more channels.

use super::{Block, CaptureError, SampleFormat};
use num_complex::Complex32;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes read at once: large enough that the cost of a system call is negligible.
const CHUNK_BYTES: usize = 256 * 1024;

/// Where the bytes of a lane are: a part of a file, or a stream.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Data {
    /// The file, or `-`.
    pub path: PathBuf,
    /// First byte of the samples.
    pub offset: u64,
    /// Number of bytes, where known.
    pub bytes: Option<u64>,
    /// Whether it is a regular file.
    pub seekable: bool,
}

impl Data {
    /// A whole file (its length looked up where it is a regular one) or standard input.
    pub fn whole(path: &Path) -> Result<Self, CaptureError> {
        if is_stdin(path) {
            return Ok(Self { path: path.to_owned(), offset: 0, bytes: None, seekable: false });
        }
        let metadata = std::fs::metadata(path)
            .map_err(|cause| CaptureError::Open { path: path.to_owned(), cause })?;
        if metadata.is_dir() {
            return Err(CaptureError::Directory(path.to_owned()));
        }
        let seekable = metadata.is_file();
        let bytes = seekable.then_some(metadata.len());
        Ok(Self { path: path.to_owned(), offset: 0, bytes, seekable })
    }

    /// The part from byte `offset`, at most `bytes` long.
    pub fn part(self, offset: u64, bytes: Option<u64>) -> Self {
        let rest = self.bytes.map(|b| b.saturating_sub(offset));
        let bytes = [rest, bytes].into_iter().flatten().min();
        Self { offset: self.offset.saturating_add(offset), bytes, ..self }
    }

    /// The bytes, from the first on: by seeking in a regular file, else by reading what goes before.
    fn reader(&self) -> io::Result<Box<dyn Read + Send>> {
        let limit = self.bytes.unwrap_or(u64::MAX);
        let mut input: Box<dyn Read + Send> = if is_stdin(&self.path) {
            Box::new(io::stdin())
        } else {
            let mut file = File::open(&self.path)?;
            if self.seekable {
                file.seek(SeekFrom::Start(self.offset))?;
                return Ok(Box::new(file.take(limit)));
            }
            Box::new(file)
        };
        io::copy(&mut (&mut input).take(self.offset), &mut io::sink())?;
        Ok(Box::new(input.take(limit)))
    }
}

/// Whether a path stands for standard input.
pub(super) fn is_stdin(path: &Path) -> bool {
    path == Path::new("-")
}

/// Reads the interleaved samples of `channels` channels.
pub(super) struct Lane {
    reader: Box<dyn Read + Send>,
    path: PathBuf,
    format: SampleFormat,
    channels: usize,
    bytes: Vec<u8>,
    start: usize,
    end: usize,
    consumed: u64,
    carry: Vec<Complex32>,
    interleaved: Vec<Complex32>,
    /// Numbers replaced by zero because they were NaN or infinite.
    pub not_finite: u64,
    /// Bytes at the end that make no whole sample.
    pub trailing: usize,
}

impl Lane {
    /// Opens `data` and skips `skip` samples of each channel: by seeking where the length is known,
    /// else by reading.
    pub fn open(
        data: &Data,
        format: &SampleFormat,
        channels: usize,
        skip: u64,
    ) -> Result<Self, CaptureError> {
        let fail = |cause| CaptureError::Open { path: data.path.clone(), cause };
        let per_word = format.samples_per_word() as u64;
        let units = skip.saturating_mul(channels as u64);
        let skip_bytes = (units / per_word).saturating_mul(format.word_bytes() as u64);
        let reader = data.clone().part(skip_bytes, None).reader().map_err(fail)?;
        let word = format.word_bytes();
        let mut lane = Self {
            reader,
            path: data.path.clone(),
            format: format.clone(),
            channels,
            bytes: vec![0; CHUNK_BYTES.next_multiple_of(word)],
            start: 0,
            end: 0,
            consumed: data.offset.saturating_add(skip_bytes),
            carry: Vec::new(),
            interleaved: Vec::new(),
            not_finite: 0,
            trailing: 0,
        };
        let mut rest = vec![Complex32::ZERO; (units % per_word) as usize];
        lane.fill(&mut rest)?;
        Ok(lane)
    }

    /// Reads up to `samples` samples of each channel to the start of the channels of `block` from
    /// `first_channel` on; fewer only at the end.
    pub fn read(
        &mut self,
        block: &mut Block,
        first_channel: usize,
        samples: usize,
    ) -> Result<usize, CaptureError> {
        if self.channels == 1 {
            return self.fill(&mut block.channel_mut(first_channel)[..samples]);
        }
        let mut interleaved = std::mem::take(&mut self.interleaved);
        interleaved.resize(samples * self.channels, Complex32::ZERO);
        let filled = self.fill(&mut interleaved)?;
        let whole = filled / self.channels;
        self.trailing += (filled % self.channels) * self.format.word_bytes();
        for c in 0..self.channels {
            let of_channel = interleaved[c.min(filled)..].iter().step_by(self.channels);
            let out = &mut block.channel_mut(first_channel + c)[..whole];
            out.iter_mut().zip(of_channel).for_each(|(o, x)| *o = *x);
        }
        self.interleaved = interleaved;
        Ok(whole)
    }

    /// Decodes the next samples as they lie in the file until `out` is full or the data end.
    fn fill(&mut self, out: &mut [Complex32]) -> Result<usize, CaptureError> {
        let (word, per_word) = (self.format.word_bytes(), self.format.samples_per_word());
        let mut done = 0;
        while done < out.len() {
            if !self.carry.is_empty() {
                let n = self.carry.len().min(out.len() - done);
                out[done..done + n].copy_from_slice(&self.carry[..n]);
                self.carry.drain(..n);
                done += n;
                continue;
            }
            if self.end - self.start < word {
                self.refill()?;
                if self.end - self.start < word {
                    self.trailing = self.end - self.start;
                    break;
                }
            }
            let ready = (self.end - self.start) / word;
            let wanted = (out.len() - done) / per_word;
            let words = ready.min(wanted.max(1));
            let bytes = &self.bytes[self.start..self.start + words * word];
            if wanted == 0 {
                self.carry.resize(per_word, Complex32::ZERO);
                self.not_finite += self.format.decode(bytes, &mut self.carry);
            } else {
                let samples = words * per_word;
                self.not_finite += self.format.decode(bytes, &mut out[done..done + samples]);
                done += samples;
            }
            self.start += words * word;
        }
        Ok(done)
    }

    /// Moves what is left to the front of the buffer and reads until it holds a word, or to the end.
    fn refill(&mut self) -> Result<(), CaptureError> {
        self.bytes.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        while self.end < self.format.word_bytes() {
            match self.reader.read(&mut self.bytes[self.end..]) {
                Ok(0) => break,
                Ok(n) => {
                    self.end += n;
                    self.consumed += n as u64;
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(cause) => {
                    let path = self.path.clone();
                    return Err(CaptureError::Read { path, byte: self.consumed, cause });
                }
            }
        }
        Ok(())
    }

    /// Its sample type.
    pub fn format(&self) -> &SampleFormat {
        &self.format
    }

    /// The file, or `-`.
    pub fn path(&self) -> &Path {
        &self.path
    }
}
