//! Samples as plain bytes, for pipes and for receivers that read no metadata.

use crate::capture::{Block, Datatype};
use multiversion::multiversion;
use std::io::{self, Write};

/// A raw sample type, channels interleaved by sample, I before Q, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RawFormat {
    /// 8-bit integers.
    Cs8,
    /// 16-bit integers.
    Cs16,
    /// Single precision.
    Cf32,
    /// One bit, 1 = negative: 4 complex samples a byte, most significant bit first.
    B1,
}

impl RawFormat {
    /// The format of a file name's suffix: `cs8`, `cs16`, `cf32` or `b1`.
    pub fn from_suffix(suffix: &str) -> Option<Self> {
        match suffix {
            "cs8" => Some(Self::Cs8),
            "cs16" => Some(Self::Cs16),
            "cf32" => Some(Self::Cf32),
            "b1" => Some(Self::B1),
            _ => None,
        }
    }
}

/// Writes blocks as raw bytes.
pub struct RawWriter<W> {
    output: W,
    format: RawFormat,
    rails: Vec<f32>,
    bytes: Vec<u8>,
}

impl<W: Write> RawWriter<W> {
    /// A writer to `output`, which should take large pieces.
    pub fn new(output: W, format: RawFormat) -> Self {
        Self { output, format, rails: Vec::new(), bytes: Vec::new() }
    }

    /// Appends a block; integers are rounded and clipped. One-bit samples that do not fill a byte wait for
    /// the next.
    ///
    /// # Errors
    /// Those of the output.
    pub fn write(&mut self, block: &Block) -> io::Result<()> {
        block.append_numbers(false, &mut self.rails);
        self.bytes.clear();
        let whole = match self.format {
            RawFormat::B1 => self.rails.len() / 8 * 8,
            _ => self.rails.len(),
        };
        encode(self.format, &self.rails[..whole], &mut self.bytes);
        self.rails.drain(..whole);
        self.output.write_all(&self.bytes)
    }

    /// Ends the stream (an unfinished byte of one-bit samples is filled with zeros) and gives back
    /// the output.
    ///
    /// # Errors
    /// Those of the output.
    pub fn finish(mut self) -> io::Result<W> {
        self.bytes.clear();
        encode(self.format, &self.rails, &mut self.bytes);
        self.output.write_all(&self.bytes)?;
        self.output.flush()?;
        Ok(self.output)
    }
}

fn encode(format: RawFormat, rails: &[f32], bytes: &mut Vec<u8>) {
    let datatype = match format {
        RawFormat::Cs8 => Datatype::I8,
        RawFormat::Cs16 => Datatype::I16,
        RawFormat::Cf32 => Datatype::F32,
        RawFormat::B1 => return signs(rails, bytes),
    };
    datatype.encode(rails, bytes);
}

#[multiversion(targets("x86_64+avx2", "aarch64+neon"))]
fn signs(rails: &[f32], bytes: &mut Vec<u8>) {
    let sign = |&x: &f32| u8::from(x < 0.0);
    let byte = |c: &[f32]| (0..8).fold(0, |b, k| b << 1 | c.get(k).map_or(0, sign));
    bytes.extend(rails.chunks(8).map(byte));
}
