//! Events as JSON Lines (schema `sdr-rx-events/1`): one object a line, as they happen. `event` names the kind, `at_s`
//! the signal from the first sample on that it belongs to, s; an event comes at most some tenths of a second of signal
//! after it.

use super::json::{AcquisitionRecord, FixRecord};
use crate::array::{Bearing, Jammer};
use crate::gnss::Sv;
use crate::gnss::message::Update;
use crate::gnss::observation::Observation;
use crate::receiver::Event;
use crate::tracking::LockState;
use serde::Serialize;
use serde_json::{Value, json};

#[derive(Serialize)]
struct ObservationRecord {
    sv: Sv,
    #[serde(skip_serializing_if = "Option::is_none")]
    pseudorange_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    doppler_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    carrier_phase_cycles: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cn0_dbhz: Option<f64>,
    lost_lock: bool,
}

impl ObservationRecord {
    fn new(o: &Observation) -> Self {
        Self {
            sv: o.sv(),
            pseudorange_m: o.pseudorange_m(),
            doppler_hz: o.doppler_hz,
            carrier_phase_cycles: o.carrier_phase_cycles,
            cn0_dbhz: o.cn0_dbhz,
            lost_lock: o.lost_lock,
        }
    }
}

/// The first line: schema and capture.
pub fn events_start(capture: &str) -> String {
    line(json!({
        "event": "start",
        "schema": "sdr-rx-events/1",
        "version": env!("CARGO_PKG_VERSION"),
        "capture": capture,
    }))
}

/// An event as a line; samples come `rate_hz` a second.
pub fn event_line(event: &Event, rate_hz: f64) -> String {
    let at = |sample: f64| sample / rate_hz;
    line(match event {
        Event::Found(found) => {
            let satellites: Vec<AcquisitionRecord> =
                found.iter().map(|r| AcquisitionRecord::new(&r.acquisition)).collect();
            json!({ "event": "found", "at_s": 0.0, "satellites": satellites })
        }
        Event::Lock { sv, sample, state } => {
            let state = match state {
                LockState::PullingIn => "started",
                LockState::Locked => "locked",
                LockState::Lost => "lost",
            };
            json!({ "event": "lock", "at_s": at(*sample as f64), "sv": sv, "state": state })
        }
        Event::Message { sv, sample, update } => {
            let (what, of) = match update {
                Update::Ephemeris(of) => ("ephemeris".to_owned(), Some(of)),
                Update::Withdrawn(of) => ("ephemeris withdrawn".to_owned(), Some(of)),
                Update::IonosphereUtc => ("ionosphere and UTC".to_owned(), None),
                Update::Almanac(of) => ("almanac".to_owned(), Some(of)),
                Update::Health => ("health".to_owned(), None),
                Update::Sbas(of, kind) => (format!("SBAS message type {kind}"), Some(of)),
            };
            json!({ "event": "message", "at_s": at(*sample as f64), "sv": sv, "what": what, "of": of })
        }
        Event::Observed(epoch) => {
            let observations: Vec<ObservationRecord> =
                epoch.observations.iter().map(ObservationRecord::new).collect();
            json!({
                "event": "observed",
                "at_s": at(epoch.sample),
                "gps_week": epoch.receive_time.week(),
                "tow_s": epoch.receive_time.tow(),
                "observations": observations,
            })
        }
        Event::Fix(fix) => {
            json!({ "event": "fix", "at_s": at(fix.sample), "fix": FixRecord::new(fix, Vec::new()) })
        }
        Event::NoFix { sample, error } => {
            json!({ "event": "no fix", "at_s": at(*sample), "reason": error.to_string() })
        }
        Event::Sky(epoch) => {
            let satellites: Vec<Value> = epoch
                .sky
                .satellites
                .iter()
                .map(|s| json!({ "sv": s.sv, "bearing": s.arrival.as_ref().map(|a| bearing(&a.bearing)) }))
                .collect();
            json!({
                "event": "sky",
                "at_s": at(epoch.sample as f64),
                "satellites": satellites,
                "suspicions": epoch.sky.warnings(),
            })
        }
        Event::Interference { sample, jammers } => {
            let jammers: Vec<Value> = jammers.iter().map(jammer).collect();
            json!({ "event": "interference", "at_s": at(*sample as f64), "jammers": jammers })
        }
        Event::Notice(notice) => json!({ "event": "notice", "text": notice.to_string() }),
    })
}

fn jammer(jammer: &Jammer) -> Value {
    json!({ "power_db": jammer.power_db, "bearing": jammer.bearing.as_ref().map(bearing) })
}

fn bearing(bearing: &Bearing) -> Value {
    match bearing {
        Bearing::Cone(angle) => json!({ "cone_deg": angle.to_degrees() }),
        Bearing::Direction { azimuth, elevation } => json!({
            "azimuth_deg": azimuth.to_degrees(),
            "elevation_deg": elevation.to_degrees(),
        }),
    }
}

fn line(value: Value) -> String {
    value.to_string() + "\n"
}
