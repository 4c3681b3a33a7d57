//! Performance of JANE: probability of the right number of sources and error of the angles, against SNR, probability
//! of outliers, elements and snapshots, compared with the Cramer-Rao bound, and false alarms on noise alone.

use crate::claim::Claim;
use crate::{Findings, Scene};
use rayon::prelude::*;
use sdr_rx::array::decision::jane::bearing_sigma;
use sdr_rx::array::{
    Bearing, CMat, Jane, JaneError, JaneOptions, Manifold, Point, SparseOptions, cramer_rao,
    degree_grid, paper_dictionary, row_noise, row_rule, solve,
};
use sdr_rx::front_end::Map;
use sdr_rx::front_end::mixture::Mixture;
use sdr_rx::gnss::antenna::AntennaArray;
use sdr_rx::report::{Curve, LinePlot};

/// The paper's sources off the degrees of its grid, deg.
const OFF_GRID: [f64; 4] = [27.71, 30.37, 39.55, 52.24];

/// Outcomes over an abscissa.
struct Table {
    name: &'static str,
    title: &'static str,
    abscissa: &'static str,
    /// Abscissa, outcome, and the fraction of trials with the right number by the row rule where it was computed.
    rows: Vec<(f64, Detected, Option<f64>)>,
}

/// Amount of work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectionOptions {
    /// Trials of each point of a curve.
    pub trials: usize,
    /// Runs on noise alone.
    pub noise_runs: usize,
    /// First seed.
    pub seed: u64,
}

impl Default for DetectionOptions {
    fn default() -> Self {
        Self { trials: 60, noise_runs: 10_000, seed: 1 }
    }
}

/// Results of the trials of one scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detected {
    /// Fraction of trials with the right number of sources.
    pub right: f64,
    /// Fraction of trials with more.
    pub more: f64,
    /// Root mean square error of their angles in trials with the right number, deg; not a number without.
    pub error_deg: f64,
    /// Root mean square of the standard deviations that JANE gave for them, deg.
    pub sigma_deg: f64,
    /// Root mean square of the Cramer-Rao bounds of the angles, deg.
    pub bound_deg: f64,
}

/// JANE on `trials` draws of a scene, without candidates to start from.
///
/// # Errors
/// Those of [`Jane::new`] and [`Jane::decide`].
pub fn detect(scene: &Scene, trials: usize, seed: u64) -> Result<Detected, JaneError> {
    let manifold = Manifold::new(AntennaArray::half_wavelength(scene.elements));
    let jane = Jane::new(&manifold, JaneOptions::default())?;
    let mut truth = scene.angles_deg.clone();
    truth.sort_by(f64::total_cmp);
    let trial = |k: usize| {
        let y = scene.draw(seed + k as u64).y;
        let mut sources = jane.decide(&y, &[])?.sources;
        sources.sort_by(|a, b| a.point[0].total_cmp(&b.point[0]));
        let error = |(source, truth): (&sdr_rx::array::Source, &f64)| match source.bearing {
            Bearing::Cone(angle) => (angle.to_degrees() - truth).powi(2),
            Bearing::Direction { .. } => f64::NAN,
        };
        let errors = sources.iter().zip(&truth).map(error).sum::<f64>();
        let variances =
            sources.iter().map(|s| s.bearing_sigma[0].to_degrees().powi(2)).sum::<f64>();
        Ok((sources.len(), errors, variances))
    };
    let trials: Vec<(usize, f64, f64)> =
        (0..trials).into_par_iter().map(trial).collect::<Result<_, _>>()?;
    let right: Vec<_> = trials.iter().filter(|t| t.0 == truth.len()).collect();
    let more = trials.iter().filter(|t| t.0 > truth.len()).count();
    let angles = (right.len() * truth.len()) as f64;
    let rms = |sum: f64| (sum / angles).sqrt();
    Ok(Detected {
        right: right.len() as f64 / trials.len() as f64,
        more: more as f64 / trials.len() as f64,
        error_deg: rms(right.iter().map(|t| t.1).sum()),
        sigma_deg: rms(right.iter().map(|t| t.2).sum()),
        bound_deg: bound_deg(scene, &manifold),
    })
}

/// Root mean square of the bounds of a scene's angles, deg.
fn bound_deg(scene: &Scene, manifold: &Manifold) -> f64 {
    let points: Vec<Point> = scene.angles_deg.iter().map(|a| [a.to_radians().sin(), 0.0]).collect();
    let powers = vec![scene.amplitude.powi(2); points.len()];
    let noise = equivalent_noise(&scene.noise);
    let bounds = cramer_rao(manifold, &points, &powers, scene.snapshots as f64, noise);
    let variances =
        points.iter().zip(bounds).map(|(p, b)| bearing_sigma(manifold, *p, b)[0].powi(2));
    (variances.sum::<f64>() / points.len() as f64).sqrt().to_degrees()
}

