//! Tabulated orbits and clocks, as analysis centres compute them, and their interpolation.
//!
//! Positions are interpolated by a polynomial of degree 10 through 11 points in the Earth-fixed frame
//! (Remondi 1991: centimetres at 15 minutes' spacing in the middle of the table, decimetres in its first
//! and last intervals), by Neville's recursion, which gives the velocity as the exact derivative. Clocks
//! are interpolated linearly. Tabulated clocks lack the relativistic effect of the orbit's eccentricity,
//! `-2 r.v/c^2` (IS-GPS-200N 20.3.3.3.3.1), and hold for the ionosphere-free pair of P codes: both
//! are corrected for an L1 C/A user here, the latter by the broadcast T_GD.
//!
//! Positions are those of the centre of mass. The antenna lies up to 2.5 m towards the Earth from it (about
//! 1 m in Block IIA), which acts on all ranges nearly equally, as the receiver's clock does; the
//! difference between satellites of different blocks is in [`PreciseArc::range_sigma_m`].

use crate::constants::{MU_EARTH, OMEGA_EARTH, SPEED_OF_LIGHT};
use crate::{GpsTime, SatelliteState};
use nalgebra::Vector3;

/// Points of the interpolation.
const POINTS: usize = 11;
/// Widest gap between neighbouring points, s.
const MAX_STEP_S: f64 = 1800.0;
/// Standard deviation by the unknown antenna offset, m: see the module's head.
const ANTENNA_SIGMA_M: f64 = 0.5;
/// Accuracy that is assumed where the table does not state it, m: predicted halves of ultra-rapid orbits.
const UNSTATED_SIGMA_M: f64 = 0.1;
/// Standard deviation by a group delay that is not known, m: T_GD of GPS lies in -20 to +10 ns.
const UNKNOWN_TGD_SIGMA_M: f64 = 3.0;

/// A satellite at one instant of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrecisePoint {
    /// GPS time.
    pub time: GpsTime,
    /// Centre of mass, m, ECEF.
    pub position_m: Vector3<f64>,
    /// Satellite clock minus GPS time for the ionosphere-free pair of P codes, without the periodic part of
    /// relativity, s, where it is known.
    pub clock_s: Option<f64>,
}

/// The table of one satellite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PreciseOrbit {
    /// In order of time.
    points: Vec<PrecisePoint>,
    /// Standard deviation of the positions, m, where it is stated.
    accuracy_m: Option<f64>,
}

impl PreciseOrbit {
    /// A table of points (in any order) whose standard deviation is `accuracy_m`, m, if it is stated.
    pub fn new(points: Vec<PrecisePoint>, accuracy_m: Option<f64>) -> Self {
        let mut orbit = Self { points, accuracy_m };
        orbit.sort();
        orbit
    }

    /// Adds the points of another table of the same satellite; of two at the same time the first stays.
    pub fn merge(&mut self, other: Self) {
        self.points.extend(other.points);
        self.sort();
        self.accuracy_m = match (self.accuracy_m, other.accuracy_m) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        };
    }

    fn sort(&mut self) {
        // Stable: the first of two at the same time stays first.
        self.points.sort_by(|a, b| (a.time - b.time).total_cmp(&0.0));
        self.points.dedup_by(|a, b| a.time == b.time);
    }

    /// The points of the table, in order of time.
    pub fn points(&self) -> &[PrecisePoint] {
        &self.points
    }

    /// Points of the table, where they are too few to be interpolated, and how many are needed.
    pub fn too_few(&self) -> Option<(usize, usize)> {
        (self.points.len() < POINTS).then_some((self.points.len(), POINTS))
    }

    /// The part of the table around `t`, if `t` lies in it, without gaps and with clocks, for an L1 C/A
    /// user who knows the satellite's `tgd_s`, s, or not.
    pub fn arc(&self, t: GpsTime, tgd_s: Option<f64>) -> Option<PreciseArc<'_>> {
        let last = self.points.len().checked_sub(1)?;
        let after = self.points.partition_point(|p| p.time <= t).min(last);
        let before = after.checked_sub(1)?;
        let first = (before + 1).saturating_sub(POINTS / 2 + 1);
        let first = first.min(self.points.len().checked_sub(POINTS)?);
        let points = &self.points[first..first + POINTS];
        let dense = points.windows(2).all(|p| p[1].time - p[0].time <= MAX_STEP_S);
        let reaches = self.points[before].time <= t && t <= self.points[after].time;
        let (from, to) = (&self.points[before], &self.points[after]);
        let clock_drift_sps = (to.clock_s? - from.clock_s?) / (to.time - from.time);
        (dense && reaches).then_some(PreciseArc {
            points,
            clock: (from.time, from.clock_s?, clock_drift_sps),
            accuracy_m: self.accuracy_m,
            tgd_s,
        })
    }
}

/// The part of a table that serves around one time.
#[derive(Clone, Copy, Debug)]
pub struct PreciseArc<'a> {
    points: &'a [PrecisePoint],
    /// Time, clock (s) there and its rate (s/s).
    clock: (GpsTime, f64, f64),
    accuracy_m: Option<f64>,
    tgd_s: Option<f64>,
}

