//! What the user may choose.

use super::loss::Robust;
use super::solver::Solver;
use sdr_rx_gnss::Constellation;
use sdr_rx_gnss::atmosphere::Troposphere;
use std::fmt;
use std::str::FromStr;

/// Options of position solutions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositioningOptions {
    /// Troposphere model.
    pub troposphere: Troposphere,
    /// Satellites below this elevation, rad, are not used.
    pub elevation_mask: f64,
    /// Satellites below this C/N0, dB-Hz, are not used: what a receiver reports below 28 dB-Hz may be noise. None where
    /// the receiver's own tests of lock and parity tell.
    pub min_cn0_dbhz: Option<f64>,
    /// Systems whose satellites are used.
    pub systems: Systems,
    /// What an epoch is solved from.
    pub observable: Observable,
    /// The solver that comes from the Earth's centre to the region of the receiver.
    pub solver: Solver,
    /// Whether [`Solver::Best`] takes over where it does not, which [`crate::Fix::start`] then says; for snapshots also
    /// whether points on the ground are tried.
    pub takes_over: bool,
    /// How an epoch's outliers are weighted.
    pub robust: Robust,
    /// What is done about contradictions in an epoch.
    pub exclusion: Exclusion,
    /// What is known of the height at an epoch.
    pub height: Option<Height>,
    /// How far a snapshot's receive time may be from GPS time, s, either way. Beyond ten minutes the time is
    /// searched for; where it is infinite, at all times that the ephemerides cover.
    pub time_uncertainty_s: f64,
    /// Largest speed that the receiver of a snapshot of known time may have, m/s: as far as the Dopplers ask for it,
    /// it enters their standard deviation. Where the time is searched for, the receiver is taken to rest.
    pub user_speed_mps: f64,
    /// Largest height, m above WGS 84, at which a receiver is believed to be without proof. Where all satellites agree
    /// on a greater one, it is believed as well.
    pub max_height_m: f64,
}

/// Saastamoinen's troposphere, mask 5 degrees; epochs by pseudoranges, [`Solver::AwDgnBt`], plain least squares,
/// exclusion by the chi-square test; snapshots whose time is known to a minute, of a receiver of
/// up to 100 m/s; heights up to 20 km.
impl Default for PositioningOptions {
    fn default() -> Self {
        Self {
            troposphere: Troposphere::default(),
            elevation_mask: 5f64.to_radians(),
            min_cn0_dbhz: None,
            systems: Systems::ALL,
            observable: Observable::default(),
            solver: Solver::default(),
            takes_over: true,
            robust: Robust::default(),
            exclusion: Exclusion::default(),
            height: None,
            time_uncertainty_s: 60.0,
            user_speed_mps: 100.0,
            max_height_m: 20e3,
        }
    }
}

/// Some of the satellite systems.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Systems([bool; Constellation::ALL.len()]);

impl Systems {
    /// All of them.
    pub const ALL: Self = Self([true; Constellation::ALL.len()]);

    /// Whether a system is one of them.
    pub fn contains(self, system: Constellation) -> bool {
        Constellation::ALL.iter().zip(self.0).any(|(s, chosen)| *s == system && chosen)
    }
}

/// Their letters in RINEX, with commas between.
impl fmt::Display for Systems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let chosen = Constellation::ALL.iter().zip(self.0).filter(|(_, chosen)| *chosen);
        let letters: Vec<String> = chosen.map(|(s, _)| s.letter().to_string()).collect();
        f.write_str(&letters.join(","))
    }
}

/// Why a text is no list of satellite systems.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error(
    "'{0}' is no satellite system: G GPS, J QZSS, S SBAS, E Galileo, C BeiDou, R GLONASS, with commas between as in G,E"
)]
pub struct ParseSystemsError(String);

/// Letters of RINEX with commas between, such as `G,E`.
impl FromStr for Systems {
    type Err = ParseSystemsError;

    fn from_str(text: &str) -> Result<Self, ParseSystemsError> {
        let mut systems = Self([false; Constellation::ALL.len()]);
        for item in text.split(',').map(str::trim) {
            let named = |s: &Constellation| item.to_ascii_uppercase().chars().eq([s.letter()]);
            let at = Constellation::ALL.iter().position(named);
            systems.0[at.ok_or_else(|| ParseSystemsError(item.to_owned()))?] = true;
        }
        Ok(systems)
    }
}

/// What a position is solved from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Observable {
    /// Pseudoranges: position and clock bias. Dopplers then give velocity and clock drift.
    #[default]
    Pseudorange,
    /// Dopplers alone: position and clock drift of a receiver at rest.
    Doppler,
    /// Both, weighted by their deviations: position, bias and drift of a receiver at rest.
    Both,
}

/// What is done when the residuals of an epoch are larger than their deviations explain (chi-square test,
/// 1e-5 of false alarm).
///
/// A result counts as proved ([`crate::Integrity`]) only by the list of fault hypotheses, each judged by that test.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Exclusion {
    /// The fewest satellites without which the test passes are left out, where no other such set leads to
    /// another place; else the epoch is refused.
    #[default]
    ChiSquare,
    /// The epoch is refused.
    Refuse,
    /// Nothing: the test is not made, and whoever reads the result must judge the residuals.
    Off,
}

/// What is known of the receiver's height, as one more observation.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Height {
    /// Height above WGS 84, m.
    pub height_m: f64,
    /// Its standard deviation, m.
    pub sigma_m: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_are_read_by_their_letters() {
        let systems: Systems = "G, e".parse().unwrap();
        assert!(systems.contains(Constellation::Gps) && systems.contains(Constellation::Galileo));
        assert!(!systems.contains(Constellation::Qzss));
        assert_eq!(
            (systems.to_string(), Systems::ALL.to_string()),
            ("G,E".into(), "G,J,S,E,C,R".into())
        );
        for wrong in ["", "G,", "X", "GPS", "G;E"] {
            assert!(wrong.parse::<Systems>().unwrap_err().to_string().contains("G GPS"), "{wrong}");
        }
    }
}