/// The variance of Gaussian noise with the same effect: one over the Fisher information.
fn equivalent_noise(law: &Mixture) -> f64 {
    law.background * 10f64.powf(Map::Optimal.loss_db(law) / 10.0)
}

/// Fraction of draws of a scene in which the row rule on the l1,1 estimate (gamma 5, the paper's dictionary)
/// finds the right number.
fn row_rule_fraction(scene: &Scene, trials: usize, seed: u64) -> f64 {
    let (grid, responses) = (degree_grid(25, 55), paper_dictionary(scene.elements));
    let right = |k: &usize| {
        let y = scene.draw(seed + *k as u64).y;
        let options = SparseOptions { gamma: Some(5.0), ..SparseOptions::default() };
        let Ok(estimate) = solve(&responses, &y, &options) else { return false };
        let residual: CMat = &y - &responses * &estimate;
        row_rule(&estimate, &grid, row_noise(&residual)).len() == scene.angles_deg.len()
    };
    (0..trials).into_par_iter().filter(right).count() as f64 / trials as f64
}

/// Fraction of runs on noise alone in which JANE finds a source: half of them with 50 elements, the rest with
/// 16, 8 and 4; with and without outliers.
///
/// # Errors
/// Those of [`Jane::decide`].
pub fn false_alarms(runs: usize, seed: u64) -> Result<f64, JaneError> {
    let settings = [(50, 0.1), (50, 0.1), (50, 0.3), (16, 0.1), (8, 0.1), (4, 0.0)];
    let alarms = settings.into_par_iter().enumerate().map(|(at, (elements, share))| {
        let impulsive = Scene::default().noise;
        let noise = Mixture { probability: share, ..impulsive };
        let scene = Scene { elements, angles_deg: Vec::new(), noise, ..Scene::default() };
        let runs = (at..runs).step_by(settings.len()).count();
        let outcome = detect(&scene, runs, seed + (at * 1_000_000) as u64)?;
        Ok(outcome.more * runs as f64)
    });
    Ok(alarms.collect::<Result<Vec<f64>, _>>()?.iter().sum::<f64>() / runs as f64)
}

/// A table of JANE's outcomes over scenes.
fn table(
    name: &'static str,
    title: &'static str,
    abscissa: &'static str,
    scenes: impl IntoIterator<Item = (f64, Scene)>,
    options: &DetectionOptions,
) -> Result<Table, JaneError> {
    let row =
        |(x, scene): (f64, Scene)| Ok((x, detect(&scene, options.trials, options.seed)?, None));
    let rows = scenes.into_iter().map(row).collect::<Result<_, _>>()?;
    Ok(Table { name, title, abscissa, rows })
}

impl Table {
    fn curve(
        &self,
        name: &str,
        of: impl Fn(&(f64, Detected, Option<f64>)) -> Option<f64>,
    ) -> Curve {
        let points = self.rows.iter().filter_map(|row| Some((row.0, of(row)?)));
        Curve { name: name.into(), points: points.collect() }
    }

    fn plots(&self) -> [LinePlot; 2] {
        let right = self.curve("JANE", |row| Some(row.1.right));
        let rows = self.curve("row rule on the l1,1 estimate", |row| row.2);
        let errors = [
            self.curve("error", |row| Some(row.1.error_deg)),
            self.curve("standard deviation by JANE", |row| Some(row.1.sigma_deg)),
            self.curve("Cramer-Rao bound", |row| Some(row.1.bound_deg)),
        ];
        let plot = |kind: &str, ordinate: &str, log: bool, curves: Vec<Curve>| LinePlot {
            name: format!("{kind}-{}", self.name),
            title: self.title.into(),
            axes: [self.abscissa.into(), ordinate.into()],
            log: [false, log],
            curves: curves.into_iter().filter(|c| !c.points.is_empty()).collect(),
        };
        [
            plot("detection", "fraction with the right number", false, vec![right, rows]),
            plot("error", "angle error, rms (deg)", true, errors.to_vec()),
        ]
    }

    /// The minimum fraction of the right number from an abscissa up.
    fn minimum_right(&self, from: f64) -> f64 {
        self.rows.iter().filter(|r| r.0 >= from).map(|r| r.1.right).fold(1.0, f64::min)
    }

    /// The maximum error over its bound from an abscissa up.
    fn maximum_bounds(&self, from: f64) -> f64 {
        let rows = self.rows.iter().filter(|r| r.0 >= from);
        rows.map(|r| r.1.error_deg / r.1.bound_deg).fold(0.0, f64::max)
    }
}

