//! The navigation message (LNAV) of one satellite of GPS or QZSS as a stream of bits.

use crate::gnss::message::lnav::{
    Almanac, DATA_ID_GPS, DATA_ID_REPEATED, Header, Health1To24, Health25To32, IonosphereUtc,
    LnavError, LnavMessage, SUBFRAME_BITS, Subframe1, encode_with_data_id, page_sv_id,
};
use crate::gnss::time::SECONDS_PER_WEEK;
use crate::gnss::{Constellation, Ephemeris, GpsTime, signal};
use std::sync::Arc;

/// Pages in the cycle of subframes 4 and 5, which starts with the week.
const PAGES: i64 = 25;
/// Subframes in a week.
const SUBFRAMES_PER_WEEK: i64 = SECONDS_PER_WEEK / 6;

/// The contents of subframes 4 and 5, the same from all satellites.
#[derive(Clone, Debug)]
pub struct ConstellationMessage {
    almanacs: Vec<Almanac>,
    time_of_almanac: GpsTime,
    ionosphere_utc: Option<IonosphereUtc>,
}

impl ConstellationMessage {
    /// Almanacs of `ephemerides` for the reference time nearest `start`, and page 18 where known.
    pub fn new<'a>(
        ephemerides: impl Iterator<Item = &'a Ephemeris>,
        ionosphere_utc: Option<IonosphereUtc>,
        start: GpsTime,
    ) -> Self {
        let toa = (start.tow() / 4096.0).round().min(147.0) * 4096.0;
        let time_of_almanac = GpsTime::from_week_tow(start.week(), toa);
        let almanacs = ephemerides.map(|e| Almanac::new(e, time_of_almanac)).collect();
        Self { almanacs, time_of_almanac, ionosphere_utc }
    }

    /// Message of a page (1 to 25) of subframe 4 or 5 (IS-GPS-200N table 20-V).
    fn page(&self, subframe: u8, page: u8) -> LnavMessage {
        let health = |prn: u8| {
            let almanac = self.almanacs.iter().find(|a| a.sv_id == prn);
            almanac.map_or(63, |a| a.health & 63)
        };
        match (page_sv_id(subframe, page), &self.ionosphere_utc) {
            (id @ 1..=32, _) => {
                let almanac = self.almanacs.iter().find(|a| a.sv_id == id);
                almanac.map_or(LnavMessage::Other(0), |a| LnavMessage::Almanac(a.clone()))
            }
            (56, Some(page)) => LnavMessage::IonosphereUtc(page.clone()),
            (51, _) => LnavMessage::Health1To24(Health1To24 {
                toa: self.time_of_almanac.tow(),
                week_a: self.time_of_almanac.week().rem_euclid(256) as u8,
                health: std::array::from_fn(|k| health(k as u8 + 1)),
            }),
            (63, _) => LnavMessage::Health25To32(Health25To32 {
                configuration: [9; 32],
                health: std::array::from_fn(|k| health(k as u8 + 25)),
            }),
            (id, _) => LnavMessage::Other(id),
        }
    }
}

/// The message of one satellite: any bit at any time; the last subframe is kept.
#[derive(Clone, Debug)]
pub struct MessageStream {
    ephemeris: Ephemeris,
    constellation: Arc<ConstellationMessage>,
    periods_per_bit: i64,
    current: i64,
    words: [u32; 10],
}

impl MessageStream {
    /// The stream of a satellite.
    pub fn new(
        ephemeris: Ephemeris,
        constellation: Arc<ConstellationMessage>,
    ) -> Result<Self, LnavError> {
        let periods_per_bit = signal::of(ephemeris.sv).timing().cycle as i64;
        let (current, words) = (i64::MIN, [0; 10]);
        let stream = Self { ephemeris, constellation, periods_per_bit, current, words };
        (0..5 * PAGES).try_for_each(|k| stream.subframe(k).map(drop))?;
        Ok(stream)
    }

    /// The words of the subframe that starts `index` x 6 s after the GPS epoch.
    pub fn subframe(&self, index: i64) -> Result<[u32; 10], LnavError> {
        let (week, in_week) =
            (index.div_euclid(SUBFRAMES_PER_WEEK), index.rem_euclid(SUBFRAMES_PER_WEEK));
        let id = (in_week % 5 + 1) as u8;
        let page = (in_week / 5 % PAGES + 1) as u8;
        let message = match id {
            1 => LnavMessage::Clock(Subframe1::new(&self.ephemeris, week as i32)),
            2 => LnavMessage::Orbit((&self.ephemeris).into()),
            3 => LnavMessage::Orientation((&self.ephemeris).into()),
            _ => self.constellation.page(id, page),
        };
        let data_id = match self.ephemeris.sv.constellation() {
            Constellation::Qzss => DATA_ID_REPEATED,
            _ => DATA_ID_GPS,
        };
        encode_with_data_id(&Header::new(id, in_week as f64 * 6.0), &message, data_id)
    }

