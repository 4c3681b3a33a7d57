//! Records of Galileo, BeiDou, GLONASS and QZSS: what their fields mean, and that what is written is read back.

use super::*;
use crate::galileo_data::{GalileoHealth, GalileoStatus};
use crate::orbit::broadcast::sample_ephemeris;
use crate::{Ephemeris, GlonassEphemeris, GpsTime, Sv};
use nalgebra::Vector3;

fn sv(name: &str) -> Sv {
    name.parse().unwrap()
}

fn file(version: &str, records: &str) -> String {
    let header = format!("     {version}           N: GNSS NAV DATA    M: MIXED");
    format!("{header:<60}RINEX VERSION / TYPE\n{:60}END OF HEADER\n{records}", "")
}

fn glonass() -> GlonassEphemeris {
    GlonassEphemeris {
        sv: sv("R02"),
        tb: GpsTime::from_utc(2022, 1, 1, 0, 15, 0.0),
        sent: Some(GpsTime::from_utc(2022, 1, 1, 0, 10, 30.0)),
        clock_bias_s: -2.340879291296e-5,
        clock_drift_sps: 9.094947017729e-13,
        position_m: Vector3::new(-4.410207031250e6, 1.286270947266e7, 2.164103417969e7),
        velocity_mps: Vector3::new(-1.357080459595e3, -2.621530532837e3, 1.278439521790e3),
        acceleration_mps2: Vector3::new(9.313225746155e-7, 4.656612873077e-6, 0.0),
        health: 0,
        channel: Some(-4),
        age_days: 1,
    }
}

#[test]
fn what_is_written_of_each_system_is_read_back() {
    let sample = sample_ephemeris();
    let sent = Some(sample.toe - 1782.0);
    let lnav = |name: &str| Ephemeris { sv: sv(name), transmission_time: sent, ..sample.clone() };
    // Fields of LNAV that others do not have.
    let other = |name: &str| Ephemeris { l2_codes: 0, ..lnav(name) };
    let beidou = |name: &str| {
        // BeiDou's seconds start 14 s later; its TGD and issues are its own.
        let [toc, toe] = [sample.toc, sample.toe].map(|t| t + 14.0);
        Ephemeris { toc, toe, iode: 1, iodc: 3, tgd: -4.9e-9, ..other(name) }
    };
    let mut data = NavigationData::default();
    for ephemeris in [
        lnav("G01"),
        Ephemeris { health: 1, fit_interval_flag: true, ..lnav("J02") },
        Ephemeris {
            iodc: 0x345,
            iode: 0x45,
            ura_index: 1,
            tgd: -2.328306436539e-9,
            ..other("E04")
        },
        Ephemeris { iodc: 5, iode: 5, ura_index: 15, health: 0b011, ..other("E18") },
        beidou("C01"),
        beidou("C23"),
    ] {
        data.insert(ephemeris);
    }
    let health = GalileoHealth { e5b_status: 2, e5b_not_valid: true, ..Default::default() };
    let (bgd_e1_e5a, bgd_e1_e5b) = (-1.629814505577e-9, -2.328306436539e-9);
    let status = GalileoStatus { sisa_m: Some(3.12), bgd_e1_e5a, bgd_e1_e5b, health };
    data.galileo.status.insert(sv("E04"), status);
    data.insert_glonass(glonass());
    let read = parse(&write(&data), "x").unwrap();
    assert_eq!((read.skipped, read.left_out.kinds().len()), (0, 0));
    assert!(read.data.iter().eq(data.iter()));
    // A length in km and back.
    let ours = read.data.glonass().next().unwrap();
    assert!((ours.position_m - glonass().position_m).norm() < 1e-8);
    assert!((ours.velocity_mps - glonass().velocity_mps).norm() < 1e-12);
    let (position_m, velocity_mps) = (ours.position_m, ours.velocity_mps);
    let acceleration_mps2 = ours.acceleration_mps2;
    let expected = GlonassEphemeris { position_m, velocity_mps, acceleration_mps2, ..glonass() };
    assert_eq!((ours, read.data.glonass().count()), (&expected, 1));
    assert_eq!(read.data.galileo.status[&sv("E04")], status);
    let e18 = read.data.orbit(sv("E18"), sample.toe).unwrap_err();
    assert_eq!(e18, crate::orbit::NoOrbit::Unhealthy(3));
}