impl PreciseArc<'_> {
    /// Satellite state at GPS time `t` (the centre of mass), near the time that the arc was taken for.
    pub fn state(&self, t: GpsTime) -> SatelliteState {
        let (position_m, velocity_mps) = self.interpolate(t);
        let inertial_mps = velocity_mps + Vector3::z().cross(&position_m) * OMEGA_EARTH;
        let (since, clock_s, drift_sps) = self.clock;
        // The rate of r.v is v^2 + r.a, and r.a is -mu/r in two-body motion.
        let rate = inertial_mps.norm_squared() - MU_EARTH / position_m.norm();
        let relativity = -2.0 / SPEED_OF_LIGHT.powi(2);
        SatelliteState {
            position_m,
            velocity_mps,
            clock_bias_s: clock_s
                + drift_sps * (t - since)
                + relativity * position_m.dot(&velocity_mps)
                - self.tgd_s.unwrap_or(0.0),
            clock_drift_sps: drift_sps + relativity * rate,
        }
    }

    /// Standard deviation, m, of an L1 C/A range from it: the table's accuracy, the antenna offset that is
    /// left out, and T_GD where it is not known.
    pub fn range_sigma_m(&self) -> f64 {
        let tgd = if self.tgd_s.is_some() { 0.0 } else { UNKNOWN_TGD_SIGMA_M };
        self.accuracy_m.unwrap_or(UNSTATED_SIGMA_M).hypot(ANTENNA_SIGMA_M).hypot(tgd)
    }

    /// Position and velocity by Neville's recursion on values and derivatives.
    fn interpolate(&self, t: GpsTime) -> (Vector3<f64>, Vector3<f64>) {
        let mut x = [0.0; POINTS];
        let mut value = [Vector3::zeros(); POINTS];
        let mut slope = [Vector3::zeros(); POINTS];
        for (k, point) in self.points.iter().enumerate() {
            (x[k], value[k]) = (point.time - t, point.position_m);
        }
        for order in 1..POINTS {
            for k in 0..POINTS - order {
                let (left, right) = (x[k], x[k + order]);
                let width = left - right;
                slope[k] =
                    (value[k] - value[k + 1] - right * slope[k] + left * slope[k + 1]) / width;
                value[k] = (left * value[k + 1] - right * value[k]) / width;
            }
        }
        (value[0], slope[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orbit::broadcast::sample_ephemeris;

    /// A table made of broadcast states, every 15 minutes for three hours either way.
    fn table() -> PreciseOrbit {
        let ephemeris = sample_ephemeris();
        let point = |k: i32| {
            let time = ephemeris.toe + 900.0 * f64::from(k);
            let state = ephemeris.state(time);
            let relativity =
                -2.0 / SPEED_OF_LIGHT.powi(2) * state.position_m.dot(&state.velocity_mps);
            let clock_s = Some(state.clock_bias_s - relativity + ephemeris.tgd);
            PrecisePoint { time, position_m: state.position_m, clock_s }
        };
        PreciseOrbit::new((-12..=12).rev().map(point).collect(), Some(0.01))
    }

    #[test]
    fn a_table_of_broadcast_states_gives_them_back_between_its_points() {
        let (ephemeris, table) = (sample_ephemeris(), table());
        for k in -35i32..=35 {
            let t = ephemeris.toe + 300.0 * f64::from(k);
            let expected = ephemeris.state(t);
            let state = table.arc(t, Some(ephemeris.tgd)).unwrap().state(t);
            // Interpolation error of degree 10 over 15-minute steps of an orbit with harmonics: the node
            // polynomial is 40 times larger in the first interval than in the middle (module's head).
            let limit = if k.abs() < 15 { 0.02 } else { 0.5 };
            let error = (state.position_m - expected.position_m).norm();
            assert!(error < limit, "{k}: {error} m");
            let error = (state.velocity_mps - expected.velocity_mps).norm();
            assert!(error < limit / 100.0, "{k}: {error} m/s");
            // F e sqrt(A) sin E is -2 r.v/c^2 but for harmonics and the rotating frame: 1e-3 of 23 ns.
            assert!((state.clock_bias_s - expected.clock_bias_s).abs() < 1e-10, "{k}");
            assert!((state.clock_drift_sps - expected.clock_drift_sps).abs() < 1e-13, "{k}");
        }
    }

    #[test]
    fn the_table_is_not_used_outside_itself_or_across_gaps() {
        let table = table();
        let toe = sample_ephemeris().toe;
        assert!(table.arc(toe + 3.0 * 3600.0, None).is_some());
        assert!(table.arc(toe + 3.0 * 3600.0 + 1.0, None).is_none());
        assert!(table.arc(toe - 3.0 * 3600.0 - 1.0, None).is_none());
        assert!(PreciseOrbit::default().arc(toe, None).is_none());
        let holes = |skip: fn(f64) -> bool| {
            let points = table.points.iter().filter(|p| !skip(p.time - toe)).copied().collect();
            PreciseOrbit::new(points, None)
        };
        let gap = holes(|t| (100.0..2000.0).contains(&t));
        assert!(gap.arc(toe - 60.0, None).is_none());
        let mut merged = gap.clone();
        merged.merge(table.clone());
        assert!(merged.arc(toe - 60.0, None).is_some());
        let mut clockless = table.clone();
        clockless.points[12].clock_s = None;
        assert!(clockless.arc(toe + 60.0, None).is_none());
        assert!(clockless.arc(toe + 960.0, None).is_some());
    }
}
