//! Which sets of an epoch's satellites agree, and how far apart the places are where they do: solution separation
//! with a list of fault hypotheses.
//!
//! After Blanch et al., "Baseline advanced RAIM user algorithm and possible improvements", IEEE Trans. Aerospace and
//! Electronic Systems 51(1), 2015, section III. A hypothesis `h` takes some satellites as faulty: the others give a
//! place `x_h`, its covariance `Q_h` and a cost `c_h`; `s_h^2 = tr Q_h`. It is *alive* if its iteration converged, its
//! height is possible, and `c_h` passes the chi-square test (1e-5 of false alarm). The answer `x*` is that of the alive
//! hypothesis of fewest faults, then smallest cost. With `g = max(2, |h*| + 1)` faults reckoned with, over the `n` alive
//! hypotheses of at most `g` faults:
//!
//! ```text
//! PL = max ( |x* - x_h| + K_h s_h ),  K_h = Qinv( P / (2 n p_h) ),  p_h = p^max(0, |h| - |h*|)
//! ```
//!
//! with the prior `p` of a fault ([`PRIOR_FAULT`]) and the integrity risk `P` ([`RISK`]); `K_h` is 0 where a
//! hypothesis is so improbable that its share of the risk is half of it. Against the paper, the measured separation stands in place of its threshold: if `h` is the truth, no fault
//! touches `x_h`, so that the error stays below `|x* - x_h| + K_h s_h`. Horizontal and vertical levels are the same of
//! their parts.
//!
//! All sets are solved on rows that were predicted once, at an anchor ([`Anchor`]): satellites stand still, and what
//! the full model adds to the geometry is a constant, which holds for 10 km. `1 + m + m (m - 1)/2` sets of `m`
//! satellites take two or three linear systems each.

use super::adjustment::{Adjustment, ITERATES_M, Measured, bias};
use super::sighting::{Sighting, reference_clock};
use crate::fix::ProtectionLevel;
use crate::gauss_newton::{Damping, Model, Step, Verdict, gauss_newton};
use crate::integrity::{
    ALERT_LIMIT_M, DISTINCT_M, PRIOR_FAULT, RISK, chi_square_limit, tail_quantile,
};
use crate::least_squares::{LeastSquares, LinearRow};
use crate::options::{Height, Observable};
use crate::point::Point;
use crate::problem::{RowKind, Satellite};
use nalgebra::{Matrix3, Vector3};
use sdr_rx_gnss::constants::EARTH_RADIUS;
use sdr_rx_gnss::coordinates::Geodetic;

/// Faults that are always reckoned with.
const FAULTS: u32 = 2;
/// Most faults that are looked for.
const MOST_FAULTS: u32 = 3;
/// Distance from its anchor, m, up to which a place is solved by frozen rows: the Earth's rotation during the light time
/// changes by 2.4 um a metre, the satellites' motion by the clock's bias by 13 um a metre.
const ANCHORED_M: f64 = 1e4;
/// A solution has converged when a step is shorter than this, m: the next one would be 1e-13 of it.
const CONVERGED_M: f64 = 0.1;
/// Linear systems for one set from one anchor, and anchors it may need.
const MOST_STEPS: usize = 12;
const MOST_ANCHORS: usize = 6;
/// Smallest height above the ellipsoid, m, where a receiver is believed to be.
const MIN_HEIGHT_M: f64 = -500.0;

/// A set of satellites, one bit each by its index: there are not as many code numbers.
pub(super) type Set = u128;

/// A row as seen from an anchor, its satellite at rest.
#[derive(Clone, Copy, Debug)]
struct FrozenRow {
    satellite: usize,
    kind: RowKind,
    term: usize,
    frozen: Satellite,
    /// Observation without all that the geometry and the clock do not give.
    value: f64,
    sigma: f64,
}

/// The rows of all satellites as predicted at a point.
struct Anchor {
    place_m: Vector3<f64>,
    /// Bias of the clock that told the time of reception, m.
    bias_m: f64,
    rows: Vec<FrozenRow>,
}

impl Anchor {
    /// At a point, and the time of reception by a bias, m.
    fn new(adjustment: &Adjustment, set: &[Sighting], at: &Point<3>, bias_m: f64) -> Self {
        let predictions = adjustment.predict_by(set, at, bias_m);
        let measured = adjustment.measured(set, &predictions, at);
        let freeze = |row: Measured| {
            let frozen = predictions[row.satellite].satellite;
            let geometry = row.kind.see(&frozen, &at.x).value;
            FrozenRow {
                satellite: row.satellite,
                kind: row.kind,
                term: row.term,
                frozen,
                value: row.residual + geometry + at.clocks[row.term],
                sigma: row.sigma(),
            }
        };
        Self { place_m: at.x, bias_m, rows: measured.map(freeze).collect() }
    }

