//! Events and notices of a receiver.

use crate::acquisition::{MissingSamples, Refined};
use crate::array::{Bearing, Jammer, SkyEpoch};
use crate::capture::Note;
use crate::front_end::Interferer;
use crate::gnss::message::Update;
use crate::gnss::observation::ObservationEpoch;
use crate::gnss::signal::L1_CENTRE_HZ;
use crate::gnss::{GpsTime, Sv};
use crate::position::{Fix, PositioningError};
use crate::tracking::LockState;
use std::fmt;

/// What a receiver reports, as it happens. Samples are counted at the receiver's rate from the start of the stream.
#[derive(Clone, Debug)]
pub enum Event {
    /// The satellites at the start, refined, strongest first.
    Found(Vec<Refined>),
    /// A track started ([`LockState::PullingIn`]), locked or was lost.
    Lock {
        /// The satellite.
        sv: Sv,
        /// Sample that the track had reached.
        sample: u64,
        /// Its new state.
        state: LockState,
    },
    /// Navigation data that a satellite's message completed.
    Message {
        /// The satellite that sent it.
        sv: Sv,
        /// Sample up to which its message had been read.
        sample: u64,
        /// What is new.
        update: Update,
    },
    /// The measurements of one instant, once time is known.
    Observed(ObservationEpoch),
    /// A position, with the navigation data known so far.
    Fix(Box<Fix>),
    /// An instant that was measured and gave no position.
    NoFix {
        /// The instant.
        sample: f64,
        /// Why.
        error: PositioningError,
    },
    /// Directions of the satellites by an array, about once a second.
    Sky(SkyEpoch),
    /// Jammers that an array removes, strongest first, when there are more than before.
    Interference {
        /// Since when.
        sample: u64,
        /// Power and direction of each.
        jammers: Vec<Jammer>,
    },
    /// A notice to the user.
    Notice(Notice),
}

/// A notice to the user about a run.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Notice {
    /// A note of the source of the samples.
    Source(Note),
    /// Code drifts and Dopplers have opposite signs: the spectrum is mirrored.
    Mirrored,
    /// The code phases of all satellites jump within the first second: samples are missing.
    Slip {
        /// The jump.
        slip: MissingSamples,
        /// Samples a second.
        rate_hz: f64,
    },
    /// The code phases of several satellites jumped while their signals were lost.
    Jump {
        /// The jump was before this time, s from the first sample.
        before_s: f64,
        /// Number of satellites with the same jump.
        satellites: usize,
        /// The jump, s.
        jump_s: f64,
    },
    /// The stream lacks samples, or holds some twice: the satellites, the tracks and the ranges agree on how many.
    Lost {
        /// The loss is between this time and the next fix, s from the first sample.
        after_s: f64,
        /// Signal that is missing, s; negative where samples are double.
        lost_s: f64,
    },
    /// The week is the latest that is not later than the program: the signals tell it modulo 1024 weeks.
    AssumedWeek(GpsTime),
    /// Satellites were found only where all Dopplers are shifted alike: the Doppler in their middle, Hz.
    Oscillator {
        /// Their middle.
        offset_hz: f64,
    },
    /// More GPS satellites were found than can be above the horizon at once: they are not satellites.
    TooMany {
        /// Satellites found.
        found: usize,
        /// Most that can be in view.
        most: usize,
    },
    /// Directions cannot be determined.
    NoDirections(String),
    /// Jammers were removed, from this time on.
    Interference {
        /// Seconds from the first sample.
        from_s: f64,
        /// Strongest first.
        jammers: Vec<Jammer>,
    },
    /// Interference was excised from the samples of one antenna, from this time on.
    Excised {
        /// Seconds from the first sample.
        from_s: f64,
        /// All so far, strongest first.
        interferers: Vec<Interferer>,
    },
    /// Part of a snapshot's time uncertainty that was not searched, h.
    TimeLeftOut(f64),
    /// Something about the directions of the satellites is suspect: from the start, or from a time on (s).
    Sky {
        /// Since when.
        from_s: Option<f64>,
        /// What.
        suspicion: String,
    },
}

