//! Why no position was found.

use super::solver::failure::Failure;
use nalgebra::Vector3;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::orbit::NoOrbit;
use sdr_rx_gnss::{GpsTime, Sv};
use std::fmt;

/// Why an observation was not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DropReason {
    /// Its range or standard deviation is not a positive finite number.
    NotANumber,
    /// It is a full pseudorange where a code phase is wanted, or the other way round.
    WrongKindOfRange,
    /// The satellite was observed twice.
    Duplicate,
    /// No ephemeris of the satellite is known.
    NoEphemeris,
    /// The nearest ephemeris is this many hours from the time of reception.
    Stale(f64),
    /// The satellite declares itself unhealthy, with this health word.
    Unhealthy(u8),
    /// The satellite sends the alert flag.
    Alert,
    /// The satellite predicts no accuracy.
    NoAccuracy,
    /// The table of precise orbits has too few points to be interpolated.
    TooFewPoints {
        /// Points of the table.
        points: usize,
        /// Points needed.
        needed: usize,
    },
    /// Its signal has frequency channels, and neither the observation file nor an ephemeris says which it is on.
    UnknownChannel,
    /// Its C/N0, dB-Hz, is below what tells a signal from noise.
    Weak(f64),
    /// The satellite is below the elevation mask, at this elevation in rad.
    BelowMask(f64),
}

impl fmt::Display for DropReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotANumber => write!(f, "its measurement is not a number"),
            Self::WrongKindOfRange => write!(f, "its range is of the wrong kind"),
            Self::Duplicate => write!(f, "observed twice"),
            Self::NoEphemeris => write!(f, "no ephemeris"),
            Self::Stale(hours) => write!(f, "ephemeris {hours:.1} h away"),
            Self::Unhealthy(health) => write!(f, "unhealthy (health word {health})"),
            Self::Alert => write!(f, "sends the alert flag"),
            Self::TooFewPoints { points, needed } => {
                write!(f, "{points} points of its precise orbit, {needed} are needed")
            }
            Self::NoAccuracy => write!(f, "predicts no accuracy (URA index 15, or no SISA)"),
            Self::UnknownChannel => write!(f, "its frequency channel is not known"),
            Self::Weak(cn0_dbhz) => write!(f, "only {cn0_dbhz:.0} dB-Hz"),
            Self::BelowMask(elevation) => {
                write!(f, "below the mask at {:.1} deg", elevation.to_degrees())
            }
        }
    }
}

impl From<NoOrbit> for DropReason {
    fn from(why: NoOrbit) -> Self {
        match why {
            NoOrbit::Unknown => Self::NoEphemeris,
            NoOrbit::TooFewPoints { points, needed } => Self::TooFewPoints { points, needed },
            NoOrbit::Stale(hours) => Self::Stale(hours),
            NoOrbit::Unhealthy(word) => Self::Unhealthy(word),
            NoOrbit::Alert => Self::Alert,
            NoOrbit::NoAccuracy => Self::NoAccuracy,
        }
    }
}

/// An observation that was not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dropped {
    /// The satellite.
    pub sv: Sv,
    /// Why.
    pub reason: DropReason,
}

