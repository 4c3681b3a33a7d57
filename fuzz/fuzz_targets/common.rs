//! What the targets share: a folder of files that the fuzzer wrote, opened as a capture.

use sdr_rx::capture::{self, Block, OpenOptions};
use std::path::PathBuf;

/// Writes the files, opens the first and reads the start of it. Any error is fine, a panic is not.
pub fn open_and_read(files: &[(&str, &[u8])], options: &OpenOptions) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).expect("a temporary file");
    }
    let inputs: [PathBuf; 1] = [folder.path().join(files[0].0)];
    if let Ok(mut source) = capture::open(&inputs, options) {
        let mut block = Block::default();
        for samples in [1, 7, 1000] {
            if !matches!(source.read(&mut block, samples), Ok(n) if n > 0) {
                break;
            }
        }
        let _ = source.notes();
    }
}
