//! From the words of all Galileo satellites to navigation data.

use super::almanac::{AlmanacWords, GalileoAlmanac};
use super::contents::{Word5, Word6, sisa_m};
use super::ephemeris::EphemerisWords;
use super::fec2::IssueWords;
use super::gps_week;
use super::words::InavWord;
use crate::galileo_data::NequickCoefficients;
use crate::message::Update;
use crate::message::lnav::resolve_week;
use crate::navigation_data::UtcParameters;
use crate::time::SECONDS_PER_WEEK;
use crate::{GpsTime, NavigationData, Sv};
use std::collections::BTreeMap;

/// Words 7 to 10 belong together where they come within this time, s: 32 s pass from the first to the last, and the
/// time of a satellite is known to 20 s while words are lost; the next that could be taken for them come 60 s later.
const ALMANAC_SPAN_S: f64 = 60.0;

/// Latest words of one satellite.
#[derive(Clone, Debug, Default)]
struct Satellite {
    ephemeris: EphemerisWords,
    issue: Option<IssueWords>,
    almanac: AlmanacWords,
    /// Time of week that it stated last, s, and when the newest of its almanac words came.
    tow: Option<f64>,
    almanac_tow: Option<f64>,
}

/// Gathers the navigation data of Galileo.
///
/// An ephemeris is taken when IODnav of the words 1 to 4 agrees (OS SIS ICD 5.1.9.2), and is never mixed of two issues.
#[derive(Clone, Debug)]
pub(in crate::message) struct InavCollector {
    reference_week: i32,
    /// Full GPS week that was stated last.
    week: Option<i32>,
    utc: Option<Word6>,
    satellites: BTreeMap<Sv, Satellite>,
    almanacs: BTreeMap<Sv, GalileoAlmanac>,
}

impl InavCollector {
    pub(in crate::message) fn new(reference_week: i32) -> Self {
        let (satellites, almanacs) = (BTreeMap::new(), BTreeMap::new());
        Self { reference_week, week: None, utc: None, satellites, almanacs }
    }

    pub(in crate::message) fn almanacs(&self) -> &BTreeMap<Sv, GalileoAlmanac> {
        &self.almanacs
    }

    /// Takes a word of a satellite, writes what is new into `data`, and says what that is.
    pub(in crate::message) fn add(
        &mut self,
        sv: Sv,
        word: &InavWord,
        data: &mut NavigationData,
    ) -> Option<Update> {
        let satellite = self.satellites.entry(sv).or_default();
        satellite.tow = word.tow_s().or(satellite.tow);
        if let Some(week) = word.week() {
            self.week = Some(gps_week(week, self.reference_week));
        }
        let regained = IssueWords::add(&mut satellite.issue, word, satellite.tow);
        match word.clone() {
            InavWord::IonosphereHealth(word) => {
                let health_changed = keep_status(sv, &word, data);
                satellite.ephemeris.fifth = Some(word);
                let new = self.complete(sv, data);
                return new.or(health_changed.then_some(Update::Health));
            }
            InavWord::Utc(word) => {
                self.utc = Some(word);
                return self.resolve_utc(data);
            }
            InavWord::Almanac7(_)
            | InavWord::Almanac8(_)
            | InavWord::Almanac9(_)
            | InavWord::Almanac10(_) => return self.add_almanac(sv, word, data),
            InavWord::SpareTime(_) => return self.resolve_utc(data),
            InavWord::Reduced(_) | InavWord::Other(_) => return None,
            InavWord::Ephemeris1(_)
            | InavWord::Ephemeris2(_)
            | InavWord::Ephemeris3(_)
            | InavWord::Ephemeris4(_)
            | InavWord::Parity(_) => {
                for word in regained.iter().flatten().chain([word]) {
                    keep_quarter(sv, word, &mut satellite.ephemeris, data);
                }
            }
        }
        self.complete(sv, data)
    }

    fn complete(&self, sv: Sv, data: &mut NavigationData) -> Option<Update> {
        let ephemeris = self.satellites[&sv].ephemeris.ephemeris(sv, self.reference_week)?;
        let known = data.iter().any(|e| {
            (e.sv, e.toe, e.toc, e.iodc) == (sv, ephemeris.toe, ephemeris.toc, ephemeris.iodc)
        });
        data.insert(ephemeris);
        (!known).then_some(Update::Ephemeris(sv))
    }

