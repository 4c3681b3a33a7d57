//! Decoder of what the program `compress` writes (`.Z`): LZW with codes of 9 to 16 bits (T. A. Welch, "A Technique for
//! High-Performance Data Compression", 1984).
//!
//! Codes come lowest bit first, in groups of eight. A group ends early where the codes grow by a bit or the table is
//! cleared: the rest of its bytes is padding.

use std::io::{Error, ErrorKind, Read, Result};

/// First bytes of a file.
pub(super) const MAGIC: [u8; 2] = [0x1F, 0x9D];
/// The code that clears the table, in block mode.
const CLEAR: usize = 256;
const SHORTEST_CODE: u32 = 9;
const LONGEST_CODE: u32 = 16;
/// Bit of the header's third byte: there is a code that clears the table.
const BLOCK_MODE: u8 = 0x80;

/// The unpacked bytes of a compressed stream. What does not follow the format is [`ErrorKind::InvalidData`].
pub(super) struct LzwReader<R> {
    input: R,
    longest: u32,
    block_mode: bool,
    /// Bits of a code now.
    width: u32,
    /// The group of codes being read, and the bit after its last code taken.
    group: Vec<u8>,
    bit: usize,
    /// Of each code above 255: the code of all bytes but the last, and the last. Codes below stand for themselves.
    table: Vec<(u16, u8)>,
    /// The code before.
    previous: Option<usize>,
    /// First byte of the string before.
    first: u8,
    /// Bytes to be handed out, the next one last.
    pending: Vec<u8>,
}

impl<R: Read> LzwReader<R> {
    /// Reads the header.
    pub fn new(mut input: R) -> Result<Self> {
        let mut header = [0; 3];
        input.read_exact(&mut header)?;
        let longest = u32::from(header[2] & 0x1F);
        if header[..2] != MAGIC || !(SHORTEST_CODE..=LONGEST_CODE).contains(&longest) {
            return Err(invalid(format!("codes of {longest} bits; 9 to 16 are possible")));
        }
        let mut reader = Self {
            input,
            longest,
            block_mode: header[2] & BLOCK_MODE != 0,
            width: SHORTEST_CODE,
            group: Vec::new(),
            bit: 0,
            table: Vec::new(),
            previous: None,
            first: 0,
            pending: Vec::new(),
        };
        reader.clear();
        Ok(reader)
    }

    /// Empties the table.
    fn clear(&mut self) {
        self.table.clear();
        if self.block_mode {
            // Its own code takes a place.
            self.table.push((0, 0));
        }
        self.previous = None;
        self.set_width(SHORTEST_CODE);
    }

    /// Codes of another width start with a new group.
    fn set_width(&mut self, width: u32) {
        self.width = width;
        self.group.clear();
        self.bit = 0;
    }

    /// The code that the next entry of the table gets.
    fn free(&self) -> usize {
        256 + self.table.len()
    }

    /// The next code, none at the end of the stream.
    fn code(&mut self) -> Result<Option<usize>> {
        if self.free() >= 1 << self.width && self.width < self.longest {
            self.set_width(self.width + 1);
        }
        let width = self.width as usize;
        if self.bit + width > 8 * self.group.len() {
            self.group.clear();
            self.bit = 0;
            (&mut self.input).take(width as u64).read_to_end(&mut self.group)?;
            if 8 * self.group.len() < width {
                return match self.group.is_empty() {
                    true => Ok(None),
                    false => Err(ErrorKind::UnexpectedEof.into()),
                };
            }
        }
        let bit = |k: usize| usize::from(self.group[k / 8] >> (k % 8) & 1);
        let code = (0..width).fold(0, |code, k| code | bit(self.bit + k) << k);
        self.bit += width;
        Ok(Some(code))
    }

    /// Unpacks the next code; false at the end of the stream.
    fn unpack(&mut self) -> Result<bool> {
        let Some(code) = self.code()? else { return Ok(false) };
        if code == CLEAR && self.block_mode {
            self.clear();
            return Ok(true);
        }
        let mut at = code;
        match self.previous {
            // The code that is about to be defined: the string before, and its first byte once more.
            Some(previous) if code == self.free() => {
                self.pending.push(self.first);
                at = previous;
            }
            _ if code >= self.free() => {
                return Err(invalid(format!("code {code} comes before it is defined")));
            }
            _ => {}
        }
        while let Some(entry) = at.checked_sub(256) {
            let (before, last) = self.table[entry];
            self.pending.push(last);
            at = before.into();
        }
        self.first = at as u8;
        self.pending.push(self.first);
        if let Some(previous) = self.previous.filter(|_| self.free() < 1 << self.longest) {
            self.table.push((previous as u16, self.first));
        }
        self.previous = Some(code);
        Ok(true)
    }
}

fn invalid(problem: String) -> Error {
    Error::new(ErrorKind::InvalidData, problem)
}

impl<R: Read> Read for LzwReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        while self.pending.is_empty() && !buffer.is_empty() {
            if !self.unpack()? {
                return Ok(0);
            }
        }
        let count = buffer.len().min(self.pending.len());
        for byte in &mut buffer[..count] {
            *byte = self.pending.pop().unwrap_or_default();
        }
        Ok(count)
    }
}
