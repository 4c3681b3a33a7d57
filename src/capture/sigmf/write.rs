//! Writes a SigMF recording: data and metadata appear under their names only when complete.

use super::document::{Capture, Global, Metadata};
use super::spatial;
use crate::capture::{Block, CaptureError, Datatype, StreamInfo};
use crate::gnss::GpsTime;
use crate::gnss::signal::L1_CENTRE_HZ;
use crate::temporary::temporary_beside;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A SigMF recording that is being written.
pub struct SigmfWriter {
    meta_path: PathBuf,
    data_path: PathBuf,
    data: BufWriter<NamedTempFile>,
    metadata: Metadata,
    datatype: Datatype,
    real: bool,
    channels: usize,
    numbers: Vec<f32>,
    bytes: Vec<u8>,
    clipped: u64,
    samples: u64,
}

impl SigmfWriter {
    /// Starts the recording `NAME.sigmf-meta` with its samples beside it in `NAME.sigmf-data`.
    ///
    /// Rate, number of channels, start time, real or complex, and the frequency at 0 Hz
    /// (L1 less the intermediate frequency), and the antenna array (without its errors) come from `info`.
    /// Samples are written unscaled: they must be at the levels of the quantiser.
    ///
    /// # Errors
    /// When `meta_path` does not end in `.sigmf-meta`, or its folder cannot be written.
    pub fn create(
        meta_path: &Path,
        info: &StreamInfo,
        datatype: Datatype,
        description: &str,
    ) -> Result<Self, CaptureError> {
        if meta_path.extension().is_none_or(|s| s != "sigmf-meta") {
            let reason = "the name of SigMF metadata must end in .sigmf-meta".to_owned();
            return Err(CaptureError::Unwritable { path: meta_path.to_owned(), reason });
        }
        let data_path = meta_path.with_extension("sigmf-data");
        let data = temporary_beside(&data_path)
            .map_err(|cause| CaptureError::Write { path: data_path.clone(), cause })?;
        let kind = if info.real { 'r' } else { 'c' };
        let number = match datatype {
            Datatype::I8 => "i8",
            Datatype::I16 => "i16_le",
            Datatype::F32 => "f32_le",
        };
        let mut global = Global {
            datatype: format!("{kind}{number}"),
            sample_rate: Some(info.rate_hz),
            version: "1.2.5".to_owned(),
            num_channels: (info.channels != 1).then_some(info.channels),
            description: Some(description.to_owned()),
            recorder: Some(format!("sdr-rx {}", env!("CARGO_PKG_VERSION"))),
            ..Global::default()
        };
        let mut capture = Capture {
            sample_start: 0,
            frequency: Some(L1_CENTRE_HZ - info.if_hz),
            datetime: info.start_time.map(utc_nanoseconds),
            ..Capture::default()
        };
        if let Some(array) = &info.array {
            spatial::describe(array, &mut global, &mut capture);
        }
        Ok(Self {
            meta_path: meta_path.to_owned(),
            data_path,
            data: BufWriter::with_capacity(256 * 1024, data),
            metadata: Metadata { global, captures: vec![capture], annotations: Vec::new() },
            datatype,
            real: info.real,
            channels: info.channels,
            numbers: Vec::new(),
            bytes: Vec::new(),
            clipped: 0,
            samples: 0,
        })
    }

    /// States the hardware (`core:hw`) that made the recording.
    pub fn hardware(mut self, hw: &str) -> Self {
        self.metadata.global.hw = Some(hw.to_owned());
        self
    }

    /// Appends a block, channels interleaved by sample.
    ///
    /// # Errors
    /// When the block has another number of channels than the stream, or the disk is full.
    pub fn write(&mut self, block: &Block) -> Result<(), CaptureError> {
        if block.channels() != self.channels {
            let reason = format!("a block of {} channels, not {}", block.channels(), self.channels);
            return Err(CaptureError::Unwritable { path: self.data_path.clone(), reason });
        }
        self.numbers.clear();
        self.bytes.clear();
        block.append_numbers(self.real, &mut self.numbers);
        self.clipped += self.datatype.encode(&self.numbers, &mut self.bytes);
        self.samples += block.len() as u64;
        self.data.write_all(&self.bytes).map_err(|e| self.failed(e))
    }

    /// Numbers (I or Q) that were clipped so far.
    pub fn clipped(&self) -> u64 {
        self.clipped
    }

    /// Samples of each channel written so far.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Completes the recording: data and metadata get their names.
    ///
    /// # Errors
    /// When the disk is full or the files cannot be renamed.
    pub fn finish(self) -> Result<(), CaptureError> {
        let failed = |path: &Path, cause| CaptureError::Write { path: path.to_owned(), cause };
        let file = self.data.into_inner().map_err(|e| failed(&self.data_path, e.into_error()))?;
        let mut meta = temporary_beside(&self.meta_path).map_err(|e| failed(&self.meta_path, e))?;
        serde_json::to_writer_pretty(&mut meta, &self.metadata)
            .map_err(|e| failed(&self.meta_path, e.into()))?;
        meta.write_all(b"\n").map_err(|e| failed(&self.meta_path, e))?;
        file.persist(&self.data_path).map_err(|e| failed(&self.data_path, e.error))?;
        meta.persist(&self.meta_path).map_err(|e| failed(&self.meta_path, e.error))?;
        Ok(())
    }

    fn failed(&self, cause: std::io::Error) -> CaptureError {
        CaptureError::Write { path: self.data_path.clone(), cause }
    }
}

/// UTC in ISO 8601 with nanoseconds.
fn utc_nanoseconds(t: GpsTime) -> String {
    let (y, mo, d, h, mi, s) = (t + 0.5e-9).utc_calendar();
    let ns = ((s.fract() * 1e9).floor() as u32).min(999_999_999);
    format!("{y:04}-{mo:02}-{d:02}T{h:02}:{mi:02}:{:02}.{ns:09}Z", s.floor() as u32)
}
