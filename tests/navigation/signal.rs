//! Broadcast ephemerides through the signal: encoded, sent as soft bits, found, decoded, collected.

use crate::common::{Tested, data};
use crate::files::FILES;
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::gnss::message::lnav::FrameDecoder;
use sdr_rx::gnss::message::lnav::{Header, LnavMessage, Subframe1, encode_subframe};
use sdr_rx::gnss::message::{MessageDecoder, NavigationCollector, Update};
use sdr_rx::gnss::{Constellation, Ephemeris};

#[test]
fn every_broadcast_ephemeris_survives_the_signal() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    for (name, ..) in FILES {
        let data = rinex_nav::read(folder.join(name))?.data;
        let lnav = |e: &&Ephemeris| {
            matches!(e.sv.constellation(), Constellation::Gps | Constellation::Qzss)
        };
        for eph in data.iter().filter(lnav) {
            through_the_signal(eph).map_err(|e| format!("{name} {} {}: {e}", eph.sv, eph.toe))?;
        }
    }
    Ok(())
}

/// Sends one frame of subframes 1 to 3, inverted and from the middle of a word before them.
fn through_the_signal(eph: &Ephemeris) -> Result<(), String> {
    let start = ((eph.toe - 3600.0).tow() / 30.0).floor() * 30.0;
    let week = (eph.toe - 3600.0).week();
    let messages = [
        LnavMessage::Clock(Subframe1::new(eph, week)),
        LnavMessage::Orbit(eph.into()),
        LnavMessage::Orientation(eph.into()),
    ];
    let mut decoder = FrameDecoder::new();
    let mut collector = NavigationCollector::new(week);
    let mut index = 0;
    let mut updates = Vec::new();
    let mut push = |bit: f32| {
        let found = decoder.push(-bit, index);
        index += 1;
        if let Some(page) = found {
            updates.extend(collector.add(eph.sv, &page.content));
        }
    };
    [1.0, -1.0, 1.0].into_iter().for_each(&mut push);
    for (id, message) in (1..).zip(&messages) {
        let header = Header::new(id, start + 6.0 * f64::from(id - 1));
        for word in encode_subframe(&header, message).map_err(|e| e.to_string())? {
            (0..30).rev().for_each(|b| push(if word >> b & 1 == 1 { -1.0 } else { 1.0 }));
        }
    }
    if updates != [Update::Ephemeris(eph.sv)] {
        return Err(format!("updates {updates:?}"));
    }
    let back = collector.data().iter().next().ok_or("nothing collected")?;
    if (back.iodc, back.iode, back.ura_index, back.health, back.toe, back.toc)
        != (eph.iodc, eph.iode, eph.ura_index, eph.health, eph.toe, eph.toc)
    {
        return Err(format!("{back:?}"));
    }
    // Unit of each field (tables 20-I and 20-III). A file's 12 digits give 2^31 units to 0.01 unit; files
    // merged from others have been rounded twice: 0.02. A wrong scale or sign would miss by about 0.5.
    use sdr_rx::gnss::constants::GPS_PI;
    let pi = |exponent: i32| GPS_PI * 2f64.powi(exponent);
    let fields = |e: &Ephemeris| {
        [
            (e.af0, 2f64.powi(-31)),
            (e.af1, 2f64.powi(-43)),
            (e.af2, 2f64.powi(-55)),
            (e.tgd, 2f64.powi(-31)),
            (e.sqrt_a, 2f64.powi(-19)),
            (e.e, 2f64.powi(-33)),
            (e.m0, pi(-31)),
            (e.delta_n, pi(-43)),
            (e.omega0, pi(-31)),
            (e.omega_dot, pi(-43)),
            (e.i0, pi(-31)),
            (e.idot, pi(-43)),
            (e.omega, pi(-31)),
            (e.cuc, 2f64.powi(-29)),
            (e.cus, 2f64.powi(-29)),
            (e.crc, 2f64.powi(-5)),
            (e.crs, 2f64.powi(-5)),
            (e.cic, 2f64.powi(-29)),
            (e.cis, 2f64.powi(-29)),
        ]
    };
    for (k, (ours, theirs)) in fields(back).into_iter().zip(fields(eph)).enumerate() {
        if (ours.0 - theirs.0).abs() > 0.02 * theirs.1 {
            return Err(format!("field {k}: {:e} instead of {:e}", ours.0, theirs.0));
        }
    }
    Ok(())
}