    /// How far it is from a point with the bias of its clock, m.
    fn distance(&self, to: &Point<3>, bias_m: f64) -> f64 {
        (self.place_m - to.x).norm().max((self.bias_m - bias_m).abs())
    }
}

/// The rows of one set.
struct FrozenSet<'a> {
    anchor: &'a Anchor,
    faulty: Set,
    height: Option<Height>,
}

impl Model<3, 4> for FrozenSet<'_> {
    type View = ();

    fn look(&self, at: &Point<3>, (): &mut (), system: &mut LeastSquares<3, 4>) {
        let used = self.anchor.rows.iter().filter(|row| self.faulty >> row.satellite & 1 == 0);
        let linear = used.map(|row| {
            let seen = row.kind.see(&row.frozen, &at.x);
            let g = row.kind.gradient(&row.frozen, &seen);
            let residual = row.value - seen.value - at.clocks[row.term];
            LinearRow::new([g.x, g.y, g.z, residual], row.sigma, Some(row.term))
        });
        system.set(linear.chain(self.height.map(|height| height.row(&at.x))));
    }

    fn verdict(&self, step: &Step<3>, _: &LeastSquares<3, 4>) -> Verdict {
        match step.length {
            _ if !ITERATES_M.contains(&step.to.x.norm()) => Verdict::Abandon,
            length if length < CONVERGED_M => Verdict::Converged,
            _ => Verdict::Continue,
        }
    }
}

/// A set of faulty satellites, and where the others place the receiver.
#[derive(Clone, Debug)]
pub(super) struct Hypothesis {
    pub faulty: Set,
    pub point: Point<3>,
    /// ECEF, m^2.
    pub covariance: Matrix3<f64>,
    /// Weighted sum of squared residuals.
    pub cost: f64,
    /// Rows more than unknowns.
    pub redundancy: usize,
    height_m: f64,
}

impl Hypothesis {
    pub fn faults(&self) -> u32 {
        self.faulty.count_ones()
    }

    fn variance(&self) -> f64 {
        self.covariance.trace()
    }

    /// Whether the residuals pass their test if variances are `factor` times what they are thought to be.
    fn passes(&self, factor: f64) -> bool {
        self.redundancy == 0 || self.cost <= factor * chi_square_limit(self.redundancy)
    }
}

/// What the hypotheses of an epoch say.
pub(super) enum Answer {
    /// The place of this one, with its protection level if there are satellites enough for one.
    Place(Hypothesis, Option<ProtectionLevel>),
    /// Two places fit equally well.
    Competing(Hypothesis, Hypothesis),
    /// No set agrees.
    None,
}

/// An epoch with its hypotheses.
pub(super) struct Hypotheses<'a> {
    adjustment: Adjustment<'a>,
    pub set: Vec<Sighting<'a>>,
    start: Point<3>,
    anchors: Vec<Anchor>,
    /// By the number of faults.
    list: Vec<Hypothesis>,
}

impl<'a> Hypotheses<'a> {
    /// Solves all sets without up to two of the satellites `set`, from `start`.
    pub fn new(adjustment: Adjustment<'a>, set: Vec<Sighting<'a>>, start: &Point<3>) -> Self {
        let bias_m = start.clocks[bias(reference_clock(&set))];
        let anchors = vec![Anchor::new(&adjustment, &set, start, bias_m)];
        let (start, list) = (start.clone(), Vec::new());
        let mut hypotheses = Self { adjustment, set, start, anchors, list };
        (0..=FAULTS).for_each(|faults| hypotheses.solve_all(faults));
        hypotheses
    }

    /// That without a fault, if it has a solution.
    pub fn faultless(&self) -> Option<&Hypothesis> {
        self.list.first().filter(|h| h.faulty == 0)
    }

    /// Whether all satellites pass the test together.
    pub fn agree(&self) -> bool {
        self.faultless().is_some_and(|all| all.redundancy > 0 && all.passes(1.0))
    }

    /// Whether a hypothesis explains the observations.
    pub fn explain(&self) -> bool {
        self.best(1.0).is_some()
    }

