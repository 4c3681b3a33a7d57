//! Satellite identities.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// A satellite system.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Constellation {
    /// GPS, G01 to G32.
    Gps,
    /// QZSS, J01 to J10: PRN 193 to 202.
    Qzss,
    /// SBAS, S20 to S58: PRN 120 to 158.
    Sbas,
    /// Galileo, E01 to E36 (OS SIS ICD 2.1, 5.1.9.1: SVID 1 to 36).
    Galileo,
    /// BeiDou, C01 to C63 (BDS-SIS-ICD-B1I-3.0 table 4-1).
    BeiDou,
    /// GLONASS, R01 to R24: orbital slots.
    Glonass,
}

impl Constellation {
    /// All systems, in the order in which their satellites are listed.
    pub const ALL: [Self; 6] =
        [Self::Gps, Self::Qzss, Self::Sbas, Self::Galileo, Self::BeiDou, Self::Glonass];

    /// Those whose signals a receiver can search today.
    const RECEIVED: [Self; 4] = [Self::Gps, Self::Qzss, Self::Sbas, Self::Galileo];

    /// Those that send C/A codes, whose PRN numbers are of one series.
    const OF_CA_CODES: [Self; 3] = [Self::Gps, Self::Qzss, Self::Sbas];

    /// Its letter in RINEX, the numbers of its satellites there, and what is added to them to give the PRN
    /// number (RINEX 3.04 section 3.5).
    fn naming(self) -> (char, RangeInclusive<u8>, u8) {
        match self {
            Self::Gps => ('G', 1..=32, 0),
            Self::Qzss => ('J', 1..=10, 192),
            Self::Sbas => ('S', 20..=58, 100),
            Self::Galileo => ('E', 1..=36, 0),
            Self::BeiDou => ('C', 1..=63, 0),
            Self::Glonass => ('R', 1..=24, 0),
        }
    }

    /// Its letter in RINEX.
    pub fn letter(self) -> char {
        self.naming().0
    }
}

/// A satellite, by its system and its number there. In the order of systems, then of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Sv {
    constellation: Constellation,
    number: u8,
}

impl Sv {
    /// The satellite of this number, if the system has one.
    pub fn new(constellation: Constellation, number: u8) -> Option<Self> {
        constellation.naming().1.contains(&number).then_some(Self { constellation, number })
    }

    /// All satellites of a system.
    pub fn all(constellation: Constellation) -> impl Iterator<Item = Self> {
        constellation.naming().1.map(move |number| Self { constellation, number })
    }

    /// All GPS satellites.
    pub fn all_gps() -> impl Iterator<Item = Self> {
        Self::all(Constellation::Gps)
    }

    /// The satellite with this PRN number of a C/A code: 1 to 32 GPS, 120 to 158 SBAS, 193 to 202 QZSS.
    pub fn from_prn(prn: u8) -> Option<Self> {
        let of = |constellation: Constellation| {
            Self::new(constellation, prn.checked_sub(constellation.naming().2)?)
        };
        Constellation::OF_CA_CODES.into_iter().find_map(of)
    }

    /// PRN number of its code, as its interface specification counts.
    pub fn prn(self) -> u8 {
        self.number + self.constellation.naming().2
    }

    /// Whether it is a geostationary satellite of BeiDou.
    pub fn is_beidou_geo(self) -> bool {
        self.constellation == Constellation::BeiDou && is_beidou_geo(self.number)
    }

    /// Its number in RINEX: 2 of J02.
    pub fn number(self) -> u8 {
        self.number
    }

    /// The system that the satellite belongs to.
    pub fn constellation(self) -> Constellation {
        self.constellation
    }
}

/// Whether the BeiDou satellite of this number is geostationary (BDS-SIS-ICD-B1I-3.0 table 4-1).
pub(crate) const fn is_beidou_geo(number: u8) -> bool {
    matches!(number, 1..=5 | 59..=63)
}

/// RINEX name: `G07`, `J02` (PRN 194), `S20` (PRN 120).
impl fmt::Display for Sv {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{:02}", self.constellation.letter(), self.number)
    }
}

