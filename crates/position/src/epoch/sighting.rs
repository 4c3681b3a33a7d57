//! Observations paired with the orbits of their satellites: which of an epoch can be used at all.

use crate::error::{DropReason, Dropped, PositioningError};
use sdr_rx_gnss::observation::{Observation, ObservationEpoch};
use sdr_rx_gnss::{Constellation, GpsTime, NavigationData, Orbit, Sv};

/// An observation with the orbit of its satellite.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sighting<'a> {
    pub observation: &'a Observation,
    pub orbit: Orbit<'a>,
    /// Pseudorange, or pseudorange modulo the code period, m; none where the Doppler alone is used.
    pub range_m: Option<f64>,
}

impl<'a> Sighting<'a> {
    /// Pairs an observation with its satellite's orbit at about time `t`, or says why it cannot be used.
    pub fn new(
        observation: &'a Observation,
        range_m: f64,
        t: GpsTime,
        nav: &'a NavigationData,
    ) -> Result<Self, DropReason> {
        let positive = |sigma: f64| sigma.is_finite() && sigma > 0.0;
        if !range_m.is_finite() || !positive(observation.range_sigma_m) {
            return Err(DropReason::NotANumber);
        }
        let orbit = nav.orbit(observation.sv(), t)?;
        Ok(Self { observation, orbit, range_m: Some(range_m) })
    }

    /// The same for its Doppler alone, which must be a number; the range is none.
    pub fn of_doppler(
        observation: &'a Observation,
        t: GpsTime,
        nav: &'a NavigationData,
    ) -> Result<Self, DropReason> {
        let orbit = nav.orbit(observation.sv(), t)?;
        let sighting = Self { observation, orbit, range_m: None };
        sighting.range_rate().map(|_| sighting).ok_or(DropReason::NotANumber)
    }

    pub fn sv(&self) -> Sv {
        self.observation.sv()
    }

    /// Measured range rate, m/s, and its standard deviation, if the Doppler is a number.
    pub fn range_rate(&self) -> Option<(f64, f64)> {
        let (doppler, sigma) = (self.observation.doppler_hz?, self.observation.doppler_sigma_hz);
        let wavelength_m = self.observation.transmission.wavelength_m();
        (doppler.is_finite() && sigma.is_finite() && sigma > 0.0)
            .then_some((-wavelength_m * doppler, wavelength_m * sigma))
    }
}

/// Which of the receiver's clocks a satellite's ranges contain: one for each time that systems keep. All
/// drift alike (system times by less than 1e-13 against each other): rates contain the drift of clock 0.
pub(crate) fn clock_of(sv: Sv) -> usize {
    match sv.constellation() {
        // QZSS and SBAS keep GPS time.
        Constellation::Gps | Constellation::Qzss | Constellation::Sbas => 0,
        Constellation::Galileo => 1,
        Constellation::BeiDou => 2,
        Constellation::Glonass => 3,
    }
}

/// The first of the clocks that satellites have.
pub(crate) fn reference_clock(set: &[Sighting]) -> usize {
    set.iter().map(|s| clock_of(s.sv())).min().unwrap_or(0)
}

/// The system whose time a clock keeps.
pub(crate) fn system_of(clock: usize) -> Option<Constellation> {
    [Constellation::Gps, Constellation::Galileo, Constellation::BeiDou, Constellation::Glonass]
        .get(clock)
        .copied()
}

/// The sightings that `make` makes of the observations of `epoch`, in the epoch's order, and the observations that it
/// refuses; an error if fewer than `needed` are left.
pub(crate) fn select<'a>(
    epoch: &'a ObservationEpoch,
    make: impl Fn(&'a Observation) -> Result<Sighting<'a>, DropReason>,
    needed: usize,
) -> Result<(Vec<Sighting<'a>>, Vec<Dropped>), PositioningError> {
    let time = epoch.receive_time;
    let mut usable: Vec<Sighting> = Vec::new();
    let mut dropped = Vec::new();
    for observation in &epoch.observations {
        let sv = observation.sv();
        let sighting = if usable.iter().any(|s| s.observation.sv() == sv) {
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
        return Ok((usable, dropped));
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
