//! JANE: joint angle and number estimation.
//!
//! The decision of Li, Huang, Liu, Feng and Chen ("Acquisition of visible satellites based on antenna arrays
//! via joint l1,1-norms minimization", IEEE TVT 72(5), 2023) with a statistical test: the sparse estimate (or
//! nothing) gives candidates, robust maximum likelihood estimates their directions off the grid, a test with
//! a known false-alarm probability keeps or drops each, and a scan of the residual searches more until there
//! is none. See `robust_fit` and [`super::scan`] for the two parts.
//!
//! Source q is kept when T_q = sum_n |x_qn|^2 / var(x_qn), which is Gamma(N, 1) when there is no source,
//! exceeds the threshold that noise exceeds anywhere on the manifold with the requested probability; the same
//! threshold holds for the scan, sum_n |a^H W r_n|^2 / (|a|^2 I) with a outside of the sources' span and I
//! the mean of |W r|^2 (times M / (M - Q)).

use super::robust_fit::{RobustFit, Tested};
use super::scan::Scan;
use crate::array::CMat;
use crate::array::geometry::{Bearing, Manifold, Point};
use crate::front_end::mixture::Mixture;

/// Options of the decision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JaneOptions {
    /// Probability of a source where there is none, 0 to 1, both excluded.
    pub false_alarm: f64,
    /// Maximum number of sources; always fewer than elements.
    pub max_sources: usize,
    /// Error of the known responses, as a fraction of their power (variance of gain, plus that of phase in
    /// rad): strong sources then do not cause weak false ones next to them.
    pub mismatch: f64,
}

impl Default for JaneOptions {
    fn default() -> Self {
        Self { false_alarm: 1e-3, max_sources: usize::MAX, mismatch: 0.0 }
    }
}

/// Why no decision is possible.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum JaneError {
    /// One element, or all in one position.
    #[error(
        "deciding on sources: the array has no extent, so it cannot resolve directions; give the positions of two or more elements"
    )]
    NoDirections,
    /// Data of another array.
    #[error(
        "deciding on sources: the data has {rows} rows and {columns} columns, the array {elements} elements; a row per element and one column or more are needed"
    )]
    Shape {
        /// Rows of the data.
        rows: usize,
        /// Columns of the data.
        columns: usize,
        /// Elements of the array.
        elements: usize,
    },
    /// Data that are not finite, or all zero.
    #[error(
        "deciding on sources: the data is zero throughout, or holds a number that is not finite"
    )]
    NoPower,
    /// Not a probability.
    #[error("deciding on sources: the false-alarm probability is {0}; it must lie between 0 and 1")]
    FalseAlarm(f64),
}

/// A source that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Direction cosines.
    pub point: Point,
    /// Standard deviation of each coordinate, from the Fisher information.
    pub sigma: Point,
    /// The direction as angles.
    pub bearing: Bearing,
    /// Standard deviation of the cone angle, and 0; or of azimuth and elevation. rad.
    pub bearing_sigma: [f64; 2],
    /// Mean power at an element of unit gain, in the data's units squared.
    pub power: f64,
    /// T of the module's documentation: Gamma(N, 1) without a source.
    pub statistic: f64,
}

/// Result of the decision.
#[derive(Clone, Debug, PartialEq)]
pub struct Decision {
    /// The sources, the strongest first.
    pub sources: Vec<Source>,
    /// The distribution of the noise of a sample.
    pub noise: Mixture,
    /// Fisher information of a sample: 1 / variance of the Gaussian noise with the same effect.
    pub information: f64,
    /// Threshold of the statistics.
    pub threshold: f64,
}

/// The decision for one array: tables that are common to many calls.
///
/// A call costs some 20 rounds of O(M N Q^2): a few ms for M = 50, N = 100 and four sources.
#[derive(Clone, Debug)]
pub struct Jane {
    pub(super) scan: Scan,
    pub(super) options: JaneOptions,
}