/// All curves and claims. Some minutes of work with the default options.
///
/// # Errors
/// Those of [`Jane::decide`].
pub fn detection(options: &DetectionOptions) -> Result<Findings, JaneError> {
    const SNRS: [f64; 12] =
        [-30.0, -27.0, -25.0, -22.5, -20.0, -15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0];
    let paper = Scene::default;
    let off_grid = || Scene { angles_deg: OFF_GRID.to_vec(), ..paper() };
    // The signals are as strong whatever the outliers: their probability does not change the scene's amplitude.
    let with_share = |share: f64, snr: f64| {
        let mut scene = paper().with_snr(snr);
        scene.noise.probability = share;
        scene
    };
    let with_elements = |elements: usize| {
        Scene { elements, angles_deg: vec![-25.0, 30.0], ..paper() }.with_snr(0.0)
    };
    let with_snapshots = |snapshots: usize, snr: f64| Scene { snapshots, ..paper() }.with_snr(snr);

    let mut on = table(
        "snr",
        "The paper's scene: 50 elements, 100 snapshots, 10 % outliers",
        "SNR (dB)",
        SNRS.map(|snr| (snr, paper().with_snr(snr))),
        options,
    )?;
    for (snr, _, share) in &mut on.rows {
        *share =
            Some(row_rule_fraction(&paper().with_snr(*snr), options.trials.min(30), options.seed));
    }
    let off = table(
        "snr-off-grid",
        "Sources off the paper's grid: 27.71, 30.37, 39.55 and 52.24 deg",
        "SNR (dB)",
        SNRS.map(|snr| (snr, off_grid().with_snr(snr))),
        options,
    )?;
    let outliers = table(
        "outliers",
        "Outliers of 50 times the variance, at 0 dB",
        "probability of outliers",
        [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3].map(|share| (share, with_share(share, 0.0))),
        options,
    )?;
    let elements = table(
        "elements",
        "Elements: two sources at -25 and 30 deg, 0 dB",
        "elements",
        [4, 6, 8, 12, 16, 24, 32, 50].map(|m| (m as f64, with_elements(m))),
        options,
    )?;
    let snapshots = table(
        "snapshots",
        "Snapshots: the paper's scene at -20 dB",
        "snapshots",
        [4, 10, 30, 100, 300].map(|n| (f64::from(n), with_snapshots(n as usize, -20.0))),
        options,
    )?;
    let few = detect(&with_snapshots(4, 0.0), options.trials, options.seed)?;
    let sixteen = Scene { elements: 16, ..paper() };
    let sixteen = detect(&sixteen, options.trials, options.seed)?;
    let eight = Scene { elements: 8, angles_deg: vec![-35.0, 3.0, 45.0], ..paper() };
    let eight = detect(&eight.with_snr(-10.0), options.trials, options.seed)?;
    let alarms = false_alarms(options.noise_runs, options.seed)?;

    let right = on.minimum_right(-25.0).min(off.minimum_right(-25.0));
    let bounds = |from: f64| on.maximum_bounds(from).max(off.maximum_bounds(from));
    let row_rule =
        |snr: f64| on.rows.iter().find(|r| r.0 == snr).and_then(|r| r.2).unwrap_or(f64::NAN);
    let claims = vec![
        at_least("four sources found down to -25 dB: fraction of the trials", right, 0.95),
        at_most("angle error over its Cramer-Rao bound, from -20 dB up", bounds(-20.0), 1.5),
        at_most("the same from -5 dB up", bounds(-5.0), 1.15),
        at_most("fraction in which the row rule finds four at -15 dB", row_rule(-15.0), 0.0),
        at_least("the same at 0 dB", row_rule(0.0), 0.95),
        at_most(
            "error over its bound with up to 30 % outliers, 0 dB",
            outliers.maximum_bounds(0.0),
            1.5,
        ),
        at_least("four snapshots at 0 dB: fraction with the right number", few.right, 0.95),
        at_most("16 elements at 20 dB: error of the four angles, deg", sixteen.error_deg, 0.016),
        at_least("8 elements at -10 dB: fraction in which three are found", eight.right, 0.95),
        at_most("noise alone: fraction of runs with a source (0.001 asked for)", alarms, 2e-3),
    ];
    let plots = [on, off, outliers, elements, snapshots].iter().flat_map(Table::plots).collect();
    Ok(Findings { plots, claims, ..Findings::default() })
}

fn at_least(text: &str, measured: f64, limit: f64) -> Claim {
    claim(text, format!("at least {limit}"), measured, measured >= limit)
}

fn at_most(text: &str, measured: f64, limit: f64) -> Claim {
    claim(text, format!("at most {limit}"), measured, measured <= limit)
}

fn claim(text: &str, limit: String, measured: f64, holds: bool) -> Claim {
    Claim { place: "JANE", claim: text.into(), paper: limit, ours: format!("{measured:.4}"), holds }
}