    fn solve_all(&mut self, faults: u32) {
        let mut start = self.list.first().map_or(&self.start, |h| &h.point).clone();
        if !ITERATES_M.contains(&start.x.norm()) {
            // A gross fault has led into the Earth or far away: the others lead back from the surface.
            start.x *= EARTH_RADIUS / start.x.norm().max(1.0);
        }
        for faulty in subsets(self.set.len() as u32, faults) {
            let solved = self.solve(faulty, &start);
            self.list.extend(solved);
        }
    }

    /// Rows, and terms of clocks that they contain, of a set.
    fn redundancy(&self, faulty: Set) -> Option<usize> {
        let rows = || self.anchors[0].rows.iter().filter(|r| faulty >> r.satellite & 1 == 0);
        let mut terms = 0u64;
        rows().for_each(|row| terms |= 1 << row.term);
        let known = rows().count() + usize::from(self.adjustment.options.height.is_some());
        known.checked_sub(3 + terms.count_ones() as usize)
    }

    fn solve(&mut self, faulty: Set, start: &Point<3>) -> Option<Hypothesis> {
        let redundancy = self.redundancy(faulty)?;
        let height = self.adjustment.options.height;
        let mut point = start.clone();
        // The time is that of a clock that those without fault observe.
        let used = self.set.iter().enumerate().filter(|(k, _)| faulty >> k & 1 == 0);
        let term = bias(reference_clock(used.map(|(_, sighting)| sighting)));
        for _ in 0..MOST_ANCHORS {
            let bias_m = point.clocks[term];
            let near = |anchor: &&Anchor| anchor.distance(&point, bias_m) < ANCHORED_M;
            let anchor = match self.anchors.iter().find(near) {
                Some(anchor) => anchor,
                None => {
                    self.anchors.push(Anchor::new(&self.adjustment, &self.set, &point, bias_m));
                    self.anchors.last()?
                }
            };
            let model = FrozenSet { anchor, faulty, height };
            let found = gauss_newton(&model, point, &Damping::plain(MOST_STEPS), |_| ()).ok()?;
            if anchor.distance(&found.point, found.point.clocks[term]) < ANCHORED_M {
                let height_m = Geodetic::from_ecef(&found.point.x).height;
                let covariance = found.system.covariance();
                let cost = found.cost;
                let point = found.point;
                return Some(Hypothesis { faulty, point, covariance, cost, redundancy, height_m });
            }
            point = found.point;
        }
        None
    }

    /// Judges them, with variances `factor` times what they are thought to be.
    pub fn judge(&mut self, factor: f64) -> Answer {
        let factor = factor.max(1.0);
        let mut solved = FAULTS;
        loop {
            let best = self.best(factor).map(|h| (h.faults().max(FAULTS - 1) + 1, h.clone()));
            let wanted = best.as_ref().map_or(MOST_FAULTS, |(reckoned, _)| *reckoned);
            if wanted > solved && solved < MOST_FAULTS {
                solved += 1;
                self.solve_all(solved);
                continue;
            }
            let Some((reckoned, best)) = best else { return Answer::None };
            let apart = |h: &&Hypothesis| {
                let sigma = (factor * (h.variance() + best.variance())).sqrt();
                (h.point.x - best.point.x).norm() > (5.0 * sigma).max(DISTINCT_M)
            };
            let level = self.protection_level(&best, reckoned, factor);
            if !level.is_some_and(|level| level.position_m <= self.alert_limit(&best, factor)) {
                let rival = |h: &&Hypothesis| h.redundancy > 0 && h.faults() <= best.faults();
                let rivals = self.alive(factor).filter(rival).filter(apart);
                if let Some(rival) = rivals.min_by(|a, b| a.cost.total_cmp(&b.cost)) {
                    return Answer::Competing(best.clone(), rival.clone());
                }
            }
            return Answer::Place(best, level);
        }
    }

    /// Largest protection level of a place that counts as proved, m.
    pub fn alert_limit(&self, best: &Hypothesis, factor: f64) -> f64 {
        match self.adjustment.options.observable {
            Observable::Pseudorange => ALERT_LIMIT_M,
            // Dopplers give places to hundreds of metres: proved is what is as good as their noise allows.
            _ => (10.0 * (factor * best.variance()).sqrt()).max(ALERT_LIMIT_M),
        }
    }

