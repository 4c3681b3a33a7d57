use super::*;
use crate::{Ephemeris, GpsTime};
use proptest::prelude::*;

/// A header line: contents in columns 1-60, label in 61-80.
fn labelled(contents: &str, label: &str) -> String {
    format!("{contents:<60}{label}\n")
}

fn v2_header() -> String {
    [
        labelled("     2.11           NAVIGATION DATA", "rinex version / type"),
        labelled("    0.1211D-07 -0.7451D-08 -0.5960D-07  0.1192D-06", "ION ALPHA"),
        labelled("    0.1167D+06 -0.2458D+06 -0.6554D+05  0.1114D+07", "ION BETA"),
        labelled(
            "    0.279396772385D-08 0.799360577730D-14   147456     2191",
            "DELTA-UTC: A0,A1,T,W",
        ),
        labelled("    18", "LEAP SECONDS"),
        labelled("", "END OF HEADER"),
    ]
    .concat()
}

/// G01 of 2022-01-01T00:00 as an IGS broadcast file prints it.
const G01_V2: &str =
    " 1 22  1  1  0  0  0.0 0.469126738608D-03-0.100044417195D-10 0.000000000000D+00
    0.390000000000D+02-0.141125000000D+03 0.398838041777D-08-0.624294238235D+00
   -0.736303627491D-05 0.112181392033D-01 0.469572842121D-05 0.515367499542D+04
    0.518400000000D+06-0.316649675369D-07-0.103661124009D+01 0.195577740669D-06
    0.986418769490D+00 0.299750000000D+03 0.884087601569D+00-0.813355308085D-08
   -0.377872882780D-09 0.100000000000D+01 0.219000000000D+04 0.000000000000D+00
    0.200000000000D+01 0.000000000000D+00 0.512227416039D-08 0.390000000000D+02
    0.511218000000D+06 0.400000000000D+01 0.000000000000D+00 0.000000000000D+00
";

/// The same record as versions 3 and 4 print it: one column further right, four-digit year.
fn g01_v3() -> String {
    let mut lines = G01_V2.lines();
    let first = lines.next().unwrap();
    let mut text = format!("G01 2022 01 01 00 00 00{}\n", &first[22..]);
    lines.for_each(|line| text += &format!(" {line}\n"));
    text
}

fn expected() -> Ephemeris {
    let sent = GpsTime::from_week_tow(2190, 511_218.0);
    Ephemeris { transmission_time: Some(sent), ..crate::orbit::broadcast::sample_ephemeris() }
}

fn only(file: &NavigationFile) -> &Ephemeris {
    assert_eq!(file.data.iter().count(), 1);
    file.data.iter().next().unwrap()
}

#[test]
fn the_same_record_reads_alike_from_versions_2_3_and_4() {
    let v2 = parse(&(v2_header() + G01_V2), "v2").unwrap();
    assert_eq!(only(&v2), &expected());
    assert_eq!(v2.data.ionosphere.unwrap().beta, [1.167e5, -2.458e5, -6.554e4, 1.114e6]);
    let utc = v2.data.utc.unwrap();
    assert_eq!((utc.a0, utc.a1), (0.279396772385e-8, 0.799360577730e-14));
    assert_eq!(
        (utc.tot, utc.delta_t_ls, utc.delta_t_lsf),
        (GpsTime::from_week_tow(2191, 147_456.0), 18, 18)
    );

    let v3_header = [
        labelled("     3.05           N: GNSS NAV DATA    M: MIXED", "RINEX VERSION / TYPE"),
        labelled("GPSA   1.2110E-08 -7.4510E-09 -5.9600E-08  1.1920E-07", "IONOSPHERIC CORR"),
        labelled("GPSB   1.1670E+05 -2.4580E+05 -6.5540E+04  1.1140E+06", "IONOSPHERIC CORR"),
        labelled("GPUT  2.7939677239E-09 7.993605777E-15 147456 2191", "TIME SYSTEM CORR"),
        labelled("    18    19  2200     7", "LEAP SECONDS"),
        labelled("", "END OF HEADER"),
    ]
    .concat();
    let sbas =
        "S20 2022 01 01 00 15 00 1.0E-04 0.0 0.0\n     1.0 2.0 3.0 4.0\n     1.0\n     1.0\n";
    let v3 = parse(&(v3_header.clone() + sbas + &g01_v3()).replace('\n', "\r\n"), "v3").unwrap();
    assert_eq!((only(&v3), v3.skipped), (&expected(), 1));
    assert_eq!(v3.data.ionosphere, v2.data.ionosphere);
    let utc = v3.data.utc.unwrap();
    assert_eq!((utc.delta_t_lsf, utc.wn_lsf, utc.day), (19, 2200, 7));

    let v4 = [
        labelled("     4.01           N: GNSS NAV DATA    M: MIXED", "RINEX VERSION / TYPE"),
        labelled("    18", "LEAP SECONDS"),
        labelled("", "END OF HEADER"),
        "> STO G01 LNAV\n    2022 01 02 16 57 36 GPUT\n".to_owned(),
        "     5.112180000000E+05 2.793967723850E-09 7.993605777300E-15 0.000000000000E+00\n".to_owned(),
        "> EPH G01 CNAV\nG01 2022 01 01 00 00 00 1.0E-04 0.0 0.0\n     1.0\n".to_owned(),
        format!("> EPH G01 LNAV\n{}", g01_v3()),
        "> ION G01 LNAV\n    2022 01 01 02 00 00 1.211000000000E-08-7.451000000000E-09-5.960000000000E-08\n".to_owned(),
        "     1.192000000000E-07 1.167000000000E+05-2.458000000000E+05-6.554000000000E+04\n".to_owned(),
        "     1.114000000000E+06 0.000000000000E+00\n".to_owned(),
    ]
    .concat();
    let v4 = parse(&v4, "v4").unwrap();
    assert_eq!((only(&v4), v4.skipped), (&expected(), 1));
    assert_eq!(v4.data.ionosphere, v2.data.ionosphere);
    assert_eq!(v4.data.utc.unwrap().tot, GpsTime::from_week_tow(2191, 60_000.0 + 1056.0));
}

