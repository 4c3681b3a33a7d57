//! Navigation messages: from the symbols of one signal to pages, and from pages to navigation data.

mod collector;
pub mod convolutional;
pub mod crc24q;
mod fields;
pub mod inav;
pub mod lnav;
pub mod sbas;
mod update;

pub use collector::NavigationCollector;
pub use update::Update;

/// Finds the pages of a navigation message in the symbols of one signal of one satellite.
pub trait MessageDecoder: Send {
    /// Takes the next symbol and gives the page that it completes, if any.
    ///
    /// The symbol is soft: its sign is the decision (positive is logical 0, or 1 when the Costas loop is
    /// locked half a cycle off), its magnitude the confidence, in any unit that stays the same. `index` counts the
    /// symbols of the caller; where it jumps, symbols were lost and the search starts again.
    fn push(&mut self, symbol: f32, index: u64) -> Option<Page>;
}

/// One page (message, subframe) as received.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    /// Index of its first symbol, as the caller counts.
    pub start_index: u64,
    /// Time of week of the transmission of its first symbol, s, in the time of the system that sends it,
    /// where the page gives it.
    pub tow_s: Option<f64>,
    /// Contents.
    pub content: Content,
}

/// Contents of a page, by the kind of navigation message.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// A subframe of the legacy message of GPS and QZSS.
    Lnav(lnav::Subframe),
    /// Words of a subframe that is not whole, or not yet.
    LnavWords(lnav::LooseWords),
    /// A message of SBAS L1.
    Sbas(Box<sbas::SbasMessage>),
    /// A page of Galileo E1-B.
    Inav(Box<inav::InavPage>),
}