    /// Weeks modulo 256 of the UTC parameters are ambiguous before a satellite has stated the week.
    fn resolve_utc(&self, data: &mut NavigationData) -> Option<Update> {
        let utc = utc_parameters(self.utc.as_ref()?, self.week?);
        let is_new = data.galileo.utc.replace(utc) != Some(utc);
        is_new.then_some(Update::IonosphereUtc)
    }

    fn add_almanac(
        &mut self,
        sv: Sv,
        word: &InavWord,
        data: &mut NavigationData,
    ) -> Option<Update> {
        let satellite = self.satellites.get_mut(&sv)?;
        let tow = satellite.tow?;
        let since = |before: f64| (tow - before).rem_euclid(SECONDS_PER_WEEK as f64);
        if satellite.almanac_tow.is_none_or(|before| since(before) > ALMANAC_SPAN_S) {
            satellite.almanac = AlmanacWords::default();
        }
        satellite.almanac_tow = Some(tow);
        // A word begins anew what follows it.
        let words = std::mem::take(&mut satellite.almanac);
        let AlmanacWords { first, second, third, .. } = words;
        satellite.almanac = match word.clone() {
            InavWord::Almanac7(word) => {
                AlmanacWords { first: Some(word), ..AlmanacWords::default() }
            }
            InavWord::Almanac8(word) => {
                AlmanacWords { first, second: Some(word), ..AlmanacWords::default() }
            }
            InavWord::Almanac9(word) => {
                AlmanacWords { first: None, second, third: Some(word), fourth: None }
            }
            InavWord::Almanac10(word) => {
                let offset = self.week.and_then(|week| word.gps_offset.resolve(week));
                data.galileo.gps_offset = offset;
                AlmanacWords { first: None, second: None, third, fourth: Some(word) }
            }
            _ => return None,
        };
        let almanac = satellite.almanac.almanac(self.week?)?;
        let of = almanac.sv;
        self.almanacs.insert(of, almanac);
        Some(Update::Almanac(of))
    }
}

/// Keeps one of the words 1 to 4.
fn keep_quarter(sv: Sv, word: &InavWord, words: &mut EphemerisWords, data: &mut NavigationData) {
    match word.clone() {
        InavWord::Ephemeris1(word) => words.first = Some(word),
        InavWord::Ephemeris2(word) => words.second = Some(word),
        InavWord::Ephemeris3(word) => {
            data.galileo.status.entry(sv).or_default().sisa_m = sisa_m(word.sisa);
            words.third = Some(word);
        }
        InavWord::Ephemeris4(word) => words.fourth = Some(word),
        _ => (),
    }
}

/// Keeps word 5 but for the time, and says whether the health has changed.
fn keep_status(sv: Sv, word: &Word5, data: &mut NavigationData) -> bool {
    let &Word5 { ai, storm_flags, bgd_e1_e5a, bgd_e1_e5b, health, .. } = word;
    data.galileo.nequick = Some(NequickCoefficients { ai, storm_flags });
    let status = data.galileo.status.entry(sv).or_default();
    (status.bgd_e1_e5a, status.bgd_e1_e5b) = (bgd_e1_e5a, bgd_e1_e5b);
    std::mem::replace(&mut status.health, health) != health
}

/// The UTC parameters, with weeks modulo 256 resolved to those nearest the (full, GPS) `week`: week 0 of GST is one of
/// GPS that is a multiple of 256.
fn utc_parameters(word: &Word6, week: i32) -> UtcParameters {
    UtcParameters {
        a0: word.a0,
        a1: word.a1,
        tot: GpsTime::from_week_tow(resolve_week(word.week_0t.into(), 8, week), word.t0t),
        delta_t_ls: word.delta_t_ls as i32,
        delta_t_lsf: word.delta_t_lsf as i32,
        wn_lsf: resolve_week(word.week_lsf.into(), 8, week),
        day: word.day,
    }
}
