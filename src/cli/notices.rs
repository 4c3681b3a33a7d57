//! What the library tells as data, in sentences that name the options which would help.

use sdr_rx::advice::{Advice, Reading};
use sdr_rx::position::PositioningError;
use sdr_rx::receiver::{NoFix, Notice};

/// A notice as a person reads it.
pub fn notice(notice: &Notice) -> String {
    match notice {
        Notice::Mirrored => {
            format!("{notice}; read it with --conjugate (or without, if it was given)")
        }
        _ => notice.to_string(),
    }
}

/// Why there is no fix, and what would help.
pub fn reason(reason: &NoFix) -> String {
    match reason {
        NoFix::NoOrbits { .. } => format!(
            "{reason}: give --nav FILE, and --time T if it is known to some hours or better, for a snapshot fix"
        ),
        NoFix::NotDated { .. } => format!("{reason}, or --nav FILE with 6 s"),
        NoFix::Solution(PositioningError::Unexplained { .. }) => {
            format!("{reason}; a greater --time-uncertainty, such as 5h, searches further")
        }
        NoFix::Solution(PositioningError::TimeNotFound { .. }) => format!(
            "{reason}; --time narrows the search, --troposphere none suits signals simulated without one"
        ),
        _ => reason.to_string(),
    }
}

/// What is probably wrong, and what to try.
pub fn advice(advice: &Advice) -> String {
    match advice {
        Advice::Read(count, reading) => {
            format!("{count} satellites are there with {}: try it", options(reading))
        }
        Advice::Nothing => "next to no satellite was found, in any usual sample type, rate or intermediate frequency: was the antenna connected and under the sky, and the receiver tuned to 1575.42 MHz? `sdr-rx info` shows level and spectrum".to_owned(),
        Advice::Level(doubt) => doubt.clone(),
    }
}

fn options(reading: &Reading) -> String {
    let parts = [
        reading.format.map(|f| format!("--format {f}")),
        reading.rate_hz.map(|r| format!("--rate {r}")),
        reading.if_hz.map(|f| format!("--if {f}")),
        reading.doppler_hz.map(|d| format!("--doppler-max {d}")),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(" ")
}