/// One satellite and epoch by both messages: the clocks differ.
#[test]
fn of_galileo_the_records_of_inav_are_taken() {
    let mut data = NavigationData::default();
    let toe = sample_ephemeris().toe;
    data.insert(Ephemeris { sv: sv("E04"), transmission_time: Some(toe), ..sample_ephemeris() });
    let inav = write(&data);
    let source = " 5.130000000000E+02";
    let body = inav.split_once("END OF HEADER       \n").unwrap().1.to_owned();
    // 517: I/NAV of both carriers; 516: of E5b alone; 258: F/NAV; blank: not known.
    for (other, is_taken) in [
        (" 5.170000000000E+02", true),
        (" 5.160000000000E+02", true),
        (" 2.580000000000E+02", false),
        ("                   ", false),
    ] {
        let read = parse(&file("3.04", &body.replace(source, other)), "x").unwrap();
        assert_eq!((read.data.iter().count(), read.skipped), (is_taken.into(), (!is_taken).into()));
    }
    let framed = format!(
        "> EPH E04 INAV\n{body}> EPH E04 FNAV\n{}",
        body.replace(source, " 2.580000000000E+02")
    );
    let read = parse(&file("4.01", &framed), "x").unwrap();
    assert_eq!((read.data.iter().count(), read.skipped), (1, 1));
}

const R02: &str = "R02 2022 01 01 00 15 00-2.340879291296E-05 9.094947017729E-13 1.152000000000E+05
    -4.410207031250E+03-1.357080459595E+00 9.313225746155E-10 0.000000000000E+00
     1.286270947266E+04-2.621530532837E+00 4.656612873077E-09-4.000000000000E+00
     2.164103417969E+04 1.278439521790E+00 0.000000000000E+00 0.000000000000E+00
";

#[test]
fn records_of_glonass_have_four_lines_or_five_and_epochs_in_utc() {
    let fifth = |flags: &str| {
        format!("     0.000000000000E+00 0.000000000000E+00 2.000000000000E+00 {flags}\n")
    };
    let v2 =
        R02.replace("R02 2022 01 01 00 15 00", " 2 22  1  1  0 15  0.0").replace("\n    ", "\n   ");
    let v2_header = format!(
        "{:<60}RINEX VERSION / TYPE\n{:60}END OF HEADER\n",
        "     2.11           G: GLONASS NAV DATA", ""
    );
    for (text, health) in [
        (file("3.04", R02), 0),
        (file("3.05", &(R02.to_owned() + &fifth("0.000000000000E+00"))), 0),
        (file("3.05", &(R02.to_owned() + &fifth("6.000000000000E+00"))), 0),
        (file("3.05", &(R02.to_owned() + &fifth("1.000000000000E+00"))), 8),
        (file("4.00", &format!("> EPH R02 FDMA\n{R02}{}", fifth("0.000000000000E+00"))), 0),
        (v2_header + &v2, 0),
    ] {
        let read = parse(&text, "x").unwrap();
        let [eph] = &read.data.glonass().collect::<Vec<_>>()[..] else { panic!("{text}") };
        // 18 leap seconds.
        assert_eq!(eph.tb, GpsTime::from_calendar(2022, 1, 1, 0, 15, 18.0), "{text}");
        assert_eq!(
            (eph.channel, eph.health, eph.clock_bias_s),
            (Some(-4), health, -2.340879291296e-5)
        );
        let orbit = read.data.orbit(eph.sv, eph.tb + 900.0);
        assert_eq!(orbit.is_ok(), health == 0);
        assert!(read.data.orbit(eph.sv, eph.tb + 1000.0).is_err(), "beyond a quarter of an hour");
        assert_eq!(read.data.frequency_channel(eph.sv), Some(-4));
    }
}

#[test]
fn a_malformed_record_of_a_system_loses_itself() {
    let mut data = NavigationData::default();
    for name in ["E04", "C23", "J02"] {
        data.insert(Ephemeris { sv: sv(name), ..sample_ephemeris() });
    }
    data.insert_glonass(glonass());
    let text = write(&data);
    for (from, to, lost, complaint) in [
        (" 1.286270947266E+04", " 1.286270947266E+02", "R02", "from the Earth's centre"),
        ("-4.000000000000E+00", "         1.0E+00x  ", "R02", "is no number"),
        ("\nC23", "\nC99", "C23", "starts no record"),
        (" 5.130000000000E+02", "         5.1y      ", "E04", "is no number"),
    ] {
        assert!(text.contains(from));
        let read = parse(&text.replacen(from, to, 1), "x").unwrap();
        let left: Vec<Sv> = read.data.satellites().collect();
        let kept: Vec<Sv> = data.satellites().filter(|s| *s != sv(lost)).collect();
        assert_eq!(left, kept);
        let [kind] = read.left_out.kinds() else { panic!("{:?}", read.left_out) };
        assert!(kind.count == 1 && kind.first.contains(complaint), "{}", kind.first);
    }
}
