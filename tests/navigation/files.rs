//! All available navigation files, by teqc, sbf2rin, RTKCONV, CDDIS and others.

use crate::common::{Tested, data};
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::gnss::{Constellation, GpsTime, Sv};

/// Each file with its numbers of GPS and QZSS records and of satellites, counted with grep and awk.
pub const FILES: [(&str, usize, usize); 7] = [
    ("nav/brdc0010.22n", 422, 32),
    ("obs/gnsstk-arlm/arlm2000.15n", 168, 31),
    ("obs/gnsstk-arlm/arlm200a.15n", 28, 16),
    ("obs/gps-sdr-sim-rtk/base.nav", 13, 13),
    ("obs/matrtklib-static/base.nav", 16, 16),
    ("obs/rtklib-geonet/07590920.05n", 162, 28),
    ("obs/rtklib-geonet/30400920.05n", 164, 28),
];

#[test]
fn every_navigation_file_is_read_whole() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    for (name, expected_records, satellites) in FILES {
        let data = rinex_nav::read(folder.join(name))?.data;
        let lnav = |sv: &Sv| matches!(sv.constellation(), Constellation::Gps | Constellation::Qzss);
        let records = data.iter().filter(|e| lnav(&e.sv)).count();
        let counted = (records, data.satellites().filter(lnav).count());
        if counted != (expected_records, satellites) {
            return Err(format!("{name}: {counted:?} records and satellites").into());
        }
    }
    Ok(())
}

/// Two issues two hours apart describe one orbit: half-way between them they agree to the accuracy of a
/// broadcast orbit (metres; 30 m bounds a fit's ends), which no misread column would let them.
#[test]
fn orbits_of_one_satellite_join_between_issues() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let data = rinex_nav::read(folder.join("nav/brdc0010.22n"))?.data;
    let mut pairs = 0;
    for sv in data.satellites() {
        let list: Vec<_> = data.iter().filter(|e| e.sv == sv && e.health == 0).collect();
        for pair in list.windows(2).filter(|p| p[1].toe - p[0].toe == 7200.0) {
            let middle: GpsTime = pair[0].toe + 3600.0;
            let miss = (pair[0].state(middle).position_m - pair[1].state(middle).position_m).norm();
            if miss > 30.0 {
                return Err(format!("{sv} at {middle}: issues differ by {miss:.1} m").into());
            }
            pairs += 1;
        }
    }
    if pairs < 100 { Err(format!("only {pairs} pairs").into()) } else { Ok(()) }
}
