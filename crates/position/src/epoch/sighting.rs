//! Observations paired with the orbits of their satellites: which of an epoch can be used at all.

use crate::error::{DropReason, Dropped, PositioningError};
use crate::options::Systems;
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::observation::{Observation, ObservationEpoch};
use sdr_rx_gnss::signal::{
    BEIDOU_B1C_DATA, BEIDOU_B1C_PILOT, GALILEO_E1B, GPS_L1C_D, GPS_L1C_P, Signal,
};
use sdr_rx_gnss::{Constellation, GpsTime, NavigationData, Orbit, Sv};

/// An observation with the orbit of its satellite.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sighting<'a> {
    pub observation: &'a Observation,
    pub orbit: Orbit<'a>,
    /// Pseudorange, or pseudorange modulo the code period, m; none where the Doppler alone is used.
    pub range_m: Option<f64>,
    /// Carrier, Hz.
    pub carrier_hz: f64,
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
        Ok(Self { range_m: Some(range_m), ..Self::of_orbit(observation, t, nav)? })
    }

    /// Without a range.
    fn of_orbit(
        observation: &'a Observation,
        t: GpsTime,
        nav: &'a NavigationData,
    ) -> Result<Self, DropReason> {
        let sv = observation.sv();
        let orbit = nav.orbit(sv, t)?;
        let channel = nav.frequency_channel(sv);
        let carrier_hz = observation.transmission.signal.carrier_on_channel_hz(channel);
        let carrier_hz = carrier_hz.ok_or(DropReason::UnknownChannel)?;
        Ok(Self { observation, orbit, range_m: None, carrier_hz })
    }

    /// The same for its Doppler alone, which must be a number; the range is none.
    pub fn of_doppler(
        observation: &'a Observation,
        t: GpsTime,
        nav: &'a NavigationData,
    ) -> Result<Self, DropReason> {
        let sighting = Self::of_orbit(observation, t, nav)?;
        sighting.range_rate().map(|_| sighting).ok_or(DropReason::NotANumber)
    }

    pub fn sv(&self) -> Sv {
        self.observation.sv()
    }

    /// Wavelength of the carrier, m.
    pub fn wavelength_m(&self) -> f64 {
        SPEED_OF_LIGHT / self.carrier_hz
    }

    /// Measured range rate, m/s, and its standard deviation, if the Doppler is a number.
    pub fn range_rate(&self) -> Option<(f64, f64)> {
        let (doppler, sigma) = (self.observation.doppler_hz?, self.observation.doppler_sigma_hz);
        let wavelength_m = self.wavelength_m();
        (doppler.is_finite() && sigma.is_finite() && sigma > 0.0)
            .then_some((-wavelength_m * doppler, wavelength_m * sigma))
    }
}

/// Which of the receiver's clocks a satellite's ranges contain: one for each time that systems keep. All
/// drift alike (system times by less than 1e-13 against each other): all rates contain one drift.
pub(crate) fn clock_of(sv: Sv) -> usize {
    match sv.constellation() {
        // QZSS and SBAS keep GPS time.
        Constellation::Gps | Constellation::Qzss | Constellation::Sbas => 0,
        Constellation::Galileo => 1,
        Constellation::BeiDou => 2,
        Constellation::Glonass => 3,
    }
}

/// The clock of a system that a set of satellites tells the time of reception by: the first that it has.
pub(crate) fn reference_clock<'s>(used: impl IntoIterator<Item = &'s Sighting<'s>>) -> usize {
    used.into_iter().map(|s| clock_of(s.sv())).min().unwrap_or(0)
}

/// The system whose time a clock is against.
pub(crate) fn system_of(clock: usize) -> Constellation {
    match clock {
        1 => Constellation::Galileo,
        2 => Constellation::BeiDou,
        3 => Constellation::Glonass,
        _ => Constellation::Gps,
    }
}

/// Which signal of a satellite is used where several are observed, the lowest first: those whose group delay the
/// ephemeris states before L1C and B1C, pilots, which are tracked longer, before their data components.
fn preference(signal: &Signal) -> usize {
    let later = [&GALILEO_E1B, &BEIDOU_B1C_PILOT, &GPS_L1C_P, &BEIDOU_B1C_DATA, &GPS_L1C_D];
    later.iter().position(|other| *other == signal).map_or(0, |k| k + 1)
}

/// The sightings that `make` makes of the observations of `epoch` of these systems, one a satellite, in the epoch's order,
/// and the observations that it refuses; an error if fewer than `needed` are left. Of several signals of a satellite the
/// first that can be used is, by [`preference`].
pub(crate) fn select<'a>(
    epoch: &'a ObservationEpoch,
    systems: Systems,
    make: impl Fn(&'a Observation) -> Result<Sighting<'a>, DropReason>,
    needed: usize,
) -> Result<(Vec<Sighting<'a>>, Vec<Dropped>), PositioningError> {
    let time = epoch.receive_time;
    let mut usable: Vec<Sighting> = Vec::new();
    let mut dropped = Vec::new();
    let chosen = epoch.observations.iter().filter(|o| systems.contains(o.sv().constellation()));
    let mut by_satellite: Vec<Vec<&'a Observation>> = Vec::new();
    for observation in chosen {
        match by_satellite.iter_mut().find(|list| list[0].sv() == observation.sv()) {
            Some(list) => list.push(observation),
            None => by_satellite.push(vec![observation]),
        }
    }
    for mut observations in by_satellite {
        let sv = observations[0].sv();
        observations.sort_by_key(|o| preference(o.transmission.signal));
        let twice = observations.windows(2).any(|o| o[0].transmission == o[1].transmission);
        dropped.extend(twice.then_some(Dropped { sv, reason: DropReason::Duplicate }));
        let mut made = observations.into_iter().map(&make);
        let first = made.next().unwrap_or(Err(DropReason::NotANumber));
        match first.or_else(|reason| made.find_map(Result::ok).ok_or(reason)) {
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
