//! The scenario file: TOML, unknown keys refused, every value checked where it is read.

use super::ScenarioError;
use super::constellation::Walker;
use super::direction::Spoofer;
use super::front_end::FrontEndSettings;
use super::jammer::JammerSettings;
use super::noise::GaussianMixture;
use super::receiver::{MAX_ACCELERATION, Motion, SimulatedReceiver};
use super::values;
use super::variance::{Bursts, VarianceSource};
use crate::gnss::antenna::ArrayDescription;
use crate::gnss::atmosphere::{Klobuchar, Troposphere};
use crate::gnss::{Constellation, GpsTime, Sv};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A scenario: everything that determines a capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// What it is for.
    #[serde(default)]
    pub description: String,
    /// What the receiver's clock shows at the first sample: UTC in ISO 8601, or GPS `week:tow`.
    #[serde(deserialize_with = "values::time", serialize_with = "values::print_time")]
    pub start: GpsTime,
    /// Length by the receiver's clock, s.
    #[serde(deserialize_with = "values::positive")]
    pub duration_s: f64,
    /// Seed of every random draw.
    #[serde(default)]
    pub seed: u64,
    /// Where the orbits come from.
    pub orbits: Orbits,
    /// Systems to simulate, by their letters in RINEX: G, E, J; absent: GPS of a navigation file, all of Walker patterns.
    #[serde(
        default,
        deserialize_with = "values::systems",
        serialize_with = "values::print_systems",
        skip_serializing_if = "Option::is_none"
    )]
    pub systems: Option<Vec<Constellation>>,
    /// Satellites to simulate; absent: all of these systems above the elevation mask at the start.
    #[serde(default)]
    pub satellites: Option<Vec<Sv>>,
    /// Elevation mask, degrees.
    #[serde(default = "default_mask", deserialize_with = "values::elevation")]
    pub elevation_mask_deg: f64,
    /// The receiver.
    pub receiver: SimulatedReceiver,
    /// Signal levels.
    #[serde(default)]
    pub signal: SignalSettings,
    /// Atmosphere.
    #[serde(default)]
    pub atmosphere: Atmosphere,
    /// Noise.
    #[serde(default)]
    pub noise: Noise,
    /// Antenna array, a channel for each element; absent: one antenna.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub array: Option<ArrayDescription>,
    /// Jammers.
    #[serde(default, rename = "jammer", skip_serializing_if = "Vec::is_empty")]
    pub jammers: Vec<JammerSettings>,
    /// A transmitter that imitates the satellites.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spoofer: Option<Spoofer>,
    /// Front end.
    pub front_end: FrontEndSettings,
}

fn default_mask() -> f64 {
    5.0
}

/// Where the orbits come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Orbits {
    /// A RINEX navigation file, relative to the scenario file.
    NavigationFile(PathBuf),
    /// A synthetic constellation.
    Walker(Walker),
    /// Several, of one system each.
    Walkers(Vec<Walker>),
}

/// Carrier-to-noise densities: carrier power over the density of the background noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignalSettings {
    /// C/N0 (at the zenith), dB-Hz.
    #[serde(default = "default_cn0", deserialize_with = "values::cn0")]
    pub cn0_dbhz: f64,
    /// C/N0 at the horizon, dB-Hz, with the sine of the elevation between; absent: the same everywhere.
    #[serde(default, deserialize_with = "values::some_cn0")]
    pub cn0_horizon_dbhz: Option<f64>,
    /// C/N0 of single satellites, dB-Hz, whatever their elevation.
    #[serde(default)]
    pub cn0_by_satellite: BTreeMap<Sv, f64>,
    /// Change of all C/N0 with time, points [s, dB] in order of time, linear between, constant outside.
    #[serde(default)]
    pub fading: Vec<[f64; 2]>,
}

fn default_cn0() -> f64 {
    45.0
}

impl Default for SignalSettings {
    fn default() -> Self {
        Self {
            cn0_dbhz: default_cn0(),
            cn0_horizon_dbhz: None,
            cn0_by_satellite: BTreeMap::new(),
            fading: Vec::new(),
        }
    }
}

