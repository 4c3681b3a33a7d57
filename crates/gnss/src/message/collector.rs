//! From the pages of all satellites to navigation data.

use super::inav::InavCollector;
use super::lnav::{
    Almanac, DEFAULT_REFERENCE_WEEK, IonosphereUtc, LnavMessage, LooseWords, Subframe, Subframe1,
    Subframe2, Subframe3, WordsState, assemble, resolve_week,
};
use super::{Content, Update, inav, sbas};
use crate::atmosphere::Klobuchar;
use crate::time::SECONDS_PER_WEEK;
use crate::{Ephemeris, GpsTime, NavigationData, Sv};
use std::collections::BTreeMap;

/// Latest parts of one satellite's ephemeris, of whole subframes.
#[derive(Clone, Debug, Default)]
struct Parts {
    clock: Option<(Subframe1, f64)>,
    orbit: Option<Subframe2>,
    orientation: Option<Subframe3>,
}

/// Words of subframes 1 to 3 of one satellite that are not whole, or not yet.
#[derive(Clone, Debug, Default)]
struct Loose {
    /// Of the one before the first whole one.
    torn: Option<LooseWords>,
    under_way: Option<LooseWords>,
    /// The ephemeris made with words of the one under way, and the parts without them.
    made: Option<(Ephemeris, Parts)>,
}

/// Time, s, between two subframes of one number.
const FRAME_S: f64 = 30.0;

