//! Broadcast ephemerides through the signal: encoded, sent as soft bits, found, decoded, collected.

use crate::common::data_trial;
use crate::files::FILES;
use libtest_mimic::{Failed, Trial};
use sdr_rx::gnss::lnav::{Header, Message, Subframe1, encode_subframe};
use sdr_rx::gnss::{Ephemeris, rinex_nav};
use sdr_rx::navigation::{FrameDecoder, NavigationCollector, Update};
use std::path::Path;

pub fn trials() -> Vec<Trial> {
    vec![data_trial("every_broadcast_ephemeris_survives_the_signal", every_ephemeris_survives)]
}

fn every_ephemeris_survives(folder: &Path) -> Result<(), Failed> {
    for (name, ..) in FILES {
        for eph in rinex_nav::read(folder.join(name))?.iter() {
            through_the_signal(eph).map_err(|e| format!("{name} {} {}: {e}", eph.sv, eph.toe))?;
        }
    }
    Ok(())
}

/// Sends one frame of subframes 1 to 3, upside down and from the middle of a word before them.
fn through_the_signal(eph: &Ephemeris) -> Result<(), String> {
    let start = ((eph.toe - 3600.0).tow() / 30.0).floor() * 30.0;
    let week = (eph.toe - 3600.0).week();
    let messages = [
        Message::Clock(Subframe1::new(eph, week)),
        Message::Orbit(eph.into()),
        Message::Orientation(eph.into()),
    ];
    let mut decoder = FrameDecoder::new();
    let mut collector = NavigationCollector::new(week);
    let mut index = 0;
    let mut updates = Vec::new();
    let mut push = |bit: f32| {
        let found = decoder.push(-bit, index);
        index += 1;
        if let Some(subframe) = found {
            updates.extend(collector.add(eph.sv, &subframe));
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
    // Files print at least 12 digits, which is finer than any field: half a unit is 5e-12 of a mantissa
    // of 0.1, and files merged from others have been rounded twice, so a whole unit is allowed.
    let numbers = |e: &Ephemeris| {
        [
            e.af0,
            e.af1,
            e.af2,
            e.tgd,
            e.sqrt_a,
            e.e,
            e.m0,
            e.delta_n,
            e.omega0,
            e.omega_dot,
            e.i0,
            e.idot,
            e.omega,
            e.cuc,
            e.cus,
            e.crc,
            e.crs,
            e.cic,
            e.cis,
        ]
    };
    for (k, (ours, theirs)) in numbers(back).into_iter().zip(numbers(eph)).enumerate() {
        if (ours - theirs).abs() > 1e-11 * theirs.abs() {
            return Err(format!("number {k}: {ours:e} instead of {theirs:e}"));
        }
    }
    Ok(())
}
