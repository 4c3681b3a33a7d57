//! Samples as plain bytes, for pipes and for receivers that know no metadata.

use crate::capture::Block;
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
    bytes: Vec<u8>,
    bits: u8,
    pending: u32,
}

impl<W: Write> RawWriter<W> {
    /// A writer to `output`, which should be buffered or take large pieces.
    pub fn new(output: W, format: RawFormat) -> Self {
        Self { output, format, bytes: Vec::new(), bits: 0, pending: 0 }
    }

    /// Appends a block; integers are rounded and clipped.
    ///
    /// # Errors
    /// Those of the output.
    pub fn write(&mut self, block: &Block) -> io::Result<()> {
        self.bytes.clear();
        let channels: Vec<_> = (0..block.channels()).map(|c| block.channel(c)).collect();
        for k in 0..block.len() {
            for sample in channels.iter().map(|c| c[k]) {
                self.push(sample.re);
                self.push(sample.im);
            }
        }
        self.output.write_all(&self.bytes)
    }

    fn push(&mut self, x: f32) {
        match self.format {
            RawFormat::Cs8 => self.bytes.push((x + 0.5).floor().clamp(-127.0, 127.0) as i8 as u8),
            RawFormat::Cs16 => {
                let level = (x + 0.5).floor().clamp(-32767.0, 32767.0) as i16;
                self.bytes.extend(level.to_le_bytes());
            }
            RawFormat::Cf32 => self.bytes.extend(x.to_le_bytes()),
            RawFormat::B1 => {
                self.bits = self.bits << 1 | u8::from(x < 0.0);
                self.pending += 1;
                if self.pending == 8 {
                    self.bytes.push(self.bits);
                    self.pending = 0;
                }
            }
        }
    }

    /// Ends the stream (an unfinished byte of one-bit samples is filled with zeros) and gives back
    /// the output.
    ///
    /// # Errors
    /// Those of the output.
    pub fn finish(mut self) -> io::Result<W> {
        if self.pending > 0 {
            self.output.write_all(&[self.bits << (8 - self.pending)])?;
        }
        self.output.flush()?;
        Ok(self.output)
    }
}
