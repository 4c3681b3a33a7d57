use super::*;
use crate::observation::Observation;
use crate::{GpsTime, signal};
use proptest::prelude::*;

/// A header line: contents in columns 1-60, label in 61-80.
fn labelled(contents: &str, label: &str) -> String {
    format!("{contents:<60}{label}\n")
}

/// Version 2 with ten types (two lines a satellite), labels in odd case.
fn v2_header() -> String {
    [
        labelled("     2.11           Observation         M (MIXED)", "rinex version / type"),
        labelled("ARL1", "MARKER NAME"),
        labelled("  -740289.9180 -5457071.7340  3207245.5420", "APPROX POSITION XYZ"),
        labelled("        0.1000        0.0000        0.2000", "ANTENNA: DELTA H/E/N"),
        labelled(
            "    10    L1    L2    C1    C2    P1    P2    D1    D2    S1",
            "# / Types of Observ",
        ),
        labelled("          S2", "# / TYPES OF OBSERV"),
        labelled("    30.000", "INTERVAL"),
        labelled("", "END OF HEADER"),
    ]
    .concat()
}

const V2_EPOCH: &str =
    " 15  7 19  0  0  0.0000000  0  4G 2R 5 12J 3                        -0.000000005
 -20304412.00716 -16349457.595    21276226.827           0.000    21276226.702
  21276226.580       -1011.373        -788.086          45.770          51.240
 -27322319.697   -21629094.896    20272180.010    20272200.350    20272180.144
  20272181.743         684.793         533.603          46.160          56.190
  -8615680.507 8                                                  23725222.529

 -14766236.143   -13945235.768    22314760.896

";