/// Why a run gave no fix.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum NoFix {
    /// No satellite was found.
    NothingFound,
    /// A snapshot whose satellites have no known orbits.
    NoOrbits {
        /// Satellites found.
        found: usize,
    },
    /// The stream ended before the messages of four satellites gave time and orbits.
    NotDated {
        /// Satellites tracked.
        found: usize,
        /// Of those, satellites with a subframe.
        dated: usize,
    },
    /// No instant has four satellites with known transmission times.
    TooFew,
    /// The position solution of the last instant, or of the snapshot.
    Solution(PositioningError),
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Source(note) => note.fmt(f),
            Self::Oscillator { offset_hz } => write!(
                f,
                "the oscillator is some {:+.0} ppm off: satellites were found around {:+.1} kHz of Doppler",
                offset_hz / L1_CENTRE_HZ * 1e6,
                offset_hz / 1e3
            ),
            Self::Lost { after_s, lost_s } if *lost_s > 0.0 => write!(
                f,
                "{:.0} ms of samples are missing after {after_s:.1} s: all tracks were dated anew",
                lost_s * 1e3
            ),
            Self::Lost { after_s, lost_s } => write!(
                f,
                "{:.0} ms of samples are double after {after_s:.1} s: all tracks were dated anew",
                -lost_s * 1e3
            ),
            Self::AssumedWeek(time) => {
                let date = time.utc_iso();
                let date = date.split('T').next().unwrap_or_default();
                write!(
                    f,
                    "the date is {date}, or 1024 weeks earlier or later: the signals do not tell which"
                )
            }
            Self::TooMany { found, most } => write!(
                f,
                "{found} GPS satellites would be in view, where at most {most} can be: none of them is believed; interference or a wrong sample type makes such"
            ),
            Self::NoDirections(text) => f.write_str(text),
            Self::Mirrored => {
                f.write_str("the spectrum is mirrored: code drifts and Dopplers disagree in sign")
            }
            Self::Slip { slip, rate_hz } => write!(
                f,
                "samples are missing or double: between {:.1} and {:.1} ms the code phases of all satellites jump by {:+.1} us ({:+.0} samples)",
                slip.after as f64 / rate_hz * 1e3,
                slip.before as f64 / rate_hz * 1e3,
                slip.jump_s * 1e6,
                slip.jump_s * rate_hz
            ),
            Self::Jump { before_s, satellites, jump_s } => write!(
                f,
                "samples are missing or double: before {before_s:.1} s the code phases of {satellites} satellites jumped by {:+.1} us",
                jump_s * 1e6
            ),
            Self::Interference { from_s, jammers } => {
                let all: Vec<String> = jammers.iter().map(jammer).collect();
                write!(f, "from {from_s:.0} s on {} had to be removed", all.join(" and "))
            }
            Self::Excised { from_s, interferers } => {
                let all: Vec<String> = interferers.iter().map(Interferer::to_string).collect();
                write!(f, "from {from_s:.1} s on interference is removed: {}", all.join("; "))
            }
            Self::TimeLeftOut(hours) => write!(
                f,
                "{hours:.1} h of the time allowed were not searched, as too few ephemerides are in force then"
            ),
            Self::Sky { from_s: None, suspicion } => f.write_str(suspicion),
            Self::Sky { from_s: Some(from_s), suspicion } => {
                write!(f, "from {from_s:.0} s on {suspicion}")
            }
        }
    }
}

fn jammer(jammer: &Jammer) -> String {
    let from = match jammer.bearing {
        None => String::new(),
        Some(Bearing::Cone(angle)) => format!(" from {:.1} deg", angle.to_degrees()),
        Some(Bearing::Direction { azimuth, elevation }) => format!(
            " from azimuth {:.0}, elevation {:.0} deg",
            azimuth.to_degrees(),
            elevation.to_degrees()
        ),
    };
    format!("a jammer {:.1} dB over the noise{from}", jammer.power_db)
}

impl fmt::Display for NoFix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NothingFound => f.write_str("no satellite was found"),
            Self::NoOrbits { found } => write!(
                f,
                "{found} satellites, but the recording is too short for their navigation message"
            ),
            Self::NotDated { found, dated } => write!(
                f,
                "{found} satellites were tracked, {dated} gave a readable subframe: a fix needs 30 s of signal"
            ),
            Self::TooFew => f.write_str("no instant has four dated satellites"),
            Self::Solution(error) => error.fmt(f),
        }
    }
}
