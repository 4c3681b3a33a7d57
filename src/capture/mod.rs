//! Recordings and live streams as blocks of complex baseband samples.

mod block;
mod datatype;
mod error;
mod file_source;
pub mod ion;
pub mod ion_bits;
mod lane;
mod note;
mod number;
mod open;
mod options;
mod packing;
mod sample_format;
pub mod sigmf;
mod source;
mod wav;

pub use block::Block;
pub use datatype::Datatype;
pub use error::CaptureError;
pub use note::Note;
pub use number::Number;
pub use open::open;
pub use options::{Layout, OpenOptions};
pub use packing::{BitOrder, Component, Encoding, Packing};
pub use sample_format::{FORMAT_NAMES, SampleFormat};
pub use sigmf::SigmfWriter;
pub use source::{SampleSource, SourceError, StreamInfo};
