//! Errors and notices of the library, with the options that help.

use sdr_rx::advice::{Advice, LOOK_S, Reading};
use sdr_rx::capture::{BitOrder, CaptureError, Note};
use sdr_rx::position::PositioningError;
use sdr_rx::receiver::{NoFix, Notice};
use sdr_rx::report::ReportError;

/// The remedy of an error.
pub fn advice(error: &anyhow::Error) -> Option<&'static str> {
    error.chain().find_map(|cause| {
        let of_capture = || cause.downcast_ref().and_then(of_capture);
        let of_report = || cause.downcast_ref().and_then(of_report);
        of_capture().or_else(of_report)
    })
}

fn of_capture(error: &CaptureError) -> Option<&'static str> {
    use CaptureError::*;
    Some(match error {
        UnknownFormat(_) | FormatNeeded(_) => "give --format TYPE",
        RateNeeded(_) => "give --rate HZ, such as --rate 4M",
        IfNeeded { .. } => "give --if HZ, such as --if 3M",
        BadRate(_) => "correct --rate",
        BadIf(_) => "correct --if",
        BadChannels(_) => "correct --channels",
        ChannelMismatch { .. } => "leave --channels out, or name other files",
        PlanarStream(_) => "give --layout interleaved",
        PlanarLength { .. } => "check --channels, --format and --layout",
        BadStart(_) | StartBeyondEnd { .. } => "correct --start",
        BadDuration(_) => "correct --duration",
        MissingMetadata { .. } => "give --format and --rate",
        StreamsDiffer { .. } => "choose one by --stream",
        _ => return None,
    })
}

fn of_report(error: &ReportError) -> Option<&'static str> {
    matches!(error, ReportError::Folder { .. }).then_some("give --out another folder")
}

/// A notice with its remedy.
pub fn notice(notice: &Notice) -> String {
    match notice {
        Notice::Source(of) => note(of),
        Notice::Mirrored => {
            format!("{notice}; read it with --conjugate (or without, if it was given)")
        }
        Notice::Oscillator { .. } => format!(
            "{notice}; a wrong --if looks the same, and a larger --doppler-max finds them at once"
        ),
        Notice::TooMany { .. } => format!(
            "{notice}; `sdr-rx info` shows level and spectrum, and --max-height sees more of the sky"
        ),
        Notice::AssumedWeek(_) => format!("{notice}; --time, or --nav of that day, would"),
        _ => notice.to_string(),
    }
}

/// Why there is no fix, and the remedy.
pub fn reason(reason: &NoFix) -> String {
    match reason {
        NoFix::NoOrbits { .. } => format!(
            "{reason}: give --nav FILE, and --time T if it is known to some hours or better, for a snapshot fix"
        ),
        NoFix::NotDated { .. } => format!("{reason}, or --nav FILE with 6 s"),
        NoFix::Solution(PositioningError::Unexplained { .. }) => {
            format!(
                "{reason}; a larger --time-uncertainty, such as 5h, searches further; --user-speed or --max-height allow for a faster or higher receiver"
            )
        }
        NoFix::Solution(PositioningError::TimeNotFound { .. }) => format!(
            "{reason}; --time narrows the search, --troposphere none suits signals simulated without one"
        ),
        NoFix::Solution(PositioningError::ImplausibleRadius { .. }) => {
            format!("{reason}; --max-height believes it")
        }
        _ => reason.to_string(),
    }
}

/// A note of a source, with its remedy.
pub fn note(note: &Note) -> String {
    let advice = match note {
        Note::Aliased { .. } => "; check --if and --rate",
        Note::Shorter { .. } => " (--duration)",
        Note::NoSample => " (--start)",
        Note::NoFrequency(_) => "; give --if otherwise",
        Note::TwoTimes { .. } => "; give --time if it matters",
        _ => "",
    };
    format!("{note}{advice}")
}

/// What to try when almost no satellite was found.
pub fn advised(advice: &Advice) -> String {
    match advice {
        Advice::Read { reading, satellites } => {
            format!("{satellites} satellites are there with {}: try it", options(reading))
        }
        Advice::NothingFound => {
            "next to no satellite was found, in any usual sample type, rate, \
            intermediate frequency, bit order, encoding or number of channels: was the antenna connected and outdoors, and the receiver tuned \
            to 1575.42 MHz? `sdr-rx info` shows level and spectrum"
                .to_owned()
        }
        Advice::TooShort(seconds) => format!(
            "next to no satellite was found in {:.3} ms of signal, which are too few to tell why: give {} ms or more",
            seconds * 1e3,
            LOOK_S * 1e3
        ),
        Advice::Level(doubt) => doubt.clone(),
    }
}

/// The options of a reading.
fn options(reading: &Reading) -> String {
    let parts = [
        reading.format.map(|f| format!("--format {f}")),
        reading.rate_hz.map(|r| format!("--rate {r}")),
        reading.if_hz.map(|f| format!("--if {f}")),
        reading.bit_order.map(|order| match order {
            BitOrder::MostFirst => "--bit-order msb".to_owned(),
            BitOrder::LeastFirst => "--bit-order lsb".to_owned(),
        }),
        reading.encoding.map(|encoding| format!("--encoding {encoding}")),
        reading.channels.map(|n| format!("--channels {n}")),
        reading.doppler_hz.map(|d| format!("--doppler-max {d}")),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(" ")
}
