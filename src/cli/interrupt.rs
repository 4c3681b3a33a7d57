//! Ctrl-C ends the stream, not the program: results so far are written.

use sdr_rx::capture::{Block, Note, SampleSource, SourceError, StreamInfo};
use signal_hook::consts::SIGINT;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

/// Interval at which the interruption of a silent stream is checked.
const PATIENCE: Duration = Duration::from_millis(50);

/// Whether Ctrl-C was pressed; a second one ends the program at once.
#[derive(Clone)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Waits for Ctrl-C from now on.
    pub fn new() -> std::io::Result<Self> {
        let pressed = Arc::new(AtomicBool::new(false));
        signal_hook::flag::register_conditional_shutdown(SIGINT, 130, Arc::clone(&pressed))?;
        signal_hook::flag::register(SIGINT, Arc::clone(&pressed))?;
        Ok(Self(pressed))
    }

    /// Whether it was pressed.
    pub fn pressed(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

type Read = Result<(Block, Vec<Note>), SourceError>;

/// A source that is read by a thread of its own, one block ahead, and that ends at an interruption even while it
/// waits for samples.
pub struct Interruptible {
    info: StreamInfo,
    interrupt: Interrupt,
    blocks: Receiver<Read>,
    used: SyncSender<Block>,
    notes: Vec<Note>,
    ended: bool,
}

impl Interruptible {
    /// Reads `source` in blocks of so many samples.
    pub fn new(mut source: Box<dyn SampleSource>, samples: usize, interrupt: Interrupt) -> Self {
        let info = source.info().clone();
        let notes = source.notes();
        let (give, blocks) = sync_channel::<Read>(2);
        let (used, reuse) = sync_channel::<Block>(4);
        std::thread::spawn(move || {
            loop {
                let mut block = reuse.try_recv().unwrap_or_default();
                let read = source.read(&mut block, samples).map(|_| (block, source.notes()));
                let is_last = read.as_ref().map_or(true, |(block, _)| block.is_empty());
                // There is no receiver when the stream was interrupted.
                if give.send(read).is_err() || is_last {
                    break;
                }
            }
        });
        Self { info, interrupt, blocks, used, notes, ended: false }
    }
}

impl SampleSource for Interruptible {
    fn info(&self) -> &StreamInfo {
        &self.info
    }

    /// Gives the next block, of the length that the thread reads.
    fn read(&mut self, block: &mut Block, _samples: usize) -> Result<usize, SourceError> {
        while !self.ended && !self.interrupt.pressed() {
            match self.blocks.recv_timeout(PATIENCE) {
                Ok(read) => {
                    let (next, notes) = read?;
                    self.notes = notes;
                    self.ended = next.is_empty();
                    // When the channel is full there are enough blocks.
                    let _ = self.used.try_send(std::mem::replace(block, next));
                    return Ok(block.len());
                }
                Err(RecvTimeoutError::Timeout) => (),
                Err(RecvTimeoutError::Disconnected) => self.ended = true,
            }
        }
        block.truncate(0);
        Ok(0)
    }

    fn notes(&self) -> Vec<Note> {
        self.notes.clone()
    }
}
