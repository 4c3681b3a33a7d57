//! From the pages of all satellites to navigation data.

use super::inav::InavCollector;
use super::lnav::{
    Almanac, DEFAULT_REFERENCE_WEEK, IonosphereUtc, LnavMessage, Subframe, Subframe1, Subframe2,
    Subframe3, assemble, resolve_week,
};
use super::{Content, Update, inav, sbas};
use crate::atmosphere::Klobuchar;
use crate::{GpsTime, NavigationData, Sv};
use std::collections::BTreeMap;

/// Latest parts of one satellite's ephemeris.
#[derive(Clone, Debug, Default)]
struct Parts {
    clock: Option<(Subframe1, f64)>,
    orbit: Option<Subframe2>,
    orientation: Option<Subframe3>,
}

/// Gathers navigation data from pages.
///
/// An ephemeris is taken when the low eight bits of IODC and both IODEs agree (IS-GPS-200N 20.3.4.4);
/// after a cutover the parts of the old issue wait until all three of the new are there, and are never
/// mixed with them.
#[derive(Clone, Debug)]
pub struct NavigationCollector {
    reference_week: i32,
    /// When the newest subframe 1 was sent.
    newest: Option<GpsTime>,
    page_18: Option<IonosphereUtc>,
    parts: BTreeMap<Sv, Parts>,
    data: NavigationData,
    almanacs: BTreeMap<Sv, Almanac>,
    health: BTreeMap<Sv, u8>,
    /// By satellite and message type.
    sbas: BTreeMap<Sv, BTreeMap<u8, sbas::SbasMessage>>,
    galileo: InavCollector,
}

impl Default for NavigationCollector {
    fn default() -> Self {
        Self::new(DEFAULT_REFERENCE_WEEK)
    }
}

impl NavigationCollector {
    /// An empty collector that resolves weeks modulo 1024 to those nearest `reference_week`.
    pub fn new(reference_week: i32) -> Self {
        Self {
            reference_week,
            newest: None,
            page_18: None,
            parts: BTreeMap::new(),
            data: NavigationData::default(),
            almanacs: BTreeMap::new(),
            health: BTreeMap::new(),
            sbas: BTreeMap::new(),
            galileo: InavCollector::new(reference_week),
        }
    }

    /// Takes a page of a satellite, and gives what is new.
    pub fn add(&mut self, sv: Sv, content: &Content) -> Option<Update> {
        match content {
            Content::Lnav(subframe) => self.add_subframe(sv, subframe),
            Content::Sbas(message) => {
                self.sbas
                    .entry(sv)
                    .or_default()
                    .insert(message.kind, sbas::SbasMessage::clone(message));
                Some(Update::Sbas(sv, message.kind))
            }
            Content::Inav(page) => self.galileo.add(sv, page.word.as_ref()?, &mut self.data),
        }
    }

    fn add_subframe(&mut self, sv: Sv, subframe: &Subframe) -> Option<Update> {
        match subframe.header.alert {
            true => self.data.alerts.insert(sv),
            false => self.data.alerts.remove(&sv),
        };
        let parts = self.parts.entry(sv).or_default();
        match subframe.message() {
            LnavMessage::Clock(clock) => {
                let week = resolve_week(clock.week.into(), 10, self.reference_week);
                self.newest = Some(GpsTime::from_week_tow(week, subframe.tow()));
                self.health.insert(sv, clock.health);
                parts.clock = Some((clock, subframe.tow()));
            }
            LnavMessage::Orbit(orbit) => parts.orbit = Some(orbit),
            LnavMessage::Orientation(orientation) => parts.orientation = Some(orientation),
            LnavMessage::Almanac(almanac) => return self.add_almanac(almanac),
            LnavMessage::IonosphereUtc(page) => {
                let Klobuchar { alpha, beta } = page.klobuchar;
                self.data.ionosphere = Klobuchar::sent(alpha, beta);
                self.page_18 = Some(page);
                self.resolve_utc();
                return Some(Update::IonosphereUtc);
            }
            LnavMessage::Health1To24(page) => return self.add_health(1, &page.health),
            LnavMessage::Health25To32(page) => return self.add_health(25, &page.health),
            LnavMessage::Other(_) => return None,
        }
        self.resolve_utc();
        self.complete(sv)
    }

    /// Navigation data so far.
    pub fn data(&self) -> &NavigationData {
        &self.data
    }

    /// Latest almanac of each satellite.
    pub fn almanacs(&self) -> &BTreeMap<Sv, Almanac> {
        &self.almanacs
    }

    /// Latest almanac of each satellite of Galileo.
    pub fn galileo_almanacs(&self) -> &BTreeMap<Sv, inav::GalileoAlmanac> {
        self.galileo.almanacs()
    }

    /// Latest six-bit health word of each satellite, from its own subframe 1 or anyone's almanac; 0 is
    /// healthy.
    pub fn health(&self) -> &BTreeMap<Sv, u8> {
        &self.health
    }

    /// The newest message of each type that an SBAS satellite sent, by type: corrections as they were sent;
    /// they are not applied.
    pub fn sbas(&self, sv: Sv) -> impl Iterator<Item = &sbas::SbasMessage> {
        self.sbas.get(&sv).into_iter().flat_map(BTreeMap::values)
    }

    /// SBAS satellites whose messages were received.
    pub fn sbas_satellites(&self) -> impl Iterator<Item = Sv> {
        self.sbas.keys().copied()
    }

    /// Weeks modulo 256 of the UTC parameters are ambiguous before a subframe 1 has given the week.
    fn resolve_utc(&mut self) {
        if let (Some(page), Some(newest)) = (&self.page_18, self.newest) {
            self.data.utc = Some(page.utc(newest.week()));
        }
    }

