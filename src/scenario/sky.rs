//! The satellites of a scenario in view.

use super::config::{Ionosphere, Orbits};
use super::constellation::Walker;
use super::kernel::ChipTable;
use super::message::ConstellationMessage;
use super::pseudorange::{PseudorangeTable, SignalPath};
use super::receiver::Trajectory;
use super::sent::{MessageError, Sent, default_utc};
use super::{Scenario, ScenarioError};
use crate::gnss::format::rinex_nav;
use crate::gnss::message::lnav::IonosphereUtc;
use crate::gnss::{Constellation, Ephemeris, NavigationData, Sv, Transmission, signal};
use nalgebra::{Unit, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// Rate from which the lobes of BOC(6,1), whose sidelobes end at 8.2 MHz either side, are in the band, Hz.
const WIDE_HZ: f64 = 16e6;

/// One satellite that is simulated.
pub(super) struct Emitter {
    /// The satellite and its signal.
    pub transmission: Transmission,
    /// Its pseudorange.
    pub range: PseudorangeTable,
    /// Its components, all on one carrier phase or its opposite.
    pub components: Vec<Component>,
    /// Carrier phase at zero range, cycles.
    pub phase: f64,
    /// The spoofer that sends its signal: direction (east, north, up) and start, s.
    pub spoofer: Option<(Unit<Vector3<f64>>, f64)>,
}

/// A component of a signal: data or pilot.
pub(super) struct Component {
    /// One code period with its subcarrier, and room for the same with a sign that changes at its end.
    pub table: ChipTable,
    pub signed: ChipTable,
    /// Entries of the table in a code period.
    pub entries: usize,
    /// Amplitude, as a part of the signal's.
    pub weight: f32,
    pub sent: Sent,
}

impl Component {
    /// A component for segments of up to `segment_s` at `rate_hz`; none where its message cannot be made.
    fn new(
        component: Transmission,
        (segment_s, rate_hz): (f64, f64),
        sent: Option<Sent>,
    ) -> Option<Self> {
        let signal = component.signal;
        // A band that does not hold the lobes of BOC(6,1) does not hold their power either.
        let wide = rate_hz >= WIDE_HZ;
        let modulation = if wide { signal.modulation } else { signal.modulation.narrowband() };
        let power = if wide { 1.0 } else { signal.modulation.narrowband_power() };
        let pieces = modulation.pieces();
        let code = component.code();
        let chip = |(chip, &value): (usize, &i8)| {
            (0..pieces).map(move |p| (modulation.amplitude(chip, p) * f64::from(value)) as f32)
        };
        let period: Vec<f32> = code.iter().enumerate().flat_map(chip).collect();
        // A hundredth for the Doppler of the code.
        let segment = segment_s * signal.chip_rate_hz * pieces as f64 * 1.01;
        let table = ChipTable::new(&period, segment.ceil() as usize);
        let turn = std::f64::consts::TAU * signal.phase_cycles;
        let weight = (signal.power_fraction * power).sqrt() * turn.cos();
        Some(Self {
            signed: table.clone(),
            table,
            entries: period.len(),
            weight: weight as f32,
            sent: sent?,
        })
    }
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
            Orbits::Walker(walker) => self.synthetic(std::slice::from_ref(walker)),
            Orbits::Walkers(walkers) => self.synthetic(walkers),
        };
        data.ionosphere = self.atmosphere.klobuchar.or(data.ionosphere);
        Ok(data)
    }

    fn synthetic(&self, walkers: &[Walker]) -> NavigationData {
        let mut data = NavigationData::default();
        let here = self.receiver.position.ecef();
        let all = walkers.iter().flat_map(|walker| walker.ephemerides(self.start, &here));
        all.for_each(|ephemeris| data.insert(ephemeris));
        data
    }

    /// Whether satellites of a system are simulated where no list names them.
    fn sends(&self, system: Constellation) -> bool {
        match (&self.systems, &self.orbits) {
            (Some(systems), _) => systems.contains(&system),
            (None, Orbits::NavigationFile(_)) => system == Constellation::Gps,
            (None, _) => true,
        }
    }

    /// Ephemerides of the satellites to simulate, all valid at the start.
    fn chosen(&self, data: &NavigationData) -> Result<Vec<Ephemeris>, ScenarioError> {
        let Some(list) = &self.satellites else {
            let sending = || data.satellites().filter(|sv| self.sends(sv.constellation()));
            let valid: Vec<Ephemeris> =
                sending().filter_map(|sv| data.ephemeris(sv, self.start).cloned()).collect();
            // A file of another day: reported for the first satellite.
            return match (valid.is_empty(), sending().next()) {
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
    pub(super) fn emitters(
        &self,
        knot_s: f64,
        segment_s: f64,
    ) -> Result<Vec<Emitter>, ScenarioError> {
        let data = self.navigation()?;
        let ionosphere = match self.atmosphere.ionosphere {
            Ionosphere::None => None,
            Ionosphere::Klobuchar => Some(data.ionosphere.ok_or(ScenarioError::NoKlobuchar)?),
        };
        let trajectory = Trajectory::new(&self.receiver, self.start);
        let constellation = Arc::new(self.broadcast(&data));
        let utc = data.utc.unwrap_or(default_utc(self.start));
        let sampling = (segment_s, self.front_end.rate_hz);
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
            let message = |source| ScenarioError::Message { sv, source };
            let components = [transmission].into_iter().chain(transmission.partner());
            let made = |component| -> Result<Option<Component>, MessageError> {
                let sent = Sent::new(component, &ephemeris, &constellation, utc)?;
                Ok(Component::new(component, sampling, sent))
            };
            let components: Option<Vec<Component>> =
                components.map(made).collect::<Result<_, _>>().map_err(message)?;
            let components = components.ok_or(ScenarioError::NoMessage { sv })?;
            emitters.push(Emitter {
                transmission,
                components,
                range: PseudorangeTable::new(path, knot_s),
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
        let utc = data.utc.unwrap_or(default_utc(self.start));
        let page = data.ionosphere.map(|klobuchar| IonosphereUtc::new(klobuchar, &utc));
        let gps = data.satellites().filter(|sv| sv.constellation() == Constellation::Gps);
        let in_force = gps.filter_map(|sv| data.ephemeris(sv, self.start));
        ConstellationMessage::new(in_force, page, self.start)
    }
}