impl SignalSettings {
    /// C/N0 of `sv` at an `elevation` (rad), `elapsed` seconds after the start, dB-Hz.
    pub fn cn0_dbhz(&self, sv: Sv, elevation: f64, elapsed: f64) -> f64 {
        let by_elevation = || {
            let horizon = self.cn0_horizon_dbhz.unwrap_or(self.cn0_dbhz);
            horizon + (self.cn0_dbhz - horizon) * elevation.sin().max(0.0)
        };
        let level = self.cn0_by_satellite.get(&sv).copied().unwrap_or_else(by_elevation);
        level + self.fading_db(elapsed)
    }

    fn fading_db(&self, elapsed: f64) -> f64 {
        let next = self.fading.partition_point(|p| p[0] <= elapsed);
        match (next.checked_sub(1).map(|k| self.fading[k]), self.fading.get(next)) {
            (Some([t0, a]), Some([t1, b])) => a + (b - a) * (elapsed - t0) / (t1 - t0),
            (Some([_, level]), None) | (None, Some(&[_, level])) => level,
            (None, None) => 0.0,
        }
    }
}

/// What delays the signal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Atmosphere {
    /// Ionosphere.
    #[serde(default)]
    pub ionosphere: Ionosphere,
    /// Klobuchar coefficients (simulated when `ionosphere = "klobuchar"`, and broadcast); absent: those
    /// of the navigation file.
    #[serde(default)]
    pub klobuchar: Option<Klobuchar>,
    /// Troposphere.
    #[serde(default = "no_troposphere")]
    pub troposphere: Troposphere,
}

fn no_troposphere() -> Troposphere {
    Troposphere::None
}

impl Default for Atmosphere {
    fn default() -> Self {
        Self { ionosphere: Ionosphere::None, klobuchar: None, troposphere: no_troposphere() }
    }
}

/// How the ionosphere is modelled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ionosphere {
    /// No delay.
    #[default]
    None,
    /// Klobuchar's model.
    Klobuchar,
}

/// The noise: complex samples, white over the sampling rate, a Gaussian mixture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Whether there is noise; without it the signals keep the level of their C/N0.
    #[serde(default = "yes")]
    pub enabled: bool,
    /// Variance of the background in a complex sample (matters without a quantiser only).
    #[serde(default = "one", deserialize_with = "values::positive")]
    pub background_variance: f64,
    /// Probability that a sample is impulsive, 0 to 1.
    #[serde(default, rename = "impulse_share", deserialize_with = "values::zero_to_one")]
    pub impulse_probability: f64,
    /// Variance of impulsive samples over that of the background.
    #[serde(default = "one", deserialize_with = "values::positive")]
    pub impulse_variance_ratio: f64,
    /// Exponent of isotropic alpha-stable noise, 0.3 to 2; absent, or 2: Gaussian. The background's variance is that of
    /// the same dispersion at 2.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "values::stable_exponent"
    )]
    pub stable_exponent: Option<f64>,
    /// Bursts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bursts: Option<BurstSettings>,
    /// Fraction of the impulses, 0 to 1, that are at all elements of an array at once.
    #[serde(default, rename = "impulse_common_share", deserialize_with = "values::zero_to_one")]
    pub impulse_common_fraction: f64,
}

fn yes() -> bool {
    true
}

fn one() -> f64 {
    1.0
}

impl Default for Noise {
    fn default() -> Self {
        Self {
            enabled: true,
            background_variance: 1.0,
            impulse_probability: 0.0,
            impulse_variance_ratio: 1.0,
            impulse_common_fraction: 0.0,
            stable_exponent: None,
            bursts: None,
        }
    }
}

/// Bursts of noise: slots of equal length that are bursts independently of each other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BurstSettings {
    /// Fraction of the time, 0 to 1.
    #[serde(deserialize_with = "values::zero_to_one")]
    pub fraction: f64,
    /// Length of a slot, s: the mean length of a burst is `slot_s / (1 - fraction)`.
    #[serde(deserialize_with = "values::positive")]
    pub slot_s: f64,
    /// Variance in a burst over that outside.
    #[serde(deserialize_with = "values::positive")]
    pub variance_ratio: f64,
}