impl Jane {
    /// Prepares decisions for an array.
    ///
    /// # Errors
    /// [`JaneError::NoDirections`], [`JaneError::FalseAlarm`].
    pub fn new(manifold: &Manifold, options: JaneOptions) -> Result<Self, JaneError> {
        if manifold.dimensions() == 0 {
            return Err(JaneError::NoDirections);
        }
        if !(options.false_alarm > 0.0 && options.false_alarm < 1.0) {
            return Err(JaneError::FalseAlarm(options.false_alarm));
        }
        Ok(Self { scan: Scan::new(manifold), options })
    }

    /// The array's manifold.
    pub fn manifold(&self) -> &Manifold {
        self.scan.manifold()
    }

    /// The statistic that noise alone exceeds anywhere with this probability, of so many snapshots.
    pub fn threshold(&self, false_alarm: f64, snapshots: f64) -> f64 {
        self.scan.threshold(false_alarm, snapshots)
    }

    /// Sources in snapshots (elements x snapshots) with white, perhaps impulsive noise, from candidates
    /// `start`: the groups of [`super::row_rule::row_rule`], or none, which gives equal results.
    ///
    /// # Errors
    /// [`JaneError::Shape`], [`JaneError::NoPower`].
    pub fn decide(&self, snapshots: &CMat, start: &[Point]) -> Result<Decision, JaneError> {
        let elements = self.check(snapshots)?;
        let count = snapshots.ncols() as f64;
        let threshold = self.scan.threshold(self.options.false_alarm, count);
        let most = self.options.max_sources.min(elements - 1);
        let manifold = self.manifold();
        let mut fit =
            RobustFit::new(manifold, snapshots, self.scan.step()).ok_or(JaneError::NoPower)?;
        start.iter().take(most.min(elements / 3)).for_each(|p| fit.add(*p));
        fit.settle(ROUGHLY.0, ROUGHLY.1);
        self.prune(&mut fit, threshold);
        // The noise is fitted again once no more source is found; sources that it hid may then appear.
        let mut noise_is_new = false;
        // Two sources could take turns in replacing each other for ever.
        let mut additions = 0..ADDITIONS * most;
        loop {
            if fit.points().len() < most
                && additions.next().is_some()
                && let Some(point) = self.another(&fit, threshold, count)
            {
                fit.add(point);
                fit.settle(ROUGHLY.0, ROUGHLY.1);
                // A source that fails after the others have moved would be found again endlessly.
                if self.prune(&mut fit, threshold) {
                    noise_is_new = false;
                    continue;
                }
            }
            if noise_is_new {
                break;
            }
            noise_is_new = true;
            fit.refit_noise();
            fit.settle(FINELY.0, FINELY.1);
        }
        self.prune(&mut fit, threshold);
        Ok(self.decision(&fit, threshold))
    }

    /// Rows of the data, if they are this array's.
    pub(super) fn check(&self, data: &CMat) -> Result<usize, JaneError> {
        let (rows, columns) = data.shape();
        let elements = self.manifold().elements();
        if rows != elements || columns == 0 {
            return Err(JaneError::Shape { rows, columns, elements });
        }
        let power = data.squared_norm_l2();
        if power > 0.0 && power.is_finite() { Ok(elements) } else { Err(JaneError::NoPower) }
    }

    /// Removes the weakest sources until all pass; returns whether the last that was added is kept.
    fn prune(&self, fit: &mut RobustFit<'_>, threshold: f64) -> bool {
        let reach = self.scan.step();
        let mut last_stays = true;
        loop {
            let tested = fit.tested();
            let blurred = |t: &Tested| t.covariance[0][0].max(t.covariance[1][1]) > reach * reach;
            let weak = |q: &usize| tested[*q].statistic < threshold || blurred(&tested[*q]);
            let mut order: Vec<usize> = (0..tested.len()).filter(weak).collect();
            if order.is_empty() {
                return last_stays;
            }
            // Half of those that fail: with the weakest gone, the others may pass.
            order.sort_by(|&a, &b| tested[a].statistic.total_cmp(&tested[b].statistic));
            order.truncate(order.len().div_ceil(2));
            let keep: Vec<bool> = (0..tested.len()).map(|q| !order.contains(&q)).collect();
            last_stays &= keep[tested.len() - 1];
            fit.retain(&keep);
            fit.settle(ROUGHLY.0, ROUGHLY.1);
        }
    }

