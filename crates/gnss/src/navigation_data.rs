//! Navigation data: ephemerides, ionosphere and UTC.

use crate::atmosphere::Klobuchar;
use crate::galileo_data::GalileoData;
use crate::orbit::NoOrbit;
use crate::orbit::glonass::HALF_INTERVAL_S;
use crate::orbit::precise::PreciseOrbit;
use crate::{Constellation, Ephemeris, GlonassEphemeris, GpsTime, Orbit, Sv};
use std::collections::{BTreeMap, BTreeSet};

pub use crate::utc::UtcParameters;

/// Navigation data for positions, from files or from the signals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NavigationData {
    /// Ephemerides of each satellite, in the order of `t_oe`.
    ephemerides: BTreeMap<Sv, Vec<Ephemeris>>,
    /// Ephemerides of each satellite of GLONASS, in the order of `t_b`.
    glonass: BTreeMap<Sv, Vec<GlonassEphemeris>>,
    /// Frequency channels of satellites of GLONASS, as observation files state them.
    pub glonass_channels: BTreeMap<Sv, i8>,
    /// Precise orbits of each satellite, as of SP3 files.
    precise: BTreeMap<Sv, PreciseOrbit>,
    /// Ionosphere model, if known.
    pub ionosphere: Option<Klobuchar>,
    /// UTC parameters, if known.
    pub utc: Option<UtcParameters>,
    /// Satellites whose newest hand-over word raises the alert flag.
    pub alerts: BTreeSet<Sv>,
    /// What Galileo sends beside its ephemerides.
    pub galileo: GalileoData,
}

/// Ephemerides whose `t_oe` are nearer to each other than this, s, are of one time: an upload moves it by 16 s and
/// more (IS-GPS-200N 20.3.4.5), and the newest of them counts.
const SAME_TOE_S: f64 = 900.0;

impl NavigationData {
    /// Adds an ephemeris; one with the same issue, time and health as a known one changes nothing.
    pub fn insert(&mut self, ephemeris: Ephemeris) {
        let list = self.ephemerides.entry(ephemeris.sv).or_default();
        if list.iter().any(|e| {
            (e.toe, e.iode, e.iodc, e.health)
                == (ephemeris.toe, ephemeris.iode, ephemeris.iodc, ephemeris.health)
        }) {
            return;
        }
        let at = list.partition_point(|e| e.toe <= ephemeris.toe);
        list.insert(at, ephemeris);
    }

    /// Takes an ephemeris out again.
    pub fn remove(&mut self, ephemeris: &Ephemeris) {
        if let Some(list) = self.ephemerides.get_mut(&ephemeris.sv) {
            list.retain(|e| e != ephemeris);
            if list.is_empty() {
                self.ephemerides.remove(&ephemeris.sv);
            }
        }
    }

    /// Adds an ephemeris of GLONASS; one of the same time and health as a known one changes nothing.
    pub fn insert_glonass(&mut self, ephemeris: GlonassEphemeris) {
        let list = self.glonass.entry(ephemeris.sv).or_default();
        if list.iter().all(|e| (e.tb, e.health) != (ephemeris.tb, ephemeris.health)) {
            let at = list.partition_point(|e| e.tb <= ephemeris.tb);
            list.insert(at, ephemeris);
        }
    }

    /// Adds all of `other`; its ionosphere and UTC parameters replace ours where it has them.
    pub fn merge(&mut self, other: Self) {
        self.ionosphere = other.ionosphere.or(self.ionosphere);
        self.utc = other.utc.or(self.utc);
        self.alerts.extend(other.alerts);
        self.galileo.merge(other.galileo);
        other.ephemerides.into_values().flatten().for_each(|e| self.insert(e));
        other.glonass.into_values().flatten().for_each(|e| self.insert_glonass(e));
        self.glonass_channels.extend(other.glonass_channels);
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
        if sv.constellation() == Constellation::Glonass {
            return self.glonass_orbit(sv, t);
        }
        let (nearest, in_force) = (self.nearest(sv, t), self.ephemeris(sv, t));
        // An upload moves t_oe by some seconds, and may change the health alone.
        let same_time =
            |e: &Ephemeris| in_force.is_some_and(|f| (e.toe - f.toe).abs() < SAME_TOE_S);
        match self.newest(sv, t, same_time) {
            Some(e) if !e.is_healthy() => return Err(NoOrbit::Unhealthy(e.health)),
            Some(e) if e.ura_index >= 15 => return Err(NoOrbit::NoAccuracy),
            _ if self.alerts.contains(&sv) => return Err(NoOrbit::Alert),
            _ => (),
        }
        let precise = self.precise.get(&sv).and_then(|p| p.arc(t, nearest.map(|e| e.tgd)));
        match (precise, in_force, nearest) {
            (Some(arc), ..) => Ok(arc.into()),
            (None, Some(ephemeris), _) => Ok(ephemeris.into()),
            (None, None, Some(old)) => Err(NoOrbit::Stale((t - old.toe).abs() / 3600.0)),
            (None, None, None) => match self.precise.get(&sv).and_then(PreciseOrbit::too_few) {
                Some((points, needed)) => Err(NoOrbit::TooFewPoints { points, needed }),
                None => Err(NoOrbit::Unknown),
            },
        }
    }

