//! Effect of each property of a front end on acquisition, observables and fix.
//!
//! One property is varied at a time, around an ideal front end (no quantiser, the whole sampled band, no
//! intermediate frequency, thermal noise alone, one antenna). Each setting is simulated with several seeds,
//! received as a snapshot, and compared with the truth; losses of C/N0 are those against the ideal front end
//! with the same seeds, so that most of the noise cancels.

mod cells;
mod report;
mod theory;

pub use report::{csv, plot, table};

use crate::acquisition::SearchOptions;
use crate::gnss::constants::SPEED_OF_LIGHT;
use crate::gnss::signal::L1_CENTRE_HZ;
use crate::gnss::{GpsTime, NavigationData};
use crate::receiver::{self, ReceiverError, ReceiverOptions};
use crate::scenario::{Scenario, ScenarioError, ScenarioSource, TruthEpoch};
use cells::{Cell, cells};
use nalgebra::Vector3;
use rayon::prelude::*;
use theory::code_separation_s;

/// Signal of each run, s, as long as a refinement uses.
const SECONDS: f64 = 0.2;

/// Oscillator errors make Dopplers beyond the satellites' own, Hz.
const SATELLITES_HZ: f64 = 5e3;

/// Why an experiment could not be made.
#[derive(Debug, thiserror::Error)]
pub enum FrontEndError {
    /// The scenario cannot be simulated.
    #[error("simulating {setting}: {source}")]
    Scenario {
        /// Property and setting.
        setting: String,
        /// The error.
        source: ScenarioError,
    },
    /// The receiver failed.
    #[error("receiving {setting}: {source}")]
    Receiver {
        /// Property and setting.
        setting: String,
        /// Why.
        source: ReceiverError,
    },
}

/// Results of one setting.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepRow {
    /// The property varied.
    pub property: &'static str,
    /// Its setting.
    pub setting: String,
    /// Satellites in view, over all seeds.
    pub satellites: usize,
    /// Of those, how many were found.
    pub found: usize,
    /// False detections.
    pub false_ones: usize,
    /// Mean loss of C/N0 against the ideal front end, dB; of the satellites found by both.
    pub loss_db: Option<f64>,
    /// The loss by theory, where there is one.
    pub theory_loss_db: Option<f64>,
    /// The same with the other satellites' codes as part of the noise, as in what is measured, to which the front end
    /// adds nothing.
    pub expected_loss_db: Option<f64>,
    /// Error of code phases about their mean in a run, m, rms.
    pub code_m: Option<f64>,
    /// Error of Dopplers, Hz, rms.
    pub doppler_hz: Option<f64>,
    /// Error of directions, in direction cosines, rms; with an array.
    pub direction: Option<f64>,
    /// Runs.
    pub runs: usize,
    /// Runs that gave a fix.
    pub fixes: usize,
    /// Error of the positions, m, rms.
    pub position_m: Option<f64>,
}

/// One run of one cell.
struct Run {
    /// C/N0, code and Doppler errors by satellite of the truth; `None` where it was not found.
    satellites: Vec<Option<Measured>>,
    false_ones: usize,
    position_m: Option<f64>,
}

#[derive(Clone, Copy)]
struct Measured {
    cn0_dbhz: f64,
    code_m: f64,
    doppler_hz: f64,
    direction: Option<f64>,
}

/// Varies each property of the scenario's front end; `runs` seeds each, from the scenario's on.
///
/// # Errors
/// When the scenario cannot be simulated or received.
pub fn sweep(scenario: &Scenario, runs: usize) -> Result<Vec<SweepRow>, FrontEndError> {
    let cells = cells(scenario);
    let all: Vec<Vec<Run>> = cells
        .par_iter()
        .map(|cell| (0..runs as u64).into_par_iter().map(|k| cell.run(k)).collect())
        .collect::<Result<_, _>>()?;
    Ok(cells.iter().zip(&all).map(|(cell, runs)| row(cell, runs, &cells[0], &all[0])).collect())
}

impl Cell {
    fn name(&self) -> String {
        format!("{} {}", self.property, self.setting)
    }

