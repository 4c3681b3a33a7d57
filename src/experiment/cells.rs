//! The settings of the sweep.

use super::SECONDS;
use super::theory::{band_loss_db, noise_figure_loss_db, quantiser_loss_db};
use crate::front_end::mixture::Mixture;
use crate::front_end::{Map, Suppression};
use crate::gnss::antenna::{AntennaArray, ArrayDescription};
use crate::gnss::signal::L1_WAVELENGTH;
use crate::scenario::Scenario;
use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// One setting of one property.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    pub(super) property: &'static str,
    pub(super) setting: String,
    pub(super) scenario: Scenario,
    pub(super) elements: Option<Elements>,
    pub(super) suppression: Suppression,
    pub(super) theory_loss_db: Option<f64>,
}

/// A square array, half a wavelength between neighbours, that the receiver assumes to be calibrated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Elements {
    side: usize,
    /// Standard deviation of the elements' gains, dB, and phases, rad.
    gain_db: f64,
    phase: f64,
}

impl Elements {
    pub(super) fn count(self) -> usize {
        self.side * self.side
    }

    /// The array without errors, as given to the receiver.
    pub(super) fn nominal(self) -> ArrayDescription {
        AntennaArray::rectangular(self.side, self.side, L1_WAVELENGTH / 2.0).into()
    }

    /// The array with the errors of this run.
    pub(super) fn actual(self, run: u64) -> ArrayDescription {
        let mut rng = ChaCha8Rng::seed_from_u64(run);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut draw = || {
            Complex64::from_polar(10f64.powf(self.gain_db * normal() / 20.0), self.phase * normal())
        };
        let mut array = self.nominal();
        array.errors.iter_mut().for_each(|e| *e = draw());
        array
    }
}

/// The settings, the ideal front end first.
pub(super) fn cells(given: &Scenario) -> Vec<Cell> {
    let mut ideal = given.clone();
    ideal.duration_s = SECONDS;
    ideal.noise.impulse_probability = 0.0;
    ideal.array = None;
    let end = &mut ideal.front_end;
    (end.bits, end.rms_steps, end.bandwidth_hz, end.agc_time_constant_s) = (None, None, None, None);
    (end.if_hz, end.lo_offset_hz, end.real) = (0.0, 0.0, false);
    (end.iq_gain_db, end.iq_phase_deg, end.dc_offset) = (0.0, 0.0, [0.0; 2]);
    let rate_hz = end.rate_hz;
    let mut cells = Vec::new();
    let mut add = |property, setting: String, theory_loss_db, change: &dyn Fn(&mut Scenario)| {
        let mut scenario = ideal.clone();
        change(&mut scenario);
        let (suppression, elements) = (Suppression::Off, None);
        cells.push(Cell { property, setting, scenario, elements, suppression, theory_loss_db });
    };
    add("ideal", String::new(), Some(0.0), &|_| ());
    for bits in [1, 2, 3, 4, 8] {
        let theory = Some(quantiser_loss_db(bits, None));
        add("bits", bits.to_string(), theory, &|s| s.front_end.bits = Some(bits));
    }
    for rms_steps in [0.5, 0.7, 1.5, 2.0] {
        let theory = Some(quantiser_loss_db(2, Some(rms_steps)));
        add("level of 2 bits", format!("{rms_steps} steps"), theory, &|s| {
            (s.front_end.bits, s.front_end.rms_steps) = (Some(2), Some(rms_steps));
        });
    }
    for fraction in [0.9, 0.75, 0.6, 0.45] {
        let hz = fraction * rate_hz;
        add("bandwidth", megahertz(hz), Some(band_loss_db(hz, rate_hz)), &|s| {
            s.front_end.bandwidth_hz = Some(hz);
        });
    }
    for fraction in [0.05, 0.15, 0.25] {
        // A carrier off the middle loses nothing: sidelobes beyond the edges are aliased back.
        add("IF", megahertz(fraction * rate_hz), Some(0.0), &|s| {
            s.front_end.if_hz = fraction * rate_hz
        });
    }
    // Real samples: twice the rate, the same band about a quarter of it. The noise in the band is the same.
    let band_hz = 0.8 * rate_hz;
    let theory = Some(band_loss_db(band_hz, 2.0 * rate_hz));
    add("IF", format!("{} real", megahertz(rate_hz / 2.0)), theory, &|s| {
        let end = &mut s.front_end;
        (end.rate_hz, end.if_hz, end.real) = (2.0 * rate_hz, rate_hz / 2.0, true);
        end.bandwidth_hz = Some(band_hz);
    });
    for ppm in [-1.0, 0.5, 3.0, 10.0] {
        add("oscillator", format!("{ppm:+} ppm"), Some(0.0), &|s| s.receiver.clock_drift_ppm = ppm);
    }
    for db in [1.0, 2.0, 4.0, 8.0] {
        let loss = noise_figure_loss_db(db);
        add("noise figure", format!("{db} dB"), Some(loss), &|s| s.signal.cn0_dbhz -= loss);
    }
    for (side, gain_db, phase_deg) in
        [(2, 0.0, 0.0), (3, 0.0, 0.0), (2, 0.5, 5.0), (2, 1.0, 10.0), (2, 2.0, 20.0)]
    {
        // The beam is that of the measured signature, so that errors of the elements affect directions only.
        let elements = Elements { side, gain_db, phase: f64::to_radians(phase_deg) };
        let setting = match gain_db {
            0.0 => format!("{side}x{side}"),
            _ => format!("{side}x{side} {gain_db} dB {phase_deg} deg"),
        };
        cells.push(Cell {
            property: "elements",
            setting,
            elements: Some(elements),
            theory_loss_db: Some(-10.0 * (elements.count() as f64).log10()),
            ..cells[0].clone()
        });
    }
    let given = &given.noise;
    let share = if given.impulse_probability > 0.0 { given.impulse_probability } else { 0.1 };
    for ratio in [50.0, 1e3, 1e4] {
        let law = Mixture { probability: share, background: 1.0, impulse: ratio, real: false };
        for (suppression, map) in [
            (Suppression::Off, Map::Linear),
            (Suppression::Sign, Map::Sign),
            (Suppression::Clip(1.0), Map::Clip(1.0)),
            (Suppression::Blank(2.5), Map::Blank(2.5)),
            (Suppression::Auto, Map::Optimal),
        ] {
            let setting = format!("{share} x{ratio:.0} {suppression}");
            let mut scenario = ideal.clone();
            scenario.noise.impulse_probability = share;
            scenario.noise.impulse_variance_ratio = ratio;
            let theory_loss_db = Some(map.loss_db(&law));
            cells.push(Cell {
                property: "impulses",
                setting,
                scenario,
                elements: None,
                suppression,
                theory_loss_db,
            });
        }
    }
    let auto = Suppression::Auto;
    cells.push(Cell {
        property: "impulses",
        setting: "none, auto".into(),
        suppression: auto,
        ..cells[0].clone()
    });
    cells
}

fn megahertz(hz: f64) -> String {
    format!("{:.2} MHz", hz / 1e6)
}
