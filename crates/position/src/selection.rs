//! Which observations can be used at all.

use super::error::{DropReason, Dropped, PositioningError};
use super::sight::Sighting;
use sdr_rx_gnss::NavigationData;
use sdr_rx_gnss::observation::{CodeRange, Observation, ObservationEpoch};

/// The observations of `epoch` that `range_m` understands and whose satellites have a healthy, fresh
/// ephemeris, in the epoch's order; an error if fewer than `needed` are left.
pub(super) fn select<'a>(
    epoch: &'a ObservationEpoch,
    nav: &'a NavigationData,
    range_m: fn(CodeRange) -> Option<f64>,
    needed: usize,
) -> Result<Vec<Sighting<'a>>, PositioningError> {
    let time = epoch.receive_time;
    let sighting = |observation: &'a Observation| {
        let range = observation.range.ok_or(DropReason::NotANumber)?;
        range_m(range)
            .ok_or(DropReason::WrongKindOfRange)
            .and_then(|range_m| Sighting::new(observation, range_m, time, nav))
    };
    select_by(epoch, sighting, needed)
}

/// The sightings that `make` makes of the observations of `epoch`, in the epoch's order; an error if fewer
/// than `needed` are left.
pub(super) fn select_by<'a>(
    epoch: &'a ObservationEpoch,
    make: impl Fn(&'a Observation) -> Result<Sighting<'a>, DropReason>,
    needed: usize,
) -> Result<Vec<Sighting<'a>>, PositioningError> {
    let time = epoch.receive_time;
    let mut usable: Vec<Sighting> = Vec::new();
    let mut dropped = Vec::new();
    for observation in &epoch.observations {
        let sv = observation.sv;
        let sighting = if usable.iter().any(|s| s.observation.sv == sv) {
            Err(DropReason::Duplicate)
        } else {
            make(observation)
        };
        match sighting {
            Ok(sighting) => usable.push(sighting),
            Err(reason) => dropped.push(Dropped { sv, reason }),
        }
    }
    if usable.len() >= needed {
        return Ok(usable);
    }
    let ages: Vec<f64> = dropped
        .iter()
        .filter_map(|d| if let DropReason::Stale(hours) = d.reason { Some(hours) } else { None })
        .collect();
    if usable.len() + ages.len() >= needed {
        let hours = ages.into_iter().fold(f64::INFINITY, f64::min);
        return Err(PositioningError::StaleEphemerides { hours, time });
    }
    Err(PositioningError::TooFewSatellites { usable: usable.len(), needed, dropped })
}