#[test]
fn files_in_the_wild_are_tolerated() {
    // Blank optional fields and no last line.
    let cut: String = G01_V2.lines().take(7).map(|l| format!("{l}\n")).collect();
    let eph = parse(&(v2_header() + &cut), "cut").unwrap();
    assert_eq!((only(&eph).transmission_time, only(&eph).fit_interval_flag), (None, false));
    // Fit interval as hours or as the flag; transmission time of the week before; no leap seconds.
    let odd = (v2_header() + G01_V2)
        .replace("0.400000000000D+01 0.000000000000D+00 0.000000000000D+00", "1.0")
        .replace(" 0.511218000000D+06", "-0.600000000000D+02")
        .replace("    18 ", "       ");
    let odd = parse(&odd, "odd").unwrap();
    assert!(only(&odd).fit_interval_flag);
    // -60 s of the week of toe is nearest half a week or more away: 518400 - 604740 = 86 340 s.
    assert_eq!(only(&odd).transmission_time, Some(GpsTime::from_week_tow(2191, -60.0)));
    assert_eq!(odd.data.utc.unwrap().delta_t_ls, 18, "from the built-in table");
    // toe in the week after its clock epoch.
    let crossover = (v2_header() + G01_V2)
        .replace(" 1 22  1  1  0  0  0.0", " 1 22  1  1 23 59 44.0")
        .replace("0.518400000000D+06", "0.000000000000D+00");
    let eph = parse(&crossover, "crossover").unwrap();
    assert_eq!(only(&eph).toe, GpsTime::from_week_tow(2191, 0.0));
    assert_eq!(only(&eph).toc, GpsTime::from_week_tow(2190, 604_784.0));
}

#[test]
fn each_mistake_is_named_with_its_line_and_what_would_be_right() {
    let good = v2_header() + G01_V2;
    let edit = |from: &str, to: &str| {
        let text = good.replacen(from, to, 1);
        assert_ne!(text, good, "'{from}' must occur");
        text
    };
    let cases = [
        (String::new(), "line 1: this is no RINEX file; a RINEX file starts with"),
        ("hello\n".to_owned(), "line 1: this is no RINEX file"),
        (
            edit("NAVIGATION DATA ", "OBSERVATION DATA"),
            "line 1: the file holds 'OBSERVATION DATA'; a navigation file has N",
        ),
        (edit("     2.11 ", "     9.00 "), "line 1: version 9 is not known; versions 2.10 to"),
        (
            edit("END OF HEADER", "END OF HAEDER"),
            "line 7: a record follows the header; 'END OF HEADER' stands before it",
        ),
        (edit("0.1211D-07", "0.12x1D-07"), "line 2: '0.12x1D-07' in columns 3 to 14 is no number"),
        (edit("  0.1192D-06", "            "), "line 2: a coefficient is missing"),
        (edit("    18", "    eighteen"), "line 5: 'eighteen' is no count of leap seconds"),
        (edit(" 1 22  1  1", "33 22  1  1"), "line 7: '33 2' starts no record"),
        (edit(" 1 22  1  1", " 1 22 13  1"), "line 7: '22 13  1  0  0  0.0' is no date"),
        (edit(" 1 22  1  1", " 1 22  a  1"), "line 7: 'a' in columns 6 to 8 is no whole number"),
        (
            edit("0.390000000000D+02-0", "0.999000000000D+03-0"),
            "line 8: IODE of G01 is 9.99e2; it lies in 0e0 to 2.55e2",
        ),
        (edit("0.515367499542D+04", "0.000000000000D+00"), "line 9: sqrt(A) of G01 is 0e0"),
        (
            edit("0.112181392033D-01", "              NaN "),
            "line 9: 'NaN' in columns 23 to 41 is no number",
        ),
        (edit("-0.103661124009D+01", "                   "), "line 10: OMEGA0 of G01 is blank"),
        (
            edit("0.219000000000D+04", "0.100000000000D+04"),
            "line 12: week 1000 of G01 does not go with its epoch, in week 2190",
        ),
        (
            good.lines().take(9).map(|l| format!("{l}\n")).collect(),
            "line 9: the record of G01 ends after 3 lines, before toe",
        ),
    ];
    for (text, message) in cases {
        let error = complaint(&text);
        assert!(error.starts_with("reading RINEX brdc.22n, line"), "{error}");
        assert!(error.contains(message), "'{error}' should contain '{message}'");
    }
    let v4 = labelled("     4.00           N: GNSS NAV DATA", "RINEX VERSION / TYPE")
        + &labelled("", "END OF HEADER")
        + &g01_v3();
    assert!(complaint(&v4).contains("starts as in '> EPH G01 LNAV'"));
    assert!(
        read("no/such/file")
            .unwrap_err()
            .to_string()
            .starts_with("reading the RINEX file no/such/file: ")
    );
}