    fn run(&self, number: u64) -> Result<Run, FrontEndError> {
        let failed = |source| FrontEndError::Scenario { setting: self.name(), source };
        let mut scenario = self.scenario.clone();
        scenario.seed = scenario.seed.wrapping_add(number);
        scenario.array = self.elements.map(|e| e.actual(scenario.seed));
        let navigation = scenario.navigation().map_err(failed)?;
        let mut source = ScenarioSource::new(&scenario).map_err(failed)?;
        let options = self.options(navigation, scenario.start);
        let truths = [0.0, SECONDS / 2.0]
            .map(|at| source.truth_at((at * scenario.front_end.rate_hz) as u64));
        let record = receiver::process(&mut source, &options, &mut |_| ())
            .map_err(|source| FrontEndError::Receiver { setting: self.name(), source })?;
        let [first, middle] = &truths;
        let measured = |k: usize| {
            let (truth, later) = (&first.satellites[k], &middle.satellites[k]);
            let found = record.acquisitions.iter().find(|r| r.acquisition.sv() == truth.sv)?;
            let signal = found.acquisition.transmission.signal;
            let code = signal.chips as f64;
            let chips = found.acquisition.code_phase_chips - truth.code_phase_chips;
            let chips = (chips + code / 2.0).rem_euclid(code) - code / 2.0;
            let seen = record.sky.iter().flat_map(|s| &s.satellites).find(|s| s.sv == truth.sv);
            Some(Measured {
                direction: seen.and_then(|s| s.predicted).map(|p| p.apart),
                cn0_dbhz: found.acquisition.cn0_dbhz,
                code_m: -chips / signal.chip_rate_hz * SPEED_OF_LIGHT,
                doppler_hz: found.acquisition.doppler_hz - later.doppler_hz,
            })
        };
        let is_there = |sv| first.satellites.iter().any(|s| s.sv == sv);
        Ok(Run {
            satellites: (0..first.satellites.len()).map(measured).collect(),
            false_ones: record
                .acquisitions
                .iter()
                .filter(|r| !is_there(r.acquisition.sv()))
                .count(),
            position_m: record.fixes.first().map(|fix| error_m(fix.position_m, middle)),
        })
    }

    fn options(&self, navigation: NavigationData, time: GpsTime) -> ReceiverOptions {
        let doppler_hz =
            SATELLITES_HZ + self.scenario.receiver.clock_drift_ppm.abs() * 1e-6 * L1_CENTRE_HZ;
        let mut options = ReceiverOptions {
            search: SearchOptions {
                doppler_hz: (-doppler_hz, doppler_hz),
                ..SearchOptions::default()
            },
            navigation,
            time: Some(time),
            array: self.elements.map(|e| e.nominal()),
            suppression: self.suppression,
            ..ReceiverOptions::default()
        };
        options.positioning.troposphere = self.scenario.atmosphere.troposphere;
        options
    }
}

fn error_m(position_m: Vector3<f64>, truth: &TruthEpoch) -> f64 {
    (position_m - Vector3::from(truth.position_ecef_m)).norm()
}

/// The runs of a cell beside those of the ideal front end.
fn row(cell: &Cell, runs: &[Run], first: &Cell, ideal: &[Run]) -> SweepRow {
    let pairs = runs.iter().zip(ideal).flat_map(|(a, b)| a.satellites.iter().zip(&b.satellites));
    let losses = pairs.filter_map(|(a, b)| Some(b.as_ref()?.cn0_dbhz - a.as_ref()?.cn0_dbhz));
    let found = || runs.iter().flat_map(|r| r.satellites.iter().flatten());
    // A code error common to all satellites is a delay of the receiver.
    let codes = runs.iter().flat_map(|run| {
        let codes: Vec<f64> = run.satellites.iter().flatten().map(|m| m.code_m).collect();
        let common = mean(codes.iter().copied()).unwrap_or(0.0);
        codes.into_iter().map(move |c| c - common)
    });
    let expected = |loss_db: f64| {
        let elements = cell.elements.map_or(1.0, |e| e.count() as f64);
        let noise = 10f64.powf(loss_db / 10.0) + codes_over_noise(first, cell, ideal) / elements;
        10.0 * (noise / (1.0 + codes_over_noise(first, first, ideal))).log10()
    };
    let positions = || runs.iter().filter_map(|r| r.position_m);
    SweepRow {
        satellites: runs.iter().map(|r| r.satellites.len()).sum(),
        found: found().count(),
        false_ones: runs.iter().map(|r| r.false_ones).sum(),
        loss_db: mean(losses),
        theory_loss_db: cell.theory_loss_db,
        expected_loss_db: cell.theory_loss_db.map(expected),
        code_m: rms(codes),
        doppler_hz: rms(found().map(|m| m.doppler_hz)),
        direction: rms(found().filter_map(|m| m.direction)),
        runs: runs.len(),
        fixes: positions().count(),
        position_m: rms(positions()),
        property: cell.property,
        setting: cell.setting.clone(),
    }
}

/// Power of the codes of the other satellites over the noise of one, at the level of the `first` cell and the
/// sampling rate of another.
fn codes_over_noise(first: &Cell, cell: &Cell, ideal: &[Run]) -> f64 {
    let runs = ideal.len().max(1) as f64;
    let satellites: f64 = ideal.iter().map(|r| r.satellites.len() as f64 / runs).sum();
    let cn0 = 10f64.powf(first.scenario.signal.cn0_dbhz / 10.0);
    (satellites - 1.0).max(0.0) * cn0 * code_separation_s(cell.scenario.front_end.rate_hz)
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (n, sum) = values.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
    (n > 0.0).then(|| sum / n)
}

fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    mean(values.map(|v| v * v)).map(f64::sqrt)
}
