//! The satellites of a scenario in view.

use super::config::{Ionosphere, Orbits};
use super::kernel::{TABLE, chip_table};
use super::message::{ConstellationMessage, MessageStream};
use super::pseudorange::{PseudorangeTable, SignalPath};
use super::receiver::Trajectory;
use super::{Scenario, ScenarioError};
use crate::gnss::format::rinex_nav;
use crate::gnss::message::lnav::IonosphereUtc;
use crate::gnss::navigation_data::UtcParameters;
use crate::gnss::{Constellation, Ephemeris, NavigationData, Sv, Transmission, signal};
use nalgebra::{Unit, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// One satellite that is simulated.
pub(super) struct Emitter {
    /// The satellite and its signal.
    pub transmission: Transmission,
    /// Its pseudorange.
    pub range: PseudorangeTable,
    /// Its code.
    pub chips: Box<[f32; TABLE]>,
    /// Its message.
    pub message: MessageStream,
    /// Carrier phase at zero range, cycles.
    pub phase: f64,
    /// The spoofer that sends its signal: direction (east, north, up) and start, s.
    pub spoofer: Option<(Unit<Vector3<f64>>, f64)>,
}

impl Emitter {
    /// Direction (east, north, up) of its signal `elapsed` s after the start, where a spoofer sends it.
    pub fn spoofed_from(&self, elapsed: f64) -> Option<Unit<Vector3<f64>>> {
        // What lies before the first sample is the past of the front end's filter.
        self.spoofer.filter(|(_, start)| elapsed.max(0.0) >= *start).map(|(towards, _)| towards)
    }
}

impl Scenario {
    /// Orbits, ionosphere and UTC parameters, as a navigation file of the scenario would have them.
    ///
    /// # Errors
    /// When the navigation file cannot be read.
    pub fn navigation(&self) -> Result<NavigationData, ScenarioError> {
        let mut data = match &self.orbits {
            Orbits::NavigationFile(path) => rinex_nav::read(path)?.data,
            Orbits::Walker(walker) => {
                let mut data = NavigationData::default();
                let here = self.receiver.position.ecef();
                walker.ephemerides(self.start, &here).into_iter().for_each(|e| data.insert(e));
                data
            }
        };
        data.ionosphere = self.atmosphere.klobuchar.or(data.ionosphere);
        Ok(data)
    }

    /// Ephemerides of the satellites to simulate, all valid at the start.
    fn chosen(&self, data: &NavigationData) -> Result<Vec<Ephemeris>, ScenarioError> {
        let Some(list) = &self.satellites else {
            let gps = || data.satellites().filter(|sv| sv.constellation() == Constellation::Gps);
            let valid: Vec<Ephemeris> =
                gps().filter_map(|sv| data.ephemeris(sv, self.start).cloned()).collect();
            // A file of another day: reported for the first satellite.
            return match (valid.is_empty(), gps().next()) {
                (true, Some(sv)) => self.ephemeris(data, sv).map(|e| vec![e]),
                _ => Ok(valid),
            };
        };
        if let Some(sv) =
            list.iter().enumerate().find_map(|(k, sv)| list[..k].contains(sv).then_some(sv))
        {
            return Err(ScenarioError::Duplicate { sv: *sv });
        }
        list.iter().map(|&sv| self.ephemeris(data, sv)).collect()
    }

    fn ephemeris(&self, data: &NavigationData, sv: Sv) -> Result<Ephemeris, ScenarioError> {
        let unknown = || {
            let known: Vec<String> = data.satellites().map(|s| s.to_string()).collect();
            ScenarioError::UnknownSatellite { sv, known: known.join(" ") }
        };
        let nearest = data.nearest(sv, self.start).ok_or_else(unknown)?;
        data.ephemeris(sv, self.start).cloned().ok_or_else(|| ScenarioError::StaleEphemeris {
            sv,
            start: self.start,
            hours: (self.start - nearest.toe).abs() / 3600.0,
            toe: nearest.toe,
        })
    }

    /// The satellites in view, with pseudorange knots every `knot_s` seconds.
    pub(super) fn emitters(&self, knot_s: f64) -> Result<Vec<Emitter>, ScenarioError> {
        let data = self.navigation()?;
        let ionosphere = match self.atmosphere.ionosphere {
            Ionosphere::None => None,
            Ionosphere::Klobuchar => Some(data.ionosphere.ok_or(ScenarioError::NoKlobuchar)?),
        };
        let trajectory = Trajectory::new(&self.receiver, self.start);
        let constellation = Arc::new(self.broadcast(&data));
        let spoofer = self.spoofer.as_ref().map(|s| {
            let towards = s.direction.towards(self.array.as_ref())?;
            Ok((towards, s.start_s))
        });
        let spoofer = spoofer.transpose().map_err(ScenarioError::Direction)?;
        let is_spoofed = |sv| self.spoofer.as_ref().is_some_and(|s| s.sends(sv));
        let mut emitters = Vec::new();
        for ephemeris in self.chosen(&data)? {
            let sv = ephemeris.sv;
            let troposphere = self.atmosphere.troposphere;
            let path =
                SignalPath { ephemeris: ephemeris.clone(), ionosphere, troposphere, trajectory };
            let elevation_deg = path.view(0.0).elevation.to_degrees();
            if self.satellites.is_some() && elevation_deg < 0.0 {
                return Err(ScenarioError::BelowHorizon { sv, elevation_deg });
            }
            if self.satellites.is_none() && elevation_deg < self.elevation_mask_deg {
                continue;
            }
            let transmission = signal::of(sv);
            let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
            rng.set_stream(3 << 32 | u64::from(sv.prn()));
            emitters.push(Emitter {
                transmission,
                range: PseudorangeTable::new(path, knot_s),
                chips: chip_table(&transmission.code()),
                message: MessageStream::new(ephemeris, Arc::clone(&constellation))
                    .map_err(|source| ScenarioError::Message { sv, source })?,
                phase: f64::from(rng.next_u32()) / 2f64.powi(32),
                spoofer: spoofer.filter(|_| is_spoofed(sv)),
            });
        }
        if emitters.is_empty() {
            return Err(ScenarioError::NothingVisible { mask_deg: self.elevation_mask_deg });
        }
        let listed = self.spoofer.iter().flat_map(|s| s.satellites.iter().flatten());
        for &sv in listed {
            if emitters.iter().all(|e| e.transmission.sv != sv) {
                let known: Vec<String> =
                    emitters.iter().map(|e| e.transmission.sv.to_string()).collect();
                return Err(ScenarioError::SpoofedUnknown { sv, known: known.join(" ") });
            }
        }
        Ok(emitters)
    }

    /// Contents of subframes 4 and 5: almanacs from the valid ephemerides, and page 18.
    fn broadcast(&self, data: &NavigationData) -> ConstellationMessage {
        let leap = self.start.leap_seconds();
        // Without UTC parameters in the file: GPS minus UTC is the leap seconds, and no change is due.
        let utc = data.utc.unwrap_or(UtcParameters {
            a0: 0.0,
            a1: 0.0,
            tot: crate::gnss::GpsTime::from_week_tow(self.start.week(), 0.0),
            delta_t_ls: leap,
            delta_t_lsf: leap,
            wn_lsf: self.start.week(),
            day: 1,
        });
        let page = data.ionosphere.map(|klobuchar| IonosphereUtc::new(klobuchar, &utc));
        let gps = data.satellites().filter(|sv| sv.constellation() == Constellation::Gps);
        let in_force = gps.filter_map(|sv| data.ephemeris(sv, self.start));
        ConstellationMessage::new(in_force, page, self.start)
    }
}