/// The first complaint about a text: its error, or what was left out.
fn complaint(text: &str) -> String {
    match parse(text, "brdc.22n") {
        Err(error) => error.to_string(),
        Ok(file) => file.left_out.kinds()[0].first.clone(),
    }
}

#[test]
fn a_malformed_record_loses_itself_and_files_may_follow_each_other() {
    let bad = G01_V2.replacen(" 1 22", " 2 22", 1).replacen("0.515367499542D+04", "0.0", 1);
    let good = G01_V2.replacen(" 1 22", " 3 22", 1);
    let comment = labelled("between", "COMMENT");
    let text =
        format!("\u{feff}\n{}{G01_V2}{bad}{comment}{}{good}\u{1a}\0\0", v2_header(), v2_header());
    for text in [text.clone(), text.replace('\n', "\r"), text.replace('\n', "\r\n")] {
        let file = parse(&text, "x").unwrap();
        let satellites: Vec<String> = file.data.satellites().map(|sv| sv.to_string()).collect();
        assert_eq!(satellites, ["G01", "G03"]);
        let [kind] = file.left_out.kinds() else { panic!("{:?}", file.left_out) };
        assert_eq!((kind.what, kind.count), ("records left out", 1));
        assert!(kind.first.contains("sqrt(A) of G02"), "{}", kind.first);
        assert!(file.data.ionosphere.is_some() && file.data.utc.is_some());
    }
    assert!(parse(&(v2_header() + &bad), "x").unwrap_err().to_string().contains("sqrt(A)"));
}

/// Exponents of twelve digits after the point keep no more than 5e-13 of a value.
#[test]
fn ephemerides_of_galileo_are_written_and_read_back_and_those_of_fnav_are_left_out() {
    let sv = "E11".parse().unwrap();
    let sample = crate::orbit::broadcast::sample_ephemeris();
    let ephemeris = Ephemeris {
        sv,
        iodc: 777,
        iode: (777 & 0xFF) as u8,
        health: 0b010,
        l2_codes: 0,
        l2_p_data: false,
        fit_interval_flag: false,
        ..sample
    };
    let mut data = NavigationData::default();
    data.insert(ephemeris.clone());
    let t0 = crate::GpsTime::from_week_tow(2190, 518_400.0);
    let offset = crate::galileo_data::GalileoGpsOffset { a0: 2e-8, a1: -1e-15, t0 };
    data.galileo.gps_offset = Some(offset);
    let text = write(&data);
    let back = parse(&text, "written").unwrap();
    let read = only(&back);
    assert_eq!((read.sv, read.iodc, read.iode, read.health), (sv, 777, ephemeris.iode, 0b010));
    assert_eq!((read.toe, read.toc), (ephemeris.toe, ephemeris.toc));
    for (a, b) in
        [(read.tgd, ephemeris.tgd), (read.sqrt_a, ephemeris.sqrt_a), (read.af0, ephemeris.af0)]
    {
        assert!((a - b).abs() <= 5e-13 * b.abs(), "{a} {b}");
    }
    let read_offset = back.data.galileo.gps_offset.unwrap();
    assert!((read_offset.a0 - 2e-8).abs() < 1e-18 && read_offset.t0 == t0);
    // Data source 258: F/NAV of E5a, clock of E1 and E5a.
    let fnav = text.replace("5.130000000000E+02", "2.580000000000E+02");
    assert_ne!(fnav, text);
    let left = parse(&fnav, "fnav").unwrap();
    assert_eq!((left.data.iter().count(), left.skipped), (0, 1));
}

proptest! {
    #[test]
    fn mutilated_files_never_panic(at in 0usize..1400, with in ".{0,30}", version in 2..5, cut in 0usize..1500) {
        let version = format!("     {version}.0 ");
        let mut text = (v2_header() + G01_V2 + &g01_v3()).replacen("     2.11 ", &version, 1);
        let at = at.min(text.len());
        let to = (at + with.len()).min(text.len());
        text.replace_range(at..to, &with);
        let _ = parse(&text, "x");
        let _ = parse(text.get(..cut).unwrap_or(&text), "x");
    }
}