    /// Direction of another source found by the scan.
    fn another(&self, fit: &RobustFit<'_>, threshold: f64, count: f64) -> Option<Point> {
        let data = fit.weighted_residual();
        let (point, score) = self.scan.strongest(&data, &fit.responses())?;
        // Maximum power in one beam due to errors of the responses to known sources.
        let known: f64 = fit.tested().iter().map(|t| t.power).sum();
        let information = fit.information();
        let errors = count * information * known * self.mismatch_factor();
        (score / information > threshold + errors).then_some(point)
    }

    /// An exponential variable of mean `mismatch` stays below this anywhere on the manifold.
    pub(super) fn mismatch_factor(&self) -> f64 {
        self.options.mismatch * self.scan.threshold(self.options.false_alarm, 1.0)
    }

    fn decision(&self, fit: &RobustFit<'_>, threshold: f64) -> Decision {
        let sources = fit.points().iter().zip(fit.tested());
        let sources = sources
            .map(|(point, t)| self.source(*point, t.covariance, t.power, t.statistic))
            .collect();
        let (noise, information) = (fit.noise(), fit.information());
        sorted(Decision { sources, noise, information, threshold })
    }

    /// A source, with its angles computed from its coordinates.
    pub(super) fn source(
        &self,
        point: Point,
        covariance: [[f64; 2]; 2],
        power: f64,
        statistic: f64,
    ) -> Source {
        let manifold = self.manifold();
        Source {
            point,
            sigma: [covariance[0][0].sqrt(), covariance[1][1].sqrt()],
            bearing: manifold.bearing(point),
            bearing_sigma: bearing_sigma(manifold, point, covariance),
            power,
            statistic,
        }
    }
}

/// Sources added at most, times the maximum number of sources.
const ADDITIONS: usize = 3;
/// Iterations of the fit after each change, and when no more source is found: their maximum number, and the
/// step, in standard deviations, below which they end.
const ROUGHLY: (usize, f64) = (6, 0.3);
const FINELY: (usize, f64) = (40, 0.01);

/// The strongest first.
pub(super) fn sorted(mut decision: Decision) -> Decision {
    decision.sources.sort_by(|a, b| b.statistic.total_cmp(&a.statistic));
    decision
}