fn v3_header() -> String {
    [
        labelled("     3.04           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
        labelled(
            "G   17 X1  C1C L1C D1C S1C C2W L2W D2W S2W C2L L2L D2L S2L",
            "SYS / # / OBS TYPES",
        ),
        labelled("       C5Q L5Q D5Q S5Q", "SYS / # / OBS TYPES"),
        labelled("R    1 C1C", "SYS / # / OBS TYPES"),
        labelled("J    4 C1C L1C D1C S1C", "SYS / # / OBS TYPES"),
        labelled("", "END OF HEADER"),
    ]
    .concat()
}

const V3_EPOCH: &str = "> 2024 06 24 08 20 00.0000000  0  3       0.000000000000
G02             0    21276226.827   -20304412.00716     -1011.373          45.770
R05  20272180.010
J02  38000000.000
";

fn read(text: &str) -> Result<Vec<ObservationEpoch>, ReadError> {
    ObservationReader::new(text.as_bytes(), "x.obs")?.collect()
}

fn range(o: &Observation) -> f64 {
    o.pseudorange_m().unwrap()
}

#[test]
fn versions_2_and_3_are_read_field_by_field() {
    let text = (v2_header() + V2_EPOCH).replace('\n', "\r\n");
    let mut reader = ObservationReader::new(text.as_bytes(), "x").unwrap();
    assert_eq!(reader.header().marker, "ARL1");
    assert_eq!(reader.header().interval_s, Some(30.0));
    assert_eq!(reader.header().antenna_uen_m.z, 0.2);
    assert_eq!(reader.header().approximate_position_m.unwrap().z, 3_207_245.542);
    let epoch = reader.next().unwrap().unwrap();
    assert!(reader.next().is_none());
    assert_eq!((reader.skipped(), reader.bytes()), (0, text.len() as u64));
    assert_eq!(epoch.receive_time, GpsTime::from_calendar(2015, 7, 19, 0, 0, 0.0));
    let names: Vec<String> = epoch.observations.iter().map(|o| o.sv().to_string()).collect();
    assert_eq!(names, ["G02", "G12", "J03", "R05"], "a name without letter is of GPS");
    let [first, p_code, last, glonass] = &epoch.observations[..] else { panic!("four") };
    assert_eq!(range(glonass), 20_272_180.010);
    assert_eq!((range(first), first.doppler_hz), (21_276_226.827, Some(-1_011.373)));
    assert_eq!((first.carrier_phase_cycles, first.lost_lock), (Some(-20_304_412.007), true));
    assert_eq!(first.cn0_dbhz, Some(45.77));
    // No C1: P1 in its place; no S1: class 8 is 48 to 53 dB-Hz; no D1.
    assert_eq!((range(p_code), p_code.cn0_dbhz), (23_725_222.529, Some(51.0)));
    assert!(p_code.doppler_hz.is_none() && !p_code.lost_lock);
    assert!(last.cn0_dbhz.is_none() && last.range_sigma_m == typical(42.0));

    let epochs = read(&(v3_header() + V3_EPOCH)).unwrap();
    assert_eq!(epochs[0].receive_time, GpsTime::from_calendar(2024, 6, 24, 8, 20, 0.0));
    let [gps, qzss, glonass] = &epochs[0].observations[..] else { panic!("three") };
    assert_eq!(range(glonass), 20_272_180.010);
    assert_eq!(
        gps,
        &Observation { transmission: signal::of("G02".parse().unwrap()), ..first.clone() }
    );
    assert_eq!((qzss.sv().prn(), range(qzss)), (194, 38e6));
}

#[test]
fn pseudoranges_of_any_signals_are_read_by_name() {
    let next = |text: String, signals: &[&str]| {
        let mut reader = ObservationReader::new(text.as_bytes(), "x").unwrap();
        let epoch = reader.next_pseudoranges(signals).unwrap().unwrap();
        assert_eq!(reader.next_pseudoranges(signals).unwrap(), None);
        let names = epoch.satellites.iter().map(|s| s.0.to_string()).collect::<Vec<_>>();
        (names.join(" "), epoch.satellites.into_iter().map(|s| s.1).collect::<Vec<_>>())
    };
    // C2 of G02 is zero, which means missing; of J03 there is only C1, of G12 none.
    let (names, ranges) = next(v2_header() + V2_EPOCH, &["C1", "C2", "P2"]);
    assert_eq!(names, "G02 J03 R05");
    assert_eq!(ranges[0], [Some(21_276_226.827), None, Some(21_276_226.580)]);
    assert_eq!(ranges[1], [Some(22_314_760.896), None, None]);
    let (names, ranges) = next(v3_header() + V3_EPOCH, &["C5Q", "C1C"]);
    assert_eq!(names, "G02 J02 R05");
    let of_c1c = [21_276_226.827, 38e6, 20_272_180.010];
    assert_eq!(ranges, of_c1c.map(|range_m| [None, Some(range_m)]));
}

#[test]
fn signals_of_all_systems_are_read_by_their_names() {
    let text = [
        labelled("     3.04           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
        labelled("G    3 C1C C1L C5Q", "SYS / # / OBS TYPES"),
        labelled("E    4 C1B C1X D1X C5Q", "SYS / # / OBS TYPES"),
        labelled("C    4 C1I D1I C1P C1D", "SYS / # / OBS TYPES"),
        labelled("R    1 C1C", "SYS / # / OBS TYPES"),
        labelled("S    1 C1C", "SYS / # / OBS TYPES"),
        labelled("  3 R01  1 R02 -4 R24  2", "GLONASS SLOT / FRQ #"),
        labelled("  1 R03 99", "GLONASS SLOT / FRQ #"),
        labelled("", "END OF HEADER"),
        "> 2024 06 24 08 20 00.0000000  0  6\n".to_owned(),
        "G04  21000000.001    21000000.002    21000000.003\n".to_owned(),
        "E11  24000000.001    24000000.002         100.000    24000000.003\n".to_owned(),
        "C23  23000000.001         200.000    23000000.002    23000000.003\n".to_owned(),
        "C40                                                  38000000.003\n".to_owned(),
        "R02  20000000.001\n".to_owned(),
        "S20  38000000.001\n".to_owned(),
    ]
    .concat();
    let mut reader = ObservationReader::new(text.as_bytes(), "x").unwrap();
    let epoch = reader.next().unwrap().unwrap();
    let read = |o: &Observation| (o.sv().to_string(), o.transmission.signal.name, range(o) % 1e6);
    let read: Vec<_> = epoch.observations.iter().map(read).collect();
    let millimetres = |(sv, name, metres): &(String, &'static str, f64)| {
        (sv.clone(), *name, (metres * 1e3).round())
    };
    let expected = [
        ("G04", "GPS L1 C/A", 1.0),
        ("G04", "GPS L1C-P", 2.0),
        ("E11", "Galileo E1-B", 1.0),
        ("E11", "Galileo E1-C", 2.0),
        ("C23", "BeiDou B1C data", 3.0),
        ("C23", "BeiDou B1C pilot", 2.0),
        ("C23", "BeiDou B1I", 1.0),
        ("C40", "BeiDou B1C data", 3.0),
        ("R02", "GLONASS L1OF", 1.0),
    ];
    let expected: Vec<_> = expected.iter().map(|(sv, n, mm)| ((*sv).to_owned(), *n, *mm)).collect();
    assert_eq!(read.iter().map(millimetres).collect::<Vec<_>>(), expected);
    assert_eq!(epoch.observations[3].doppler_hz, Some(100.0));
    // SBAS.
    assert_eq!(reader.skipped(), 1);
    let channels: Vec<i8> = reader.header().glonass_channels.values().copied().collect();
    assert_eq!(channels, [1, -4, 2]);
    assert!(reader.left_out().kinds()[0].first.contains("'R03 99' is no slot"));
}

/// Standard deviation of the code at a C/N0.
fn typical(cn0_dbhz: f64) -> f64 {
    crate::observation::typical_noise(Some(cn0_dbhz)).0
}

#[test]
fn more_than_twelve_satellites_continue_on_further_lines() {
    let header = v2_header().replace(
        "    10    L1    L2    C1    C2    P1    P2    D1    D2    S1",
        "     1    C1                                                ",
    );
    let header = header.replace("          S2", "            ");
    let names: String = (1..=25).map(|n| format!("G{n:02}")).collect();
    let mut text = header + " 15  7 19  0  0  0.0000000  0 25" + &names[..36] + "\n";
    text += &format!("{:32}{}\n{:32}{}\n", "", &names[36..72], "", &names[72..]);
    for n in 1..=25 {
        text += &format!("{:14.3}\n", 2e7 + f64::from(n));
    }
    let epochs = read(&text).unwrap();
    assert_eq!(epochs[0].observations.len(), 25);
    for (k, o) in epochs[0].observations.iter().enumerate() {
        assert_eq!((o.sv().prn() as usize, range(o)), (k + 1, 2e7 + k as f64 + 1.0));
    }
}

#[test]
fn events_comments_and_slips_between_epochs_are_passed_over() {
    let comment = labelled("anything here", "COMMENT");
    let two = v2_header()
        + V2_EPOCH
        + &comment
        // An event whose only line is a comment.
        + &format!("{:28}4  1\n", "")
        + &comment
        + &format!("{:28}4  2\n", "")
        + &labelled("     1    C1", "# / TYPES OF OBSERV")
        + &labelled("moved", "MARKER NAME")
        + "\n 15  7 19  0  0 30.0000000  1  1G 2\n"
        + &comment
        + "  21276226.827\n 15  7 19  0  0 30.0000000  6  1G 2\n\n";
    let epochs = read(&two).unwrap();
    assert_eq!(epochs.len(), 2);
    assert_eq!((epochs[1].sample, epochs[1].observations.len()), (30.0, 1));
    assert!(epochs[1].observations[0].lost_lock, "power failed before");

    let three = v3_header()
        + ">                              4  1\n"
        + &labelled("G    2 D1C C1C", "SYS / # / OBS TYPES")
        + "> 2024 06 24 08 20 00.0000000  0  1\nG02     -1011.373    21276226.827\n";
    let epochs = read(&three).unwrap();
    assert_eq!(range(&epochs[0].observations[0]), 21_276_226.827);
}

#[test]
fn times_of_other_systems_become_gps_time() {
    let expected = GpsTime::from_calendar(2024, 6, 24, 8, 20, 0.0);
    for (system, shift) in [("GPS", 0.0), ("GLO", 18.0), ("BDT", 14.0), ("GAL", 0.0)] {
        let line = format!("  2024     6    24     8    20    0.0000000     {system}");
        let header = v3_header()
            .replace(&labelled("", "END OF HEADER"), &labelled(&line, "TIME OF FIRST OBS"))
            + &labelled("", "END OF HEADER");
        let epochs = read(&(header + V3_EPOCH)).unwrap();
        assert_eq!(epochs[0].receive_time - expected, shift, "{system}");
    }
}

#[test]
fn each_mistake_is_named_with_its_line_and_what_would_be_right() {
    let (two, three) = (v2_header() + V2_EPOCH, v3_header() + V3_EPOCH);
    let cut: String = two.lines().take(11).map(|l| format!("{l}\n")).collect();
    let compact = labelled("2.0                 COMPACT RINEX FORMAT", "CRINEX VERS   / TYPE");
    let cases = [
        (String::new(), "line 1: this is no RINEX file; a RINEX file starts with"),
        (compact, "line 1: version '2.0' of compact RINEX; versions 1 and 3 are read"),
        ("\u{1f}\u{8b}".to_owned(), "line 1: this is no RINEX file"),
        (three.replace("     3.04", "     7.00"), "line 1: version 7 is not known"),
        (three.replace("OBSERVATION", "NAVIGATION "), "line 1: the file holds 'NAVIGATION  DATA'"),
        (
            three.replace("END OF HEADER", "END OF"),
            "line 7: an epoch follows the header; 'END OF HEADER' stands before",
        ),
        (two.replace("Types of Observ", "Types of"), "line 5: '# / TYPES OF' is no label"),
        (two.replace("    10    L1", "   ten    L1"), "line 5: 'ten' is no number of types"),
        (three.replace("> 2024", "  2024"), "line 7: '2024 06 24 08 20 0' starts no epoch"),
        (three.replace("2024 06 24", "2024 13 24"), "line 7: '2024 13 24"),
        (three.replace("  0  3  ", "  0  x  "), "line 7: 'x' in columns 33 to 35 is no whole"),
        (three.replace("  0  3  ", "  7  3  "), "line 7: the epoch flag 7 is not known"),
        (three.replace("  0  3  ", "  0  4  "), "the file ends in the middle of a record"),
        (three.replace("G02   ", "X02   "), "line 8: 'X02' names no satellite"),
        (three.replace("G02   ", "G77   "), "line 8: 'G77' names no satellite"),
        (three.replace("45.770", "45,770"), "line 8: '45,770' in columns 68 to 81 is no number"),
        (two.replace("45.770", "45,770"), "line 11: '45,770' in columns 49 to 62 is no number"),
        (cut, "the file ends in the middle of a record; the observations of the epoch follow"),
    ];
    for (text, message) in cases {
        let error = complaint(&text);
        assert!(error.starts_with("reading RINEX x.obs, line"), "{error}");
        assert!(error.contains(message), "'{error}' should contain '{message}'");
    }
    let missing = open("no/such/file").err().unwrap().to_string();
    assert!(missing.starts_with("reading the RINEX file no/such/file: "), "{missing}");
}

/// The first complaint about a text: its error, or what was left out.
fn complaint(text: &str) -> String {
    let mut reader = match ObservationReader::new(text.as_bytes(), "x.obs") {
        Ok(reader) => reader,
        Err(error) => return error.to_string(),
    };
    let errors: Vec<String> =
        reader.by_ref().filter_map(|epoch| epoch.err()).map(|error| error.to_string()).collect();
    match reader.left_out().kinds() {
        [] => errors[0].clone(),
        [kind, ..] => kind.first.clone(),
    }
}

/// What is read, and how much of what kind was left out.
fn sums(text: &str) -> (usize, usize, Vec<(&'static str, usize)>) {
    let mut reader = ObservationReader::new(text.as_bytes(), "x").unwrap();
    let epochs: Vec<ObservationEpoch> = reader.by_ref().map(Result::unwrap).collect();
    let left_out = reader.left_out().kinds().iter().map(|kind| (kind.what, kind.count));
    (epochs.len(), epochs.iter().map(|e| e.observations.len()).sum(), left_out.collect())
}

#[test]
fn a_malformed_record_loses_itself_and_files_may_follow_each_other() {
    let (two, three) = (v2_header() + V2_EPOCH, v3_header() + V3_EPOCH);
    let (of_two, of_three) = (sums(&two), sums(&three));
    let double =
        |(epochs, satellites, _): &(usize, usize, Vec<_>)| (2 * epochs, 2 * satellites, vec![]);
    assert_eq!(sums(&(two.clone() + &two)), double(&of_two));
    assert_eq!(sums(&(three.clone() + &three)), double(&of_three));
    for odd in [three.replace('\n', "\r"), format!("\u{feff}\n{three}\u{1a}\0\0")] {
        assert_eq!(sums(&odd), of_three);
    }
    let again = three.replace("> 2024", "> 20x4") + V3_EPOCH;
    let (epochs, satellites, left_out) = sums(&again);
    assert_eq!((epochs, satellites), (1, of_three.1));
    assert_eq!(left_out, [("epochs left out", 1)]);
    // One satellite fewer than the epoch says, one that does not exist, a number that is none.
    for (from, to, fewer, what) in [
        ("  0  3  ", "  0  4  ", 0, "epochs miscounted"),
        ("G02   ", "G77   ", 1, "satellites left out"),
        ("45.770", "45,770", 1, "satellites left out"),
    ] {
        let text = three.replacen(from, to, 1) + V3_EPOCH;
        assert_eq!(sums(&text), (2, 2 * of_three.1 - fewer, vec![(what, 1)]), "{to}");
    }
    // The file ends within a number.
    let at = three.find("21276226.827").expect("a range") + 6;
    let epochs = read(&three[..at]).unwrap();
    assert!(epochs.iter().flat_map(|e| &e.observations).all(|o| o.range.is_none()));
}

#[test]
fn stored_values_are_divided_by_their_factor_and_ranges_may_be_negative() {
    let factor = labelled("G  100  1 C1C", "SYS / SCALE FACTOR");
    let end = labelled("", "END OF HEADER");
    let text = v3_header().replace(&end, &(factor + &end)) + V3_EPOCH;
    let plain = read(&(v3_header() + V3_EPOCH)).unwrap();
    let scaled = read(&text.replace("   21276226.827", "  -21276226.827")).unwrap();
    let (plain, scaled) = (&plain[0].observations[0], &scaled[0].observations[0]);
    assert_eq!(range(scaled), -range(plain) / 100.0);
    assert_eq!(scaled.doppler_hz, plain.doppler_hz);
}

proptest! {
    #[test]
    fn mutilated_files_never_panic(at in 0usize..1400, with in ".{0,30}", version in 2..5, cut in 0usize..1500) {
        for (text, is) in [(v2_header() + V2_EPOCH, "     2.11 "), (v3_header() + V3_EPOCH, "     3.04 ")] {
            let mut text = text.replacen(is, &format!("     {version}.0 "), 1);
            let at = at.min(text.len());
            let to = (at + with.len()).min(text.len());
            text.replace_range(at..to, &with);
            let _ = read(&text);
            let _ = read(text.get(..cut).unwrap_or(&text));
        }
    }
}