    fn complete(&mut self, sv: Sv) -> Option<Update> {
        let parts = &self.parts[&sv];
        let (Some((clock, tow)), Some(orbit), Some(orientation)) =
            (&parts.clock, &parts.orbit, &parts.orientation)
        else {
            return None;
        };
        let ephemeris = assemble(sv, (clock, orbit, orientation), *tow, self.reference_week)?;
        let known = self.data.iter().any(|e| {
            (e.sv, e.toe, e.toc, e.iodc) == (sv, ephemeris.toe, ephemeris.toc, ephemeris.iodc)
        });
        self.data.insert(ephemeris);
        (!known).then_some(Update::Ephemeris(sv))
    }

    fn add_almanac(&mut self, almanac: Almanac) -> Option<Update> {
        let sv = Sv::from_prn(almanac.sv_id)?;
        self.almanacs.insert(sv, almanac);
        Some(Update::Almanac(sv))
    }

    fn add_health(&mut self, first_prn: u8, words: &[u8]) -> Option<Update> {
        for (prn, &health) in (first_prn..).zip(words) {
            if let Some(sv) = Sv::from_prn(prn) {
                self.health.insert(sv, health);
            }
        }
        Some(Update::Health)
    }
}

#[cfg(test)]
mod tests {
    use super::super::lnav::{Header, Health1To24, decode_words, encode_subframe};
    use super::*;
    use crate::Ephemeris;
    use crate::navigation_data::UtcParameters;
    use crate::orbit::broadcast::sample_ephemeris;

    fn received(id: u8, tow: f64, message: &LnavMessage) -> Content {
        let header = Header::new(id, tow);
        let words = decode_words(&encode_subframe(&header, message).unwrap(), 0).unwrap();
        Content::Lnav(Subframe { start_index: 0, inverted: false, header, words })
    }

    fn frame(eph: &Ephemeris, tow: f64) -> [Content; 3] {
        [
            received(1, tow, &LnavMessage::Clock(Subframe1::new(eph, 2190))),
            received(2, tow + 6.0, &LnavMessage::Orbit(eph.into())),
            received(3, tow + 12.0, &LnavMessage::Orientation(eph.into())),
        ]
    }

    #[test]
    fn parts_of_two_issues_are_never_mixed_at_a_cutover() {
        let old = sample_ephemeris();
        let new = Ephemeris { iode: 40, iodc: 40, toe: old.toe + 7200.0, ..old.clone() };
        let mut collector = NavigationCollector::default();
        let sv = old.sv;
        let [_, o2, o3] = frame(&old, 511_200.0);
        assert_eq!(collector.add(sv, &o2), None);
        assert_eq!(collector.add(sv, &o3), None);
        // Every order of the new parts around the old ones: only the last completes the new issue.
        let [n1, n2, n3] = frame(&new, 511_230.0);
        assert_eq!(collector.add(sv, &n1), None, "new clock with old orbit");
        assert_eq!(collector.add(sv, &n2), None, "old orientation with new orbit");
        assert_eq!(collector.add(sv, &n3), Some(Update::Ephemeris(sv)));
        assert_eq!(collector.add(sv, &n3), None, "nothing new");
        let eph = collector.data().iter().next().unwrap();
        assert_eq!((eph.iode, eph.toe), (40, new.toe));
        assert_eq!(eph.transmission_time, Some(GpsTime::from_week_tow(2190, 511_230.0)));
        // Another satellite's parts are its own.
        let other = Sv::from_prn(2).unwrap();
        assert_eq!(collector.add(other, &o2), None);
        assert_eq!(collector.data().iter().count(), 1);
    }

    #[test]
    fn utc_waits_for_the_week_and_health_and_almanac_are_kept() {
        let eph = sample_ephemeris();
        let utc = UtcParameters {
            a0: 0.0,
            a1: 0.0,
            tot: GpsTime::from_week_tow(2191, 147_456.0),
            delta_t_ls: 18,
            delta_t_lsf: 18,
            wn_lsf: 2185,
            day: 7,
        };
        let klobuchar = Klobuchar {
            alpha: [2f64.powi(-27), 0.0, 0.0, 0.0],
            beta: [2048.0; 4].map(|b| b * 32.0),
        };
        let mut collector = NavigationCollector::default();
        let page = LnavMessage::IonosphereUtc(IonosphereUtc::new(klobuchar, &utc));
        assert_eq!(
            collector.add(eph.sv, &received(4, 511_218.0, &page)),
            Some(Update::IonosphereUtc)
        );
        assert_eq!((collector.data().ionosphere, collector.data().utc), (Some(klobuchar), None));
        let [s1, ..] = frame(&eph, 511_230.0);
        collector.add(eph.sv, &s1);
        assert_eq!(collector.data().utc, Some(utc));
        let mut health = [0; 24];
        health[10] = 63;
        let page = LnavMessage::Health1To24(Health1To24 { toa: 0.0, week_a: 0, health });
        assert_eq!(collector.add(eph.sv, &received(5, 511_254.0, &page)), Some(Update::Health));
        assert_eq!(collector.health()[&Sv::from_prn(11).unwrap()], 63);
        let page = LnavMessage::Almanac(Almanac::new(&eph, GpsTime::from_week_tow(2191, 4096.0)));
        let update = collector.add(Sv::from_prn(2).unwrap(), &received(5, 511_284.0, &page));
        assert_eq!(update, Some(Update::Almanac(eph.sv)));
        assert_eq!(collector.almanacs()[&eph.sv].toa, 4096.0);
    }
}
