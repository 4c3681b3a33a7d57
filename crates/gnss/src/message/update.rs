//! What pages bring.

use crate::Sv;

/// New data from a page.
#[derive(Clone, Debug, PartialEq)]
pub enum Update {
    /// A new ephemeris of this satellite.
    Ephemeris(Sv),
    /// The ephemeris of this satellite that was made of single words is taken back: the rest of its subframe is not whole.
    Withdrawn(Sv),
    /// Ionosphere and UTC parameters, of GPS or Galileo.
    IonosphereUtc,
    /// The almanac of this satellite.
    Almanac(Sv),
    /// Health words of satellites.
    Health,
    /// A message of this type of an SBAS satellite.
    Sbas(Sv, u8),
}
