//! Secondary codes.

/// Secondary code: one chip, +1 or -1, a period of the primary code. Its first chip is sent where the time of week of
/// its system is a multiple of its length: each length divides a week.
#[derive(Clone, Copy, Debug)]
pub enum Overlay {
    /// None.
    None,
    /// The same of all satellites.
    Shared(&'static [i8]),
    /// That of the satellite of this number; none of a satellite that sends the signal without.
    PerSatellite(fn(u8) -> Option<Box<[i8]>>),
}

impl Overlay {
    /// One period of the code of the satellite of this number.
    pub fn chips(&self, number: u8) -> Option<Box<[i8]>> {
        match self {
            Self::None => None,
            Self::Shared(chips) => Some((*chips).into()),
            Self::PerSatellite(chips) => chips(number),
        }
    }
}
