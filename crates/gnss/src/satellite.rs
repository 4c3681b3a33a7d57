//! Satellite identities.

use std::fmt;
use std::str::FromStr;

/// A system that transmits an L1 C/A code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Constellation {
    /// GPS, PRN 1 to 32, RINEX letter G.
    Gps,
    /// QZSS, PRN 193 to 202, RINEX letter J and PRN - 192.
    Qzss,
    /// SBAS, PRN 120 to 138, RINEX letter S and PRN - 100.
    Sbas,
}

/// A satellite vehicle, by the PRN number of its C/A code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Sv(u8);

impl Sv {
    /// All GPS satellites, PRN 1 to 32.
    pub fn all_gps() -> impl Iterator<Item = Self> {
        (1..=32).map(Self)
    }

    /// The satellite with this PRN number, if one with a C/A code exists.
    pub fn from_prn(prn: u8) -> Option<Self> {
        matches!(prn, 1..=32 | 120..=138 | 193..=202).then_some(Self(prn))
    }

    /// PRN number of the C/A code: 1-32 GPS, 120-138 SBAS, 193-202 QZSS.
    pub fn prn(self) -> u8 {
        self.0
    }

    /// The system that the satellite belongs to.
    pub fn constellation(self) -> Constellation {
        match self.0 {
            1..=32 => Constellation::Gps,
            120..=138 => Constellation::Sbas,
            _ => Constellation::Qzss,
        }
    }
}

/// RINEX name: `G07`, `J02` (PRN 194), `S20` (PRN 120).
impl fmt::Display for Sv {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.constellation() {
            Constellation::Gps => write!(f, "G{:02}", self.0),
            Constellation::Qzss => write!(f, "J{:02}", self.0 - 192),
            Constellation::Sbas => write!(f, "S{:02}", self.0 - 100),
        }
    }
}

/// Why a text names no satellite.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error(
    "'{0}' names no satellite with a C/A code: G01-G32, J01-J10 (or J193-J202), S20-S38 (or S120-S138), or a bare PRN number"
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
        let prn = match &text[..text.len() - digits.len()] {
            "" => Some(number),
            "G" | "g" => (1..=32).contains(&number).then_some(number),
            "J" | "j" if number <= 10 => number.checked_add(192).filter(|_| number > 0),
            "J" | "j" => (193..=202).contains(&number).then_some(number),
            "S" | "s" if number < 100 => Some(number + 100),
            "S" | "s" => (120..=138).contains(&number).then_some(number),
            _ => None,
        };
        prn.and_then(Self::from_prn).ok_or_else(fail)
    }
}

/// A list such as `G01-G32,J193-J199` or `1-32,193`, in the order written, each satellite once.
pub fn parse_sv_list(text: &str) -> Result<Vec<Sv>, ParseSvError> {
    let mut list: Vec<Sv> = Vec::new();
    for item in text.split(',').map(str::trim) {
        let (first, last) = match item.split_once('-') {
            Some((a, b)) => (a.parse::<Sv>()?, b.parse::<Sv>()?),
            None => (item.parse::<Sv>()?, item.parse::<Sv>()?),
        };
        if last < first || first.constellation() != last.constellation() {
            return Err(ParseSvError(item.to_owned()));
        }
        for sv in (first.0..=last.0).map(Sv) {
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
            ("S138", 138, "S38"),
        ] {
            let sv: Sv = text.parse().unwrap();
            assert_eq!((sv.prn(), sv.to_string().as_str()), (prn, name));
        }
        for text in ["", "G33", "G00", "J00", "J11", "S01", "E05", "G", "G1x", "-1", "300"] {
            assert!(text.parse::<Sv>().is_err(), "{text}");
        }
        assert_eq!(parse_sv_list("G01-G32,J193-J199").unwrap().len(), 39);
        assert_eq!(parse_sv_list("1-32,193").unwrap().len(), 33);
        assert!(parse_sv_list("G30-J01").is_err() && parse_sv_list("G05-G01").is_err());
    }
}
