//! Navigation data: ephemerides, ionosphere and UTC.

use crate::atmosphere::Klobuchar;
use crate::orbit::NoOrbit;
use crate::orbit::precise::PreciseOrbit;
use crate::{Ephemeris, GpsTime, Orbit, Sv};
use std::collections::BTreeMap;

/// Parameters that relate GPS time to UTC (IS-GPS-200N 20.3.3.5.1.6).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UtcParameters {
    /// Constant term, s.
    pub a0: f64,
    /// First-order term, s/s.
    pub a1: f64,
    /// Reference time.
    pub tot: GpsTime,
    /// Leap seconds now, s.
    pub delta_t_ls: i32,
    /// Leap seconds after the next (or last) change, s.
    pub delta_t_lsf: i32,
    /// Full week number of that change.
    pub wn_lsf: i32,
    /// Day of that week, 1 (Sunday) to 7.
    pub day: u8,
}

/// Navigation data for positions, from files or from the signals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NavigationData {
    /// Ephemerides of each satellite, in the order of `t_oe`.
    ephemerides: BTreeMap<Sv, Vec<Ephemeris>>,
    /// Precise orbits of each satellite, as of SP3 files.
    precise: BTreeMap<Sv, PreciseOrbit>,
    /// Ionosphere model, if known.
    pub ionosphere: Option<Klobuchar>,
    /// UTC parameters, if known.
    pub utc: Option<UtcParameters>,
}

impl NavigationData {
    /// Adds an ephemeris; one with the same issue and time as a known one changes nothing.
    pub fn insert(&mut self, ephemeris: Ephemeris) {
        let list = self.ephemerides.entry(ephemeris.sv).or_default();
        if list
            .iter()
            .any(|e| e.toe == ephemeris.toe && e.iode == ephemeris.iode && e.iodc == ephemeris.iodc)
        {
            return;
        }
        let at = list.partition_point(|e| e.toe <= ephemeris.toe);
        list.insert(at, ephemeris);
    }

    /// Adds all of `other`; its ionosphere and UTC parameters replace ours where it has them.
    pub fn merge(&mut self, other: Self) {
        self.ionosphere = other.ionosphere.or(self.ionosphere);
        self.utc = other.utc.or(self.utc);
        other.ephemerides.into_values().flatten().for_each(|e| self.insert(e));
        other.precise.into_iter().for_each(|(sv, orbit)| self.insert_precise(sv, orbit));
    }

    /// Adds a precise orbit; where one of the satellite is known, its points join that.
    pub fn insert_precise(&mut self, sv: Sv, orbit: PreciseOrbit) {
        self.precise.entry(sv).or_default().merge(orbit);
    }

    /// The orbit of `sv` to be used at `t`: the precise one where it is valid, else the broadcast
    /// one. A satellite that is unhealthy by its valid ephemeris has none.
    ///
    /// # Errors
    /// [`NoOrbit`]: why there is none.
    pub fn orbit(&self, sv: Sv, t: GpsTime) -> Result<Orbit<'_>, NoOrbit> {
        let (nearest, in_force) = (self.nearest(sv, t), self.ephemeris(sv, t));
        if let Some(e) = in_force.filter(|e| !e.is_healthy()) {
            return Err(NoOrbit::Unhealthy(e.health));
        }
        let precise = self.precise.get(&sv).and_then(|p| p.arc(t, nearest.map(|e| e.tgd)));
        match (precise, in_force, nearest) {
            (Some(arc), ..) => Ok(arc.into()),
            (None, Some(ephemeris), _) => Ok(ephemeris.into()),
            (None, None, Some(old)) => Err(NoOrbit::Stale((t - old.toe).abs() / 3600.0)),
            (None, None, None) => Err(NoOrbit::Unknown),
        }
    }

    /// The ephemeris of `sv` whose `t_oe` is nearest to `t`, if `t` is inside its curve-fit interval.
    pub fn ephemeris(&self, sv: Sv, t: GpsTime) -> Option<&Ephemeris> {
        self.nearest(sv, t).filter(|e| (t - e.toe).abs() <= e.half_fit_interval() + 60.0)
    }

    /// The ephemeris of `sv` whose `t_oe` is nearest to `t`, however old.
    pub fn nearest(&self, sv: Sv, t: GpsTime) -> Option<&Ephemeris> {
        let distance = |e: &&Ephemeris| (t - e.toe).abs();
        self.ephemerides.get(&sv)?.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// All broadcast ephemerides, by satellite and then `t_oe`.
    pub fn iter(&self) -> impl Iterator<Item = &Ephemeris> {
        self.ephemerides.values().flatten()
    }

    /// Satellites with at least one broadcast ephemeris.
    pub fn satellites(&self) -> impl Iterator<Item = Sv> {
        self.ephemerides.keys().copied()
    }

    /// Whether no broadcast ephemeris is known.
    pub fn is_empty(&self) -> bool {
        self.ephemerides.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use crate::orbit::broadcast::sample_ephemeris;
    use crate::*;

    #[test]
    fn the_nearest_ephemeris_is_given_and_a_stale_one_refused() {
        let first = sample_ephemeris();
        let second = Ephemeris { toe: first.toe + 7200.0, iode: 40, iodc: 40, ..first.clone() };
        let mut data = NavigationData::default();
        data.insert(second.clone());
        data.insert(first.clone());
        data.insert(first.clone());
        assert_eq!(data.iter().count(), 2);
        assert_eq!(data.ephemeris(first.sv, first.toe + 3500.0).unwrap().iode, 39);
        assert_eq!(data.ephemeris(first.sv, first.toe + 3700.0).unwrap().iode, 40);
        assert!(data.ephemeris(first.sv, first.toe + 86_400.0).is_none());
        assert_eq!(data.nearest(first.sv, first.toe + 86_400.0), Some(&second));
    }

    #[test]
    fn the_lowest_bit_of_health_makes_no_satellite_of_qzss_unhealthy() {
        for (name, health, is_good) in
            [("G01", 0, true), ("G01", 1, false), ("J02", 1, true), ("J02", 0b10_0000, false)]
        {
            let sv = name.parse().unwrap();
            let mut data = NavigationData::default();
            data.insert(Ephemeris { sv, health, ..sample_ephemeris() });
            assert_eq!(data.orbit(sv, sample_ephemeris().toe).is_ok(), is_good, "{name} {health}");
        }
    }
}
