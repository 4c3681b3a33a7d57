//! Blocks of any length, regrouped into chunks of one length.

use crate::capture::Block;

/// Gathers blocks of any length into chunks of one.
pub(super) struct Chunks {
    size: usize,
    chunk: Block,
    filled: usize,
    position: u64,
}

impl Chunks {
    pub(super) fn new(size: usize) -> Self {
        Self { size: size.max(1), chunk: Block::default(), filled: 0, position: 0 }
    }

    /// Samples of a chunk.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// Samples taken so far.
    pub(super) fn position(&self) -> u64 {
        self.position + self.filled as u64
    }

    /// The full chunk, or the rest of the stream.
    pub(super) fn chunk(&mut self) -> &mut Block {
        &mut self.chunk
    }

    /// Takes samples of a block from its sample `used` on; whether the chunk is full. A block that is a chunk is
    /// exchanged, not copied.
    pub(super) fn take(&mut self, block: &mut Block, used: &mut usize) -> bool {
        if self.filled == 0 && *used == 0 && block.len() == self.size {
            *used = self.size;
            std::mem::swap(&mut self.chunk, block);
            return self.give();
        }
        if self.filled == 0 {
            self.chunk.reset(block.channels(), self.size, self.position);
        }
        let count = (block.len() - *used).min(self.size - self.filled);
        for c in 0..block.channels() {
            let from = &block.channel(c)[*used..*used + count];
            self.chunk.channel_mut(c)[self.filled..self.filled + count].copy_from_slice(from);
        }
        *used += count;
        self.filled += count;
        self.filled == self.size && self.give()
    }

    /// Makes a chunk of the rest of the stream; whether there is any.
    pub(super) fn rest(&mut self) -> bool {
        self.chunk.truncate(self.filled);
        self.filled > 0 && self.give()
    }

    fn give(&mut self) -> bool {
        self.chunk.set_first_sample(self.position);
        self.position += self.chunk.len() as u64;
        self.filled = 0;
        true
    }
}