/// Standard deviations of a bearing's angles from the covariance of the point, rad: of the cone angle, and
/// 0; or of azimuth and elevation.
pub fn bearing_sigma(manifold: &Manifold, point: Point, covariance: [[f64; 2]; 2]) -> [f64; 2] {
    let angles = |point: Point| match manifold.bearing(point) {
        Bearing::Cone(angle) => [angle, 0.0],
        Bearing::Direction { azimuth, elevation } => [azimuth, elevation],
    };
    const STEP: f64 = 1e-6;
    let slope = |axis: usize| {
        let side = |sign: f64| {
            let mut moved = point;
            moved[axis] += sign * STEP;
            angles(moved)
        };
        let (plus, minus) = (side(1.0), side(-1.0));
        let turn = std::f64::consts::TAU;
        // An azimuth may pass north between the two.
        [0, 1].map(|k| {
            let change: f64 = plus[k] - minus[k];
            (change - turn * (change / turn).round()) / (2.0 * STEP)
        })
    };
    let slopes = [slope(0), slope(1)];
    [0, 1].map(|k| {
        let pairs = [(0, 0), (0, 1), (1, 0), (1, 1)];
        let sum =
            pairs.map(|(i, j)| slopes[i][k] * slopes[j][k] * covariance[i][j]).iter().sum::<f64>();
        sum.max(0.0).sqrt()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::antenna::AntennaArray;
    use num_complex::Complex64;

    #[test]
    fn impossible_decisions_are_errors() {
        let manifold = |count| Manifold::new(AntennaArray::half_wavelength(count));
        let none = Jane::new(&manifold(1), JaneOptions::default()).err();
        assert_eq!(none, Some(JaneError::NoDirections));
        for false_alarm in [0.0, 1.0, f64::NAN] {
            let options = JaneOptions { false_alarm, ..JaneOptions::default() };
            assert!(matches!(Jane::new(&manifold(4), options), Err(JaneError::FalseAlarm(_))));
        }
        let jane = Jane::new(&manifold(4), JaneOptions::default()).unwrap();
        let wrong = JaneError::Shape { rows: 3, columns: 5, elements: 4 };
        assert_eq!(jane.decide(&CMat::zeros(3, 5), &[]), Err(wrong));
        assert!(matches!(jane.decide(&CMat::zeros(4, 0), &[]), Err(JaneError::Shape { .. })));
        assert_eq!(jane.decide(&CMat::zeros(4, 5), &[]), Err(JaneError::NoPower));
        let absurd =
            CMat::from_fn(4, 4, |m, _| Complex64::from(if m == 2 { f64::NAN } else { 1.0 }));
        assert_eq!(jane.decide(&absurd, &[]), Err(JaneError::NoPower));
        assert_eq!(jane.decide_covariance(&absurd, 10.0, None, &[]), Err(JaneError::NoPower));
        let narrow = jane.decide_covariance(&CMat::identity(4, 3), 10.0, None, &[]);
        assert!(matches!(narrow, Err(JaneError::Shape { .. })));
    }

    #[test]
    fn data_without_noise_are_decided() {
        let manifold = Manifold::new(AntennaArray::half_wavelength(8));
        let jane = Jane::new(&manifold, JaneOptions::default()).unwrap();
        let a = manifold.response([0.3, 0.0]);
        let clean = CMat::from_fn(8, 20, |m, n| a[m] * Complex64::cis(n as f64));
        let found = jane.decide(&clean, &[]).unwrap().sources;
        assert!((found[0].point[0] - 0.3).abs() < 1e-6, "{found:?}");
        // As many as one wave resembles after rounding; never as many as elements.
        assert!(found.len() < 8);
    }

    #[test]
    fn standard_deviations_of_angles_follow_from_those_of_the_cosines() {
        let line = Manifold::new(AntennaArray::half_wavelength(4));
        // d theta = d s / cos theta.
        let [angle, none] = bearing_sigma(&line, [0.6, 0.0], [[1e-4, 0.0], [0.0, 0.0]]);
        assert!((angle - 0.01 / 0.8).abs() < 1e-8 && none == 0.0);
        let half = crate::gnss::signal::L1_WAVELENGTH / 2.0;
        let corners = [[0.0, 0.0], [half, 0.0], [0.0, half]];
        let plane = corners.map(|[x, y]| nalgebra::Vector3::new(x, y, 0.0)).to_vec();
        let plane = Manifold::new(AntennaArray::new(plane));
        // East at elevation acos 0.5: the first cosine turns the elevation by 1 / sin el, the second the
        // azimuth by 1 / cos el.
        let axis = |k: usize| plane.point(&nalgebra::Vector3::ith_axis(k));
        let (east, north) = (axis(0), axis(1));
        let point = [0.5 * east[0], 0.5 * east[1]];
        let along = |d: Point, s: f64| [0, 1].map(|i| [0, 1].map(|j| s * s * d[i] * d[j]));
        let [azimuth, elevation] = bearing_sigma(&plane, point, along(east, 0.01));
        assert!(azimuth < 1e-8 && (elevation - 0.01 / 0.75f64.sqrt()).abs() < 1e-8);
        let [azimuth, elevation] = bearing_sigma(&plane, point, along(north, 0.01));
        assert!((azimuth - 0.02).abs() < 1e-8 && elevation < 1e-8);
    }
}