/// Why a text names no satellite.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error(
    "'{0}' names no satellite: G01-G32, E01-E36, J01-J10 (or J193-J202), S20-S58 (or S120-S158), a bare PRN number, or a system's letter for all"
)]
pub struct ParseSvError(String);

/// RINEX name, the letter with the PRN number (`J194`, `S120`), or the bare PRN number.
impl FromStr for Sv {
    type Err = ParseSvError;
    fn from_str(text: &str) -> Result<Self, ParseSvError> {
        let fail = || ParseSvError(text.to_owned());
        let digits = text.trim_start_matches(|c: char| c.is_ascii_alphabetic());
        if digits.is_empty() || !digits.bytes().all(|b| b.is_ascii_digit()) {
            return Err(fail());
        }
        let number: u8 = digits.parse().map_err(|_| fail())?;
        let letter = text[..text.len() - digits.len()].to_ascii_uppercase();
        let named = |c: &Constellation| letter.chars().eq([c.letter()]);
        let sv = match Constellation::ALL.into_iter().find(named) {
            Some(c) => Self::new(c, number)
                .or_else(|| Self::from_prn(number).filter(|sv| sv.constellation == c)),
            None if letter.is_empty() => Self::from_prn(number),
            None => None,
        };
        sv.ok_or_else(fail)
    }
}

/// A list of satellites to be received, such as `G01-G32,E01-E36` or `1-32,193`, or of whole systems, such as `G,E`, in
/// the order written, each satellite once; of the systems whose signals the receiver can search.
pub fn parse_sv_list(text: &str) -> Result<Vec<Sv>, ParseSvError> {
    let mut list: Vec<Sv> = Vec::new();
    for item in text.split(',').map(str::trim) {
        let named = |c: &Constellation| item.to_ascii_uppercase().chars().eq([c.letter()]);
        let system = Constellation::RECEIVED.into_iter().find(named);
        let ends = system.and_then(|c| Some((Sv::all(c).next()?, Sv::all(c).last()?)));
        let (first, last) = match item.split_once('-') {
            _ if ends.is_some() => ends.ok_or(ParseSvError(item.to_owned()))?,
            Some((a, b)) => (a.parse::<Sv>()?, b.parse::<Sv>()?),
            None => (item.parse::<Sv>()?, item.parse::<Sv>()?),
        };
        let is_searched = Constellation::RECEIVED.contains(&first.constellation);
        if last < first || first.constellation != last.constellation || !is_searched {
            return Err(ParseSvError(item.to_owned()));
        }
        for number in first.number..=last.number {
            let sv = Sv { number, ..first };
            if !list.contains(&sv) {
                list.push(sv);
            }
        }
    }
    Ok(list)
}

impl serde::Serialize for Sv {
    fn serialize<S: serde::Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.collect_str(self)
    }
}

impl<'de> serde::Deserialize<'de> for Sv {
    fn deserialize<D: serde::Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        String::deserialize(d)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_printed() {
        for (text, prn, name) in [
            ("G01", 1, "G01"),
            ("7", 7, "G07"),
            ("J194", 194, "J02"),
            ("J02", 194, "J02"),
            ("S20", 120, "S20"),
            ("S158", 158, "S58"),
            ("E05", 5, "E05"),
            ("e36", 36, "E36"),
        ] {
            let sv: Sv = text.parse().unwrap();
            assert_eq!((sv.prn(), sv.to_string().as_str()), (prn, name));
        }
        for text in [
            "", "G33", "G00", "J00", "J11", "S01", "E00", "E37", "C64", "R25", "G", "G1x", "-1",
            "300",
        ] {
            assert!(text.parse::<Sv>().is_err(), "{text}");
        }
        assert_eq!(parse_sv_list("G01-G32,J193-J199").unwrap().len(), 39);
        assert_eq!(parse_sv_list("1-32,193").unwrap().len(), 33);
        assert_eq!(parse_sv_list("g,E,E07").unwrap().len(), 68);
        assert_eq!(parse_sv_list("E01-E05").unwrap().len(), 5);
        assert!(parse_sv_list("R01-R05").is_err(), "no stage receives them yet");
        assert!(parse_sv_list("G30-J01").is_err() && parse_sv_list("G05-G01").is_err());
    }
}
