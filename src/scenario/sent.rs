//! What the components of a signal send: the sign of each code period.

use super::message::{ConstellationMessage, MessageStream};
use crate::gnss::galileo_data::GalileoHealth;
use crate::gnss::message::inav::{
    InavPage, InavWord, OutOfRange, PAGE_SYMBOLS, Word0, Word5, Word6, ephemeris_words,
    page_symbols,
};
use crate::gnss::message::lnav::LnavError;
use crate::gnss::navigation_data::UtcParameters;
use crate::gnss::time::SECONDS_PER_WEEK;
use crate::gnss::{Constellation, Ephemeris, GpsTime, Transmission};
use std::sync::Arc;

/// The GPS week that is week 0 of GST.
const GPS_WEEK_OF_GST: i32 = 1024;
/// Index of the accuracy SISA that is sent: 3.12 m, as satellites in service send it.
const SISA: u8 = 107;

/// Why a message cannot be sent.
#[derive(Debug, thiserror::Error)]
pub enum MessageError {
    /// Of GPS or QZSS.
    #[error(transparent)]
    Lnav(#[from] LnavError),
    /// Of Galileo.
    #[error(transparent)]
    Inav(#[from] OutOfRange),
}

/// The signs of the code periods of one component.
#[derive(Clone, Debug)]
pub(super) enum Sent {
    /// The bits of LNAV.
    Lnav(Box<MessageStream>),
    /// The symbols of I/NAV, one a code period.
    Inav(Box<InavStream>),
    /// A pilot's secondary code.
    Overlay(Box<[i8]>),
}

impl Sent {
    /// What a component of a satellite sends; none where its message cannot be made here.
    pub(super) fn new(
        component: Transmission,
        ephemeris: &Ephemeris,
        constellation: &Arc<ConstellationMessage>,
        utc: UtcParameters,
    ) -> Result<Option<Self>, MessageError> {
        if component.is_pilot() {
            return Ok(component.overlay().map(Self::Overlay));
        }
        Ok(match component.sv.constellation() {
            Constellation::Gps | Constellation::Qzss => {
                let message = MessageStream::new(ephemeris.clone(), Arc::clone(constellation))?;
                Some(Self::Lnav(Box::new(message)))
            }
            Constellation::Galileo => {
                Some(Self::Inav(Box::new(InavStream::new(ephemeris.clone(), utc)?)))
            }
            _ => None,
        })
    }

    /// Sign (+1 for logical 0, -1 for 1) of the code period that starts `period` periods after the GPS epoch by the
    /// satellite's clock.
    pub(super) fn sign(&mut self, period: i64) -> Result<f32, MessageError> {
        Ok(match self {
            Self::Lnav(message) => message.sign(period)?,
            Self::Inav(message) => message.sign(period)?,
            Self::Overlay(chips) => {
                f32::from(chips[period.rem_euclid(chips.len() as i64) as usize])
            }
        })
    }
}

/// The symbols of I/NAV of one satellite: any at any time; the last page is kept. Words 1 to 6 come at their places in
/// 30 s (Galileo OS SIS ICD 2.1, table 55), word 0 at those of all others.
#[derive(Clone, Debug)]
pub(super) struct InavStream {
    ephemeris: Ephemeris,
    utc: UtcParameters,
    current: i64,
    symbols: [i8; PAGE_SYMBOLS],
}

impl InavStream {
    fn new(ephemeris: Ephemeris, utc: UtcParameters) -> Result<Self, OutOfRange> {
        let mut stream = Self { ephemeris, utc, current: 0, symbols: [0; PAGE_SYMBOLS] };
        for page in 0..15 {
            stream.symbols = stream.page(page)?;
        }
        Ok(Self { current: 14, ..stream })
    }

    /// The page that starts at second 2 `index` + 1 of GST, counted from the GPS epoch.
    fn page(&self, index: i64) -> Result<[i8; PAGE_SYMBOLS], OutOfRange> {
        let second = 2 * index + 1;
        let (week, tow) =
            (second.div_euclid(SECONDS_PER_WEEK), second.rem_euclid(SECONDS_PER_WEEK));
        let week = ((week as i32 - GPS_WEEK_OF_GST) & 0xFFF) as u16;
        let tow = tow as u32;
        let [first, second, third, fourth] = ephemeris_words(&self.ephemeris, SISA);
        let word = match tow % 30 {
            1 => second,
            3 => fourth,
            5 => self.utc_word(tow),
            21 => first,
            23 => third,
            25 => InavWord::IonosphereHealth(Word5 {
                bgd_e1_e5a: self.ephemeris.tgd,
                bgd_e1_e5b: self.ephemeris.tgd,
                health: GalileoHealth {
                    e1b_status: self.ephemeris.health >> 1 & 3,
                    e1b_not_valid: self.ephemeris.health & 1 == 1,
                    ..GalileoHealth::default()
                },
                week,
                tow,
                ..Word5::default()
            }),
            _ => InavWord::SpareTime(Word0 { time: 2, week, tow }),
        };
        Ok(page_symbols(&InavPage::new(word).encode()?))
    }

    fn utc_word(&self, tow: u32) -> InavWord {
        let UtcParameters { a0, a1, tot, delta_t_ls, delta_t_lsf, wn_lsf, day } = self.utc;
        InavWord::Utc(Word6 {
            a0,
            a1,
            delta_t_ls: delta_t_ls.into(),
            t0t: (tot.tow() / 3600.0).round() * 3600.0,
            week_0t: tot.week() as u8,
            week_lsf: wn_lsf as u8,
            day,
            delta_t_lsf: delta_t_lsf.into(),
            tow,
        })
    }

    fn sign(&mut self, period: i64) -> Result<f32, OutOfRange> {
        let symbols = PAGE_SYMBOLS as i64;
        // Pages start at odd seconds.
        let since = period - symbols / 2;
        let page = since.div_euclid(symbols);
        if page != self.current {
            self.symbols = self.page(page)?;
            self.current = page;
        }
        Ok(f32::from(self.symbols[since.rem_euclid(symbols) as usize]))
    }
}

/// UTC parameters of a time without any: GPS time less UTC is the leap seconds, and no change is due.
pub(super) fn default_utc(start: GpsTime) -> UtcParameters {
    let leap = start.leap_seconds();
    UtcParameters {
        a0: 0.0,
        a1: 0.0,
        tot: GpsTime::from_week_tow(start.week(), 0.0),
        delta_t_ls: leap,
        delta_t_lsf: leap,
        wn_lsf: start.week(),
        day: 1,
    }
}