impl Loose {
    /// Takes words; gives the subframe that they make up together with those of the frame before.
    fn join(&mut self, new: &LooseWords) -> Option<LnavMessage> {
        // Pages of subframes 4 and 5 are others in the next frame.
        if !(1..=3).contains(&new.id) || new.state == WordsState::Refused {
            return None;
        }
        if new.state == WordsState::Torn {
            return self.torn.insert(new.clone()).message();
        }
        let current = self.under_way.get_or_insert_with(|| new.clone());
        if !new.is_of(current) {
            *current = new.clone();
        }
        let week_s = SECONDS_PER_WEEK as f64;
        let is_of_frame_before =
            |torn: &&LooseWords| torn.id == new.id && (torn.tow + FRAME_S) % week_s == new.tow;
        current.words.iter_mut().zip(new.words).for_each(|(known, new)| *known = known.or(new));
        let mut all = current.clone();
        let torn = self.torn.as_ref().filter(is_of_frame_before)?;
        all.words.iter_mut().zip(torn.words).for_each(|(known, torn)| *known = known.or(torn));
        all.message()
    }
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
    loose: BTreeMap<Sv, Loose>,
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
            loose: BTreeMap::new(),
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
            Content::LnavWords(words) => self.add_words(sv, words),
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
        // What was made of its words is made anew of all of it.
        let made = self.take_back(sv);
        let update = self.add_message(sv, subframe.tow(), subframe.message());
        let Some(made) = made else { return update };
        let transmission_time = made.transmission_time;
        let same = |e: &Ephemeris| Ephemeris { transmission_time, ..e.clone() } == made;
        match update {
            Some(Update::Ephemeris(_)) if self.data.iter().any(same) => None,
            Some(Update::Ephemeris(_)) => update,
            _ => Some(Update::Withdrawn(sv)),
        }
    }

    fn add_words(&mut self, sv: Sv, words: &LooseWords) -> Option<Update> {
        let loose = self.loose.entry(sv).or_default();
        // The subframe whose words made an ephemeris has not become whole.
        let is_over = words.state == WordsState::Refused
            || loose.under_way.as_ref().is_some_and(|before| !words.is_of(before));
        let message = loose.join(words);
        let withdrawn = is_over.then(|| self.take_back(sv)).flatten();
        let withdrawn = withdrawn.map(|_| Update::Withdrawn(sv));
        let Some(message) = message.filter(|_| self.loose[&sv].made.is_none()) else {
            return withdrawn;
        };
        let before = self.parts.get(&sv).cloned().unwrap_or_default();
        let update = self.add_message(sv, words.tow, message);
        match (update, self.assembled(sv)) {
            (Some(update), Some(made)) => {
                self.loose.entry(sv).or_default().made = Some((made, before));
                Some(update)
            }
            _ => {
                self.parts.insert(sv, before);
                withdrawn
            }
        }
    }

    /// Takes back the ephemeris that was made of words of a subframe under way, if there is one.
    fn take_back(&mut self, sv: Sv) -> Option<Ephemeris> {
        let (made, before) = self.loose.get_mut(&sv)?.made.take()?;
        self.data.remove(&made);
        self.parts.insert(sv, before);
        Some(made)
    }

    fn add_message(&mut self, sv: Sv, tow: f64, message: LnavMessage) -> Option<Update> {
        let parts = self.parts.entry(sv).or_default();
        match message {
            LnavMessage::Clock(clock) => {
                let week = resolve_week(clock.week.into(), 10, self.reference_week);
                self.newest = Some(GpsTime::from_week_tow(week, tow));
                self.health.insert(sv, clock.health);
                parts.clock = Some((clock, tow));
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

    /// The ephemeris of the latest parts, if they are all there and of one issue.
    fn assembled(&self, sv: Sv) -> Option<Ephemeris> {
        let Parts { clock, orbit, orientation } = self.parts.get(&sv)?;
        let (clock, tow) = clock.as_ref()?;
        let parts = (clock, orbit.as_ref()?, orientation.as_ref()?);
        assemble(sv, parts, *tow, self.reference_week)
    }

    fn complete(&mut self, sv: Sv) -> Option<Update> {
        let ephemeris = self.assembled(sv)?;
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
    use super::super::MessageDecoder;
    use super::super::lnav::{FrameDecoder, Header, Health1To24, decode_words, encode_subframe};
    use super::*;
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

    /// Soft bits of frames sent from this time of week on: an ephemeris and empty pages.
    fn bits(eph: &Ephemeris, tow: f64, frames: usize) -> Vec<f32> {
        let mut bits = Vec::new();
        for k in 0..5 * frames {
            let (id, tow) = ((k % 5 + 1) as u8, tow + 6.0 * k as f64);
            let message = match id {
                1 => LnavMessage::Clock(Subframe1::new(eph, 2190)),
                2 => LnavMessage::Orbit(eph.into()),
                3 => LnavMessage::Orientation(eph.into()),
                other => LnavMessage::Other(other),
            };
            for word in encode_subframe(&Header::new(id, tow), &message).unwrap() {
                bits.extend((0..30).rev().map(|b| if word >> b & 1 == 1 { -1.0f32 } else { 1.0 }));
            }
        }
        bits
    }

    /// Bits from the start until the ephemeris is there, and the ephemeris.
    fn collect(sv: Sv, bits: &[f32]) -> Option<(usize, Ephemeris)> {
        let (mut decoder, mut collector) = (FrameDecoder::new(), NavigationCollector::default());
        let decoder: &mut dyn MessageDecoder = &mut decoder;
        bits.iter().enumerate().find_map(|(k, &bit)| {
            let page = decoder.push(bit, k as u64)?;
            let update = collector.add(sv, &page.content)?;
            let of_sv = collector.data().iter().next().cloned();
            (update == Update::Ephemeris(sv)).then_some((k + 1, of_sv?))
        })
    }

    /// A word can be read if it is whole and the last two bits before it are there, and is believed if two such are
    /// before it in its subframe; all others have to come again.
    #[test]
    fn a_start_within_the_ephemeris_needs_no_more_than_one_frame() {
        let eph = sample_ephemeris();
        let all = bits(&eph, 511_200.0, 3);
        let (_, whole) = collect(eph.sv, &all).unwrap();
        for start in (0..1500).step_by(7) {
            let (needed, found) = collect(eph.sv, &all[start..]).unwrap();
            let (subframe, bit) = (start / 300, start % 300);
            // Words of this subframe that have to come again.
            let missing = ((bit + 2usize).div_ceil(30).max(2) + 2).min(10);
            let last = match subframe {
                0..3 if bit > 0 => 50 + 10 * subframe + missing,
                0 => 30,
                1..3 => 50 + 10 * subframe,
                _ => 80,
            };
            assert_eq!(start + needed, 30 * last, "start at bit {start}");
            let Ephemeris { transmission_time, .. } = whole;
            assert_eq!(Ephemeris { transmission_time, ..found }, whole);
        }
    }

    /// Of spoiled words one in 64 keeps parity: a start in noise gives no wrong ephemeris.
    #[test]
    fn words_before_the_first_subframe_that_noise_spoiled_are_not_used() {
        let mut random = crate::random::SplitMix64::new(3);
        let eph = sample_ephemeris();
        let (all, mut earlier) = (bits(&eph, 511_200.0, 3), 0);
        let (_, whole) = collect(eph.sv, &all).unwrap();
        for k in 0..2000 {
            let start = 300 + 7 * k % 600;
            let mut received = all[start..].to_vec();
            let spoiled = 40 + k % 200;
            received[..spoiled]
                .iter_mut()
                .for_each(|b| *b = if random.next_u64() & 1 == 0 { 1.0 } else { -1.0 });
            let (needed, found) = collect(eph.sv, &received).unwrap();
            let Ephemeris { transmission_time, .. } = whole;
            assert_eq!(Ephemeris { transmission_time, ..found }, whole, "{k}");
            earlier += usize::from((start + needed) % 300 != 0);
        }
        assert!(earlier > 500, "{earlier}");
    }

    /// A half-cycle slip in the last words of the subframe that completes the ephemeris: one in 64 of the words that it
    /// falls into keeps parity, with other contents. At the end of the subframe they are taken back.
    #[test]
    fn an_ephemeris_of_words_whose_subframe_is_refused_is_withdrawn() {
        let eph = sample_ephemeris();
        let all = bits(&eph, 511_200.0, 3);
        let (_, whole) = collect(eph.sv, &all).unwrap();
        // A start in subframe 2, whose words come again in the second frame: bits 1800 to 2099.
        let start = 400;
        let (needed, _) = collect(eph.sv, &all[start..]).unwrap();
        assert!(start + needed < 2100);
        let mut wrong = 0;
        for slip in 1800..2100 {
            let mut received = all[start..].to_vec();
            received[slip - start..].iter_mut().for_each(|b| *b = -*b);
            let (mut decoder, mut collector) =
                (FrameDecoder::new(), NavigationCollector::default());
            let decoder: &mut dyn MessageDecoder = &mut decoder;
            let mut updates = Vec::new();
            for (k, &bit) in received[..2101 - start].iter().enumerate() {
                let page = decoder.push(bit, k as u64);
                updates.extend(page.and_then(|page| collector.add(eph.sv, &page.content)));
            }
            updates.retain(|u| matches!(u, Update::Ephemeris(_) | Update::Withdrawn(_)));
            // The subframe with the slip has ended.
            let expected: &[Update] = match updates.len() {
                0 => &[],
                _ => &[Update::Ephemeris(eph.sv), Update::Withdrawn(eph.sv)],
            };
            assert_eq!(updates, if slip == 1800 { &expected[..1] } else { expected }, "{slip}");
            let there = collector.data().iter().count();
            assert_eq!(there, usize::from(slip == 1800), "{slip}");
            wrong += usize::from(slip > 1800 && !updates.is_empty());
            // The next frame gives it again.
            for (k, &bit) in received.iter().enumerate().skip(2101 - start) {
                let page = decoder.push(bit, k as u64);
                page.and_then(|page| collector.add(eph.sv, &page.content));
            }
            let found = collector.data().iter().next().cloned().unwrap();
            let Ephemeris { transmission_time, .. } = whole;
            assert_eq!(Ephemeris { transmission_time, ..found }, whole, "{slip}");
        }
        assert!(wrong > 0, "no slip comes after the last word that is needed");
    }

    /// Subframes 4 and 5 hold another page in each frame: words of two of them make none.
    #[test]
    fn words_of_different_pages_are_not_joined() {
        let almanac = |prn: u8| {
            let eph = Ephemeris { sv: Sv::from_prn(prn).unwrap(), ..sample_ephemeris() };
            LnavMessage::Almanac(Almanac::new(&eph, GpsTime::from_week_tow(2191, 4096.0)))
        };
        let words = |message: &LnavMessage, tow: f64| {
            decode_words(&encode_subframe(&Header::new(5, tow), message).unwrap(), 0).unwrap()
        };
        let (old, new) = (words(&almanac(3), 511_224.0), words(&almanac(4), 511_254.0));
        let mut collector = NavigationCollector::default();
        let sv = Sv::from_prn(9).unwrap();
        let loose = |tow: f64, state, source: &[u32; 10], known: std::ops::Range<usize>| {
            let word = |k: usize| known.contains(&k).then_some(source[k]);
            Content::LnavWords(LooseWords {
                id: 5,
                tow,
                state,
                words: std::array::from_fn(|k| word(k + 2)),
            })
        };
        collector.add(sv, &loose(511_224.0, WordsState::Torn, &old, 4..10));
        for k in 2..10 {
            let one = loose(511_254.0, WordsState::UnderWay, &new, k..k + 1);
            assert_eq!(collector.add(sv, &one), None);
        }
        assert!(collector.almanacs().is_empty());
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
