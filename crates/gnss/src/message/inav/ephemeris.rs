//! Ephemerides from words of one issue of data.

use super::almanac::{NOMINAL_A_M, NOMINAL_I_DEG};
use super::contents::{Word1, Word2, Word3, Word4, Word5, Word16, sisa_m};
use super::gps_week;
use super::words::InavWord;
use crate::orbit::broadcast::{NO_ACCURACY, ura_index};
use crate::{Ephemeris, GpsTime, Sv};

/// The last words of a satellite, of types 1 to 5, that make up its ephemeris.
#[derive(Clone, Debug, Default)]
pub(super) struct EphemerisWords {
    pub first: Option<Word1>,
    pub second: Option<Word2>,
    pub third: Option<Word3>,
    pub fourth: Option<Word4>,
    pub fifth: Option<Word5>,
}

impl EphemerisWords {
    /// The ephemeris, where the words 1 to 4 are of one issue of data and of this satellite (OS SIS ICD 5.1.9.2), and
    /// word 5 has given week, group delay and health, which belong to no issue. Weeks modulo 4096 are resolved to
    /// those nearest the GPS week `reference_week`.
    pub(super) fn ephemeris(&self, sv: Sv, reference_week: i32) -> Option<Ephemeris> {
        let (w1, w2, w3) = (self.first.as_ref()?, self.second.as_ref()?, self.third.as_ref()?);
        let (w4, w5) = (self.fourth.as_ref()?, self.fifth.as_ref()?);
        let is_one_issue = [w2.iod_nav, w3.iod_nav, w4.iod_nav].iter().all(|&i| i == w1.iod_nav);
        if !is_one_issue || w4.sv_id != sv.number() {
            return None;
        }
        let week = gps_week(w5.week, reference_week);
        let sent = GpsTime::from_week_tow(week, w5.tow.into());
        Some(Ephemeris {
            sv,
            iodc: w1.iod_nav,
            iode: (w1.iod_nav & 0xFF) as u8,
            ura_index: sisa_m(w3.sisa).map_or(NO_ACCURACY, ura_index),
            health: w5.health.e1b_word(),
            l2_codes: 0,
            l2_p_data: false,
            fit_interval_flag: false,
            toc: sent.nearest_with_tow(w4.toc),
            toe: sent.nearest_with_tow(w1.toe),
            transmission_time: Some(sent),
            af0: w4.af0,
            af1: w4.af1,
            af2: w4.af2,
            tgd: w5.bgd_e1_e5b,
            sqrt_a: w1.sqrt_a,
            e: w1.e,
            m0: w1.m0,
            delta_n: w3.delta_n,
            omega0: w2.omega0,
            omega_dot: w3.omega_dot,
            i0: w2.i0,
            idot: w2.idot,
            omega: w2.omega,
            cuc: w3.cuc,
            cus: w3.cus,
            crc: w3.crc,
            crs: w3.crs,
            cic: w4.cic,
            cis: w4.cis,
        })
    }
}

/// The words 1 to 4 that carry an ephemeris of Galileo, with the index of its accuracy.
pub fn ephemeris_words(eph: &Ephemeris, sisa: u8) -> [InavWord; 4] {
    let iod_nav = eph.iodc;
    let (toe, toc, sv_id) = (eph.toe.tow(), eph.toc.tow(), eph.sv.number());
    let Ephemeris { m0, e, sqrt_a, omega0, i0, omega, idot, omega_dot, delta_n, .. } = *eph;
    let Ephemeris { cuc, cus, crc, crs, cic, cis, af0, af1, af2, .. } = *eph;
    [
        InavWord::Ephemeris1(Word1 { iod_nav, toe, m0, e, sqrt_a, reserved: 0b11 }),
        InavWord::Ephemeris2(Word2 { iod_nav, omega0, i0, omega, idot }),
        InavWord::Ephemeris3(Word3 { iod_nav, omega_dot, delta_n, cuc, cus, crc, crs, sisa }),
        InavWord::Ephemeris4(Word4 { iod_nav, sv_id, cic, cis, toc, af0, af1, af2 }),
    ]
}

impl Word16 {
    /// The reduced ephemeris of a satellite as an ephemeris, from the time at which its page was sent: reference is
    /// second 1 of the 30 s in which that lies (OS SIS ICD 5.1.11). Health, accuracy and group delay are not part of it.
    pub fn ephemeris(&self, sv: Sv, sent: GpsTime) -> Ephemeris {
        let t0r = sent - sent.tow().rem_euclid(30.0) + 1.0;
        let omega = self.ey.atan2(self.ex);
        Ephemeris {
            sv,
            toc: t0r,
            toe: t0r,
            transmission_time: Some(sent),
            af0: self.af0,
            af1: self.af1,
            sqrt_a: (NOMINAL_A_M + self.delta_a).sqrt(),
            e: self.ex.hypot(self.ey),
            m0: self.lambda0 - omega,
            omega0: self.omega0,
            i0: NOMINAL_I_DEG.to_radians() + self.delta_i0,
            omega,
            iodc: 0,
            iode: 0,
            ura_index: NO_ACCURACY,
            health: 0,
            l2_codes: 0,
            l2_p_data: false,
            fit_interval_flag: false,
            af2: 0.0,
            tgd: 0.0,
            delta_n: 0.0,
            omega_dot: 0.0,
            idot: 0.0,
            cuc: 0.0,
            cus: 0.0,
            crc: 0.0,
            crs: 0.0,
            cic: 0.0,
            cis: 0.0,
        }
    }
}
