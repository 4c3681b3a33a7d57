//! Files that gzip or compress packed, read as they were before. What a file is its first bytes say, not its name.

use super::lzw::{self, LzwReader};
use flate2::bufread::MultiGzDecoder;
use std::io::{BufRead, BufReader, Cursor, Error, ErrorKind, Read, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The most that a packed observation file may unpack to, bytes: 4 GiB, some four days of all satellites each second.
pub const MOST_UNPACKED_BYTES: u64 = 4 << 30;
/// The most that a file may have that is held in memory (navigation, SP3, element sets), unpacked or not, bytes: 256 MiB,
/// ten times a day of all broadcast ephemerides of the world.
pub const MOST_TEXT_BYTES: u64 = 256 << 20;

/// Bytes by which a packing is known.
const HEAD: u64 = 6;

/// Bytes of a file, unpacked.
pub(crate) type Unpacked<'a> = Box<dyn BufRead + Send + 'a>;

/// The bytes of `input`, unpacked where they are packed; beyond `limit` bytes that are unpacked they are an error of
/// [`ErrorKind::FileTooLarge`].
pub(crate) fn unpack<'a>(input: impl BufRead + Send + 'a, limit: u64) -> Result<Unpacked<'a>> {
    let mut input = input;
    let mut head = Vec::new();
    input.by_ref().take(HEAD).read_to_end(&mut head)?;
    let packer = packer(&head);
    let whole = Cursor::new(head).chain(input);
    match packer {
        None => Ok(Box::new(whole)),
        Some(Packer::Gzip) => Ok(Box::new(bounded(MultiGzDecoder::new(whole), limit))),
        Some(Packer::Compress) => Ok(Box::new(bounded(LzwReader::new(whole)?, limit))),
        Some(Packer::Other(name)) => {
            let problem = format!("it is packed by {name}; unpack it first, or pack it by gzip");
            Err(Error::new(ErrorKind::Unsupported, problem))
        }
    }
}

enum Packer {
    Gzip,
    Compress,
    /// One whose files are not read.
    Other(&'static str),
}

fn packer(head: &[u8]) -> Option<Packer> {
    const OTHERS: [(&[u8], &str); 4] = [
        (b"PK\x03\x04", "zip"),
        (b"BZh", "bzip2"),
        (b"\xFD7zXZ", "xz"),
        (b"\x28\xB5\x2F\xFD", "zstd"),
    ];
    match head {
        [0x1F, 0x8B, ..] => Some(Packer::Gzip),
        _ if head.starts_with(&lzw::MAGIC) => Some(Packer::Compress),
        _ => OTHERS.iter().find(|o| head.starts_with(o.0)).map(|o| Packer::Other(o.1)),
    }
}

/// A reader that counts the bytes read, for whom it may concern.
pub(crate) struct Counted<R> {
    pub input: R,
    pub count: Arc<AtomicU64>,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let count = self.input.read(buffer)?;
        self.count.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}

/// Whether an error means that what is packed ends early or is damaged: what came before is good.
pub(crate) fn is_damage(error: &Error) -> bool {
    use ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
    matches!(error.kind(), InvalidData | InvalidInput | UnexpectedEof)
}

/// At most `limit` bytes of `input`.
pub(crate) fn bounded<R: Read>(input: R, limit: u64) -> BufReader<Bounded<R>> {
    BufReader::with_capacity(1 << 16, Bounded { input, limit, left: limit })
}

/// A reader that fails where there are more bytes than it may hand out.
pub(crate) struct Bounded<R> {
    input: R,
    limit: u64,
    left: u64,
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let count = self.input.read(buffer)?;
        self.left = self.left.checked_sub(count as u64).ok_or_else(|| {
            let mib = self.limit >> 20;
            let problem = format!("it has more than {mib} MiB, the most that is read; split it");
            Error::new(ErrorKind::FileTooLarge, problem)
        })?;
        Ok(count)
    }
}

#[cfg(test)]
mod tests;