    /// A height beyond those of people and aircraft is believed only if all satellites agree on it.
    fn possible(&self, hypothesis: &Hypothesis, factor: f64) -> bool {
        let most = self.adjustment.options.max_height_m;
        let is_high = |h: &Hypothesis| h.height_m >= most;
        let agreed = self
            .faultless()
            .is_some_and(|all| is_high(all) && all.redundancy > 0 && all.passes(factor));
        (MIN_HEIGHT_M..most).contains(&hypothesis.height_m) || (agreed && is_high(hypothesis))
    }

    fn alive(&self, factor: f64) -> impl Iterator<Item = &Hypothesis> {
        self.list.iter().filter(move |h| h.passes(factor) && self.possible(h, factor))
    }

    /// Those of fewest faults that are possible, but that nothing checks.
    pub fn unchecked(&self) -> impl Iterator<Item = &Hypothesis> {
        let possible = |h: &&Hypothesis| h.redundancy == 0 && self.possible(h, 1.0);
        let fewest = self.list.iter().filter(possible).map(Hypothesis::faults).min();
        self.list.iter().filter(possible).filter(move |h| Some(h.faults()) == fewest)
    }

    /// The alive one of fewest faults, then smallest cost, that something checks, or nothing contradicts.
    fn best(&self, factor: f64) -> Option<&Hypothesis> {
        let checked = |h: &&Hypothesis| h.redundancy > 0 || h.faulty == 0;
        self.alive(factor)
            .filter(checked)
            .min_by(|a, b| a.faults().cmp(&b.faults()).then(a.cost.total_cmp(&b.cost)))
    }

    /// None if fewer satellites than a position needs may be without fault.
    fn protection_level(
        &self,
        best: &Hypothesis,
        reckoned: u32,
        factor: f64,
    ) -> Option<ProtectionLevel> {
        let mut sets = subsets(self.set.len() as u32, reckoned);
        if self.set.len() < reckoned as usize + 1 || sets.any(|f| self.redundancy(f).is_none()) {
            return None;
        }
        let reckoned_with = || self.alive(factor).filter(|h| h.faults() <= reckoned);
        let count = reckoned_with().count() as f64;
        let enu = Geodetic::from_ecef(&best.point.x).ecef_to_enu();
        let zero = ProtectionLevel { position_m: 0.0, horizontal_m: 0.0, vertical_m: 0.0 };
        Some(reckoned_with().fold(zero, |level, h| {
            let more = h.faults().saturating_sub(best.faults());
            let prior = PRIOR_FAULT.powi(more as i32);
            let share = RISK / (count * prior);
            let k = if share < 0.5 { tail_quantile(share / 2.0) } else { 0.0 };
            let apart: Vector3<f64> = enu * (h.point.x - best.point.x);
            let covariance = enu * h.covariance * enu.transpose() * factor;
            let variance = |axis: usize| covariance[(axis, axis)];
            let reach = |apart: f64, variance: f64| apart + k * variance.sqrt();
            let [horizontal, vertical] = [variance(0) + variance(1), variance(2)];
            ProtectionLevel {
                position_m: level.position_m.max(reach(apart.norm(), horizontal + vertical)),
                horizontal_m: level.horizontal_m.max(reach(apart.xy().norm(), horizontal)),
                vertical_m: level.vertical_m.max(reach(apart.z.abs(), vertical)),
            }
        }))
    }
}

/// All sets of `count` of `of` satellites, in order.
pub(super) fn subsets(of: u32, count: u32) -> impl Iterator<Item = Set> {
    let first = (count <= of).then(|| (1 << count) - 1);
    let limit: Set = if of < Set::BITS { 1 << of } else { Set::MAX };
    // The next larger number with as many bits (Warren, "Hacker's Delight", 2-1).
    std::iter::successors(first, move |&set: &Set| {
        let lowest = set & set.wrapping_neg();
        let ripple = set.checked_add(lowest).filter(|_| set != 0)?;
        Some(ripple | ((ripple ^ set) / lowest) >> 2)
    })
    .take_while(move |&set| set < limit)
}

#[cfg(test)]
mod tests {
    use super::subsets;

    #[test]
    fn subsets_are_all_and_each_once() {
        for (of, count, number) in [(7, 0, 1), (7, 1, 7), (7, 2, 21), (12, 3, 220), (3, 4, 0)] {
            let sets: Vec<_> = subsets(of, count).collect();
            assert_eq!(sets.len(), number);
            assert!(sets.windows(2).all(|pair| pair[0] < pair[1]));
            assert!(sets.iter().all(|s| s.count_ones() == count && *s < 1 << of));
        }
    }
}