/// Why no position was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PositioningError {
    /// Fewer satellites than unknowns are left: three, and one for each system's time.
    #[error("{usable} usable satellites, a position needs {needed}{}", list(dropped))]
    TooFewSatellites {
        /// Satellites that could be used.
        usable: usize,
        /// Satellites needed.
        needed: usize,
        /// The others, with reasons.
        dropped: Vec<Dropped>,
    },
    /// Ephemerides are known, but not for this time.
    #[error(
        "the ephemerides are {hours:.1} hours from the given time ({time}, {}): give the navigation file of that time, or correct the time",
        time.utc_iso()
    )]
    StaleEphemerides {
        /// Distance of the nearest ephemeris of an observed satellite, h.
        hours: f64,
        /// Time of reception.
        time: GpsTime,
    },
    /// The iteration from the Earth's centre failed.
    #[error("no position from the Earth's centre with {satellites} satellites: {cause}")]
    Diverged {
        /// Satellites used.
        satellites: usize,
        /// How it failed.
        cause: Failure,
    },
    /// The satellites do not determine the position well enough.
    #[error(
        "the {satellites} satellites lie badly: {name} {value:.0}, at most {limit:.0} gives a position worth printing"
    )]
    DegenerateGeometry {
        /// Satellites used.
        satellites: usize,
        /// What measures the geometry.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Largest value that is accepted.
        limit: f64,
    },
    /// The solution lies where no receiver is believed to be without proof.
    #[error(
        "the solution lies {:.0} km from the Earth's centre, where no receiver is believed to be unless redundant satellites agree on it: a satellite or the time may be wrong, or the receiver is high",
        radius_m / 1e3
    )]
    ImplausibleRadius {
        /// Distance from the Earth's centre, m.
        radius_m: f64,
    },
    /// The residuals are too large, and too few satellites remain to tell which is faulty.
    #[error(
        "the {satellites} satellites contradict each other: weighted square residuals {cost:.3e}, at most {threshold:.1} was expected{}{}",
        suspect.map_or(String::new(), |sv| format!("; most at odds is {sv}")),
        alternatives(places)
    )]
    Inconsistent {
        /// Satellites used.
        satellites: usize,
        /// Weighted sum of squared residuals.
        cost: f64,
        /// The limit that it exceeds.
        threshold: f64,
        /// Satellite with the largest weighted residual.
        suspect: Option<Sv>,
        /// Places of smaller sets that nothing checks, with the satellites that they leave out.
        places: Vec<(Vector3<f64>, Vec<Sv>)>,
    },
    /// Sets of satellites agree on different places, and nothing tells which set is faulty.
    #[error(
        "{satellites} satellites fit two places {} apart: {}, and {}",
        distance(.places), place(&.places[0]), place(&.places[1])
    )]
    Competing {
        /// Satellites used.
        satellites: usize,
        /// The places, with the satellites that would be faulty if it were the true one.
        places: Box<[(Vector3<f64>, Vec<Sv>); 2]>,
    },
    /// No place explains what a snapshot measured.
    #[error(
        "no place on Earth explains the {what} of {satellites} satellites at {} +- {uncertainty_s:.0} s: the time is further off, the navigation file is of another date, or satellites were acquired falsely",
        time.utc_iso()
    )]
    Unexplained {
        /// The measurements: Dopplers or code phases.
        what: &'static str,
        /// Satellites used.
        satellites: usize,
        /// Given time of reception.
        time: GpsTime,
        /// How far off it was assumed to be, s.
        uncertainty_s: f64,
    },
    /// No place and time explain what a snapshot of unknown time measured.
    #[error(
        "no place on Earth explains the {what} of {satellites} satellites at any time from {} to {} ({:.1} h searched, {hypotheses} places and times explain the Dopplers{}): the time lies outside, the navigation data are of another date, or satellites were acquired falsely",
        from.utc_iso(), to.utc_iso(), searched_s / 3600.0, left_out(*left_out_s)
    )]
    TimeNotFound {
        /// The measurements: Dopplers or code phases.
        what: &'static str,
        /// Satellites used.
        satellites: usize,
        /// Beginning of what was searched.
        from: GpsTime,
        /// Its end.
        to: GpsTime,
        /// Time with ephemerides in force between these, s.
        searched_s: f64,
        /// Time of the given window without ephemerides, which was not searched, s.
        left_out_s: f64,
        /// Places and times that explain the Dopplers.
        hypotheses: usize,
    },
    /// Several places explain the code phases of a snapshot.
    #[error(
        "two places {:.1} km and {apart_s:.0} s apart explain the {satellites} code phases equally well: more satellites, a longer capture or a better known time decide",
        distance_m / 1e3
    )]
    Ambiguous {
        /// Satellites used.
        satellites: usize,
        /// Distance between the two best places, m.
        distance_m: f64,
        /// Time between them, s.
        apart_s: f64,
    },
    /// A place and time explain the measurements, but so might false ones by chance.
    #[error(
        "the best of {hypotheses} places and times in {:.1} h explains the {satellites} code phases, but {expected:.1e} false ones that do so are to be expected: more satellites, a longer capture or a better known time would prove it",
        searched_s / 3600.0
    )]
    Unproved {
        /// Satellites used.
        satellites: usize,
        /// Time searched, s.
        searched_s: f64,
        /// Places and times that explain the Dopplers.
        hypotheses: usize,
        /// Expected number of false solutions.
        expected: f64,
    },
}

fn distance(places: &[(Vector3<f64>, Vec<Sv>); 2]) -> String {
    match (places[0].0 - places[1].0).norm() {
        metres if metres < 1e4 => format!("{metres:.0} m"),
        metres => format!("{:.0} km", metres / 1e3),
    }
}

fn place((position_m, faulty): &(Vector3<f64>, Vec<Sv>)) -> String {
    let p = Geodetic::from_ecef(position_m);
    let (latitude, longitude) = (p.latitude.to_degrees(), p.longitude.to_degrees());
    let faulty: Vec<String> = faulty.iter().map(ToString::to_string).collect();
    format!("{latitude:.5} deg, {longitude:.5} deg, {:.0} m without {}", p.height, faulty.join(" "))
}

fn alternatives(places: &[(Vector3<f64>, Vec<Sv>)]) -> String {
    let all: Vec<String> = places.iter().map(place).collect();
    match all.is_empty() {
        true => String::new(),
        false => format!("; possible places, none of them checked: {}", all.join("; ")),
    }
}

fn left_out(seconds: f64) -> String {
    if (60.0..1e8).contains(&seconds) {
        format!("; {:.1} h of the window have no ephemerides in force", seconds / 3600.0)
    } else {
        String::new()
    }
}

fn list(dropped: &[Dropped]) -> String {
    let items: Vec<String> = dropped.iter().map(|d| format!("{} {}", d.sv, d.reason)).collect();
    if items.is_empty() { String::new() } else { format!(" (not used: {})", items.join(", ")) }
}