    /// Sign (+1 for bit 0, -1 for bit 1) of the code period that starts `period` periods after the GPS epoch by the
    /// satellite's clock.
    pub fn sign(&mut self, period: i64) -> Result<f32, LnavError> {
        let bit = period.div_euclid(self.periods_per_bit);
        let subframe = bit.div_euclid(SUBFRAME_BITS as i64);
        if subframe != self.current {
            self.words = self.subframe(subframe)?;
            self.current = subframe;
        }
        let at = bit.rem_euclid(SUBFRAME_BITS as i64) as usize;
        let one = self.words[at / 30] >> (29 - at % 30) & 1 == 1;
        Ok(if one { -1.0 } else { 1.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::Sv;
    use crate::gnss::message::lnav::{assemble, decode_subframe, decode_words};
    use crate::gnss::orbit::broadcast::sample_ephemeris;

    #[test]
    fn twelve_and_a_half_minutes_of_bits_decode_to_the_ephemeris_and_all_pages() {
        let eph = sample_ephemeris();
        let start = eph.toe;
        let page_18 = IonosphereUtc { delta_t_ls: 18.0, ..IonosphereUtc::default() };
        let common =
            Arc::new(ConstellationMessage::new([&eph].into_iter(), Some(page_18.clone()), start));
        let mut stream = MessageStream::new(eph.clone(), common).unwrap();
        // 750 s from a multiple of 750 s after the week's start: all 25 pages in order.
        let first_ms = (i64::from(start.week()) * SECONDS_PER_WEEK + 518_250) * 1000;
        let mut clock = None;
        let mut orbit = None;
        let mut decoded = None;
        let mut ids = Vec::new();
        for subframe in 0..125 {
            let mut words = [0u32; 10];
            for bit in 0..300 {
                let ms = first_ms + (subframe * 300 + bit) * 20;
                let sign = stream.sign(ms).unwrap();
                assert_eq!(sign, stream.sign(ms + 19).unwrap());
                let word = &mut words[bit as usize / 30];
                *word = *word << 1 | u32::from(sign < 0.0);
            }
            let (header, message) = decode_subframe(&decode_words(&words, 0).unwrap());
            assert_eq!(i64::from(header.id), subframe % 5 + 1);
            assert_eq!(header.tow(), 518_250.0 + 6.0 * subframe as f64);
            match message {
                LnavMessage::Clock(s1) => clock = Some((s1, header.tow())),
                LnavMessage::Orbit(s2) => orbit = Some(s2),
                LnavMessage::Orientation(s3) => {
                    let (s1, tow) = clock.as_ref().unwrap();
                    let parts = (s1, orbit.as_ref().unwrap(), &s3);
                    decoded = assemble(eph.sv, parts, *tow, start.week());
                }
                LnavMessage::Almanac(a) => ids.push((header.id, a.sv_id)),
                LnavMessage::IonosphereUtc(p) => {
                    assert_eq!((subframe / 5 + 1, p), (18, page_18.clone()));
                    ids.push((4, 56));
                }
                LnavMessage::Health25To32(h) => {
                    assert_eq!((subframe / 5 + 1, h.health[0]), (25, 63));
                    ids.push((4, 63));
                }
                LnavMessage::Health1To24(h) => {
                    assert_eq!((subframe / 5 + 1, h.health[0], h.health[1]), (25, 0, 63));
                    ids.push((5, 51));
                }
                LnavMessage::Other(_) => {}
            }
        }
        assert_eq!(ids, [(5, 1), (4, 56), (4, 63), (5, 51)]);
        let decoded = decoded.unwrap();
        // The file's twelve digits and the field's step: 26.5e6 m x 2^-32 semicircles = 0.02 m.
        let t = start + 1000.0;
        assert!((decoded.state(t).position_m - eph.state(t).position_m).norm() < 0.05);
        assert_eq!(
            (decoded.iode, decoded.toe, decoded.sv),
            (eph.iode, eph.toe, Sv::from_prn(1).unwrap())
        );
    }
}