impl Noise {
    /// The distribution, for a background of unit variance.
    pub fn mixture(&self) -> GaussianMixture {
        GaussianMixture {
            probability: self.impulse_probability,
            ratio: self.impulse_variance_ratio,
        }
    }

    /// What changes from sample to sample, at a channel and a rate.
    pub(super) fn variance(
        &self,
        rate_hz: f64,
        seed: u64,
        channel: usize,
    ) -> Option<VarianceSource> {
        let bursts = self.bursts.map(|b| Bursts {
            fraction: b.fraction,
            slot: ((b.slot_s * rate_hz).round() as u64).max(1),
            ratio: b.variance_ratio,
        });
        VarianceSource::new(self.stable_exponent, bursts, seed, channel)
    }
}

impl Scenario {
    /// Reads a scenario file; a navigation file's path is made relative to it.
    ///
    /// # Errors
    /// When the file cannot be read, is no TOML, has an unknown key, or a value outside its range: with
    /// line and column.
    pub fn read(path: &Path) -> Result<Self, ScenarioError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| ScenarioError::Read { path: path.into(), source })?;
        let mut scenario = Self::parse(&text, &path.display().to_string())?;
        if let Orbits::NavigationFile(file) = &mut scenario.orbits {
            *file = path.parent().unwrap_or(Path::new("")).join(&*file);
        }
        Ok(scenario)
    }

    /// Reads a scenario from text; `name` stands for the file in messages.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(text: &str, name: &str) -> Result<Self, ScenarioError> {
        let scenario: Self = toml::from_str(text).map_err(|source| ScenarioError::Toml {
            name: name.into(),
            source: Box::new(source),
        })?;
        match scenario.conflict() {
            Some(conflict) => Err(ScenarioError::Conflict { name: name.into(), conflict }),
            None => Ok(scenario),
        }
    }

    /// Which values are inconsistent, if any.
    fn conflict(&self) -> Option<String> {
        let radius = self.receiver.position.ecef().norm();
        if !(6.2e6..1e8).contains(&radius) {
            return Some(format!(
                "[receiver] position: {radius:.0} m from the Earth's centre is no position of an antenna \
                 (ecef_m is in metres; 6.2e6 to 1e8)"
            ));
        }
        if let Motion::Straight { velocity_enu_mps } = self.receiver.motion
            && !velocity_enu_mps.iter().all(|v| v.abs() <= 1e4)
        {
            return Some("[receiver] velocity_enu_mps: each must be -10000 to 10000 m/s".into());
        }
        if let Motion::Circle { radius_m, speed_mps } = self.receiver.motion {
            let acceleration = speed_mps * speed_mps / radius_m;
            if acceleration > MAX_ACCELERATION {
                return Some(format!(
                    "[receiver] a circle of {radius_m} m at {speed_mps} m/s has {acceleration:.0} m/s^2, \
                     and the signal is exact up to {MAX_ACCELERATION} m/s^2 only"
                ));
            }
        }
        if let Some((sv, cn0)) =
            self.signal.cn0_by_satellite.iter().find(|(_, c)| !(0.0..=90.0).contains(*c))
        {
            return Some(format!("[signal] cn0_by_satellite: {sv} = {cn0} must be 0 to 90 dB-Hz"));
        }
        if !self.signal.fading.iter().flatten().all(|v| v.is_finite()) {
            return Some("[signal] fading: times and levels must be finite".into());
        }
        if !self.signal.fading.is_sorted_by(|a, b| a[0] < b[0]) {
            return Some("[signal] fading: the points' times must increase".into());
        }
        for (k, jammer) in self.jammers.iter().enumerate() {
            let wrong = jammer.direction.towards(self.array.as_ref()).err();
            if let Some(text) = wrong.or_else(|| jammer.conflict(self.front_end.rate_hz)) {
                return Some(format!("[[jammer]] {}: {text}", k + 1));
            }
        }
        if let Some(spoofer) = &self.spoofer
            && let Err(text) = spoofer.direction.towards(self.array.as_ref())
        {
            return Some(format!("[spoofer] {text}"));
        }
        self.front_end.conflict().map(|text| format!("[front_end] {text}"))
    }
}