    fn glonass_orbit(&self, sv: Sv, t: GpsTime) -> Result<Orbit<'_>, NoOrbit> {
        // Of two of one time the later: its health is the newer one.
        let all = self.glonass.get(&sv).into_iter().flatten().rev();
        let distance = |e: &&GlonassEphemeris| (t - e.tb).abs();
        let nearest = all.min_by(|a, b| distance(a).total_cmp(&distance(b)));
        match nearest {
            None => Err(NoOrbit::Unknown),
            Some(e) if distance(&e) > HALF_INTERVAL_S + 60.0 => {
                Err(NoOrbit::Stale(distance(&e) / 3600.0))
            }
            Some(e) if !e.is_healthy() => Err(NoOrbit::Unhealthy(e.health)),
            Some(e) => Ok(e.into()),
        }
    }

    /// The frequency channel of a satellite of GLONASS: as an observation file states it, else as its ephemerides do;
    /// none where neither does.
    pub fn frequency_channel(&self, sv: Sv) -> Option<i8> {
        let sent = || self.glonass.get(&sv)?.iter().rev().find_map(|e| e.channel);
        self.glonass_channels.get(&sv).copied().or_else(sent)
    }

    /// The ephemeris of `sv` whose `t_oe` is nearest to `t`, if `t` is inside its curve-fit interval.
    pub fn ephemeris(&self, sv: Sv, t: GpsTime) -> Option<&Ephemeris> {
        self.nearest(sv, t).filter(|e| (t - e.toe).abs() <= e.half_fit_interval() + 60.0)
    }

    /// The ephemeris of `sv` whose `t_oe` is nearest to `t`, however old; of several of one `t_oe` the newest that had
    /// been sent by `t`.
    pub fn nearest(&self, sv: Sv, t: GpsTime) -> Option<&Ephemeris> {
        let distance = |e: &&Ephemeris| (t - e.toe).abs();
        let nearest =
            self.ephemerides.get(&sv)?.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        self.newest(sv, t, |e| e.toe == nearest.toe)
    }

    /// Of some ephemerides the last sent by `t`, else the first sent after it.
    fn newest(&self, sv: Sv, t: GpsTime, of: impl Fn(&Ephemeris) -> bool) -> Option<&Ephemeris> {
        // How long before `t` it was sent; those of after `t` come last, and those of no known time before them.
        let age = |e: &Ephemeris| match e.transmission_time.map(|sent| t - sent) {
            Some(age) if age >= 0.0 => age,
            Some(age) => 1e9 - age,
            None => 1e8,
        };
        // Of equal ages the later in the list.
        let some = self.ephemerides.get(&sv)?.iter().rev().filter(|e| of(e));
        some.min_by(|a, b| age(a).total_cmp(&age(b)))
    }

    /// All broadcast ephemerides but those of GLONASS, by satellite and then `t_oe`.
    pub fn iter(&self) -> impl Iterator<Item = &Ephemeris> {
        self.ephemerides.values().flatten()
    }

    /// All ephemerides of GLONASS, by satellite and then `t_b`.
    pub fn glonass(&self) -> impl Iterator<Item = &GlonassEphemeris> {
        self.glonass.values().flatten()
    }

    /// Satellites with at least one broadcast ephemeris.
    pub fn satellites(&self) -> impl Iterator<Item = Sv> {
        self.ephemerides.keys().chain(self.glonass.keys()).copied()
    }

    /// Whether no broadcast ephemeris is known.
    pub fn is_empty(&self) -> bool {
        self.ephemerides.is_empty() && self.glonass.is_empty()
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
