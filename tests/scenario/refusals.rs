//! Errors in scenarios and the messages about them.

use crate::common::Tested;
use sdr_rx::scenario::{Scenario, ScenarioSource};

const GOOD: &str = r#"start = "2190:525600"
duration_s = 0.01
elevation_mask_deg = 5.0
[orbits.walker]
pattern = "24/6/1"
[receiver]
position.geodetic = { latitude_deg = 48.0, longitude_deg = 11.0, height_m = 500.0 }
motion = "static"
clock_offset_s = 0.0
clock_drift_ppm = 0.0
[signal]
cn0_dbhz = 45.0
fading = []
[atmosphere]
ionosphere = "none"
[noise]
background_variance = 1.0
impulse_share = 0.0
impulse_variance_ratio = 1.0
[front_end]
rate_hz = 2.6e6
if_hz = 0.0
bits = 8
"#;

/// Text, its replacement, required text of the message, and its position (a line, where there is one).
const CASES: &[(&str, &str, &str, &str)] = &[
    (
        "geodetic = { latitude_deg = 48.0, longitude_deg = 11.0, height_m = 500.0 }",
        "ecef_m = [1.0, 2.0, 3.0]",
        "no position of an antenna",
        "",
    ),
    (
        "motion = \"static\"",
        "motion.straight = { velocity_enu_mps = [nan, 0.0, 0.0] }",
        "-10000 to 10000 m/s",
        "",
    ),
    ("fading = []", "fading = [[0.0, inf]]", "must be finite", ""),
    ("if_hz = 0.0", "dc_offset = [nan, 0.0]", "dc_offset must be", ""),
    ("duration_s = 0.01", "duration_s = -1.0", "above 0", "line 2"),
    ("duration_s = 0.01", "duration_s = 0.0", "above 0", "line 2"),
    ("duration_s = 0.01", "duration_s = nan", "above 0", "line 2"),
    ("duration_s = 0.01", "", "missing field `duration_s`", ""),
    ("duration_s = 0.01", "duration = 1.0", "unknown field `duration`", "line 2"),
    ("2190:525600", "yesterday", "'yesterday' is no time", "line 1"),
    ("2190:525600", "2190:700000", "is no time", "line 1"),
    ("elevation_mask_deg = 5.0", "elevation_mask_deg = 100.0", "-90 to 90 degrees", "line 3"),
    ("elevation_mask_deg = 5.0", "elevation_mask_deg = 89.9", "no satellite is above 89.9", ""),
    ("elevation_mask_deg = 5.0", "satellites = [\"G99\"]", "'G99' names no satellite", "line 3"),
    (
        "elevation_mask_deg = 5.0",
        "satellites = [\"G30\"]",
        "no ephemeris of G30: the orbits hold G01",
        "",
    ),
    ("elevation_mask_deg = 5.0", "satellites = [\"G01\", \"G01\"]", "G01 is listed twice", ""),
    ("elevation_mask_deg = 5.0", "satellites = [\"G03\"]", "G03 is at an elevation of -", ""),
    ("elevation_mask_deg = 5.0", "satellites = []", "no satellite", ""),
    ("[orbits.walker]", "[orbits.keppler]", "unknown variant `keppler`", "line 4"),
    ("24/6/1", "24/5/1", "no Walker pattern", "line 5"),
    ("24/6/1", "40/7/1", "no Walker pattern", "line 5"),
    ("pattern = \"24/6/1\"", "pattern = \"24/6/1\"\nsemi_major_axis_km = 80000.0", "sqrt A", ""),
    ("latitude_deg = 48.0", "latitude_deg = 148.0", "-90 to 90 degrees", "line 7"),
    ("height_m = 500.0", "height = 500.0", "unexpected keys in table: height", "line 7"),
    ("\"static\"", "\"walking\"", "unknown variant `walking`", "line 8"),
    (
        "motion = \"static\"",
        "motion.circle = { radius_m = 0.0, speed_mps = 1.0 }",
        "above 0",
        "line 8",
    ),
    (
        "motion = \"static\"",
        "motion.circle = { radius_m = 1.0, speed_mps = 99.0 }",
        "9801 m/s^2",
        "",
    ),
    ("clock_offset_s = 0.0", "clock_offset_s = inf", "finite", "line 9"),
    ("clock_drift_ppm = 0.0", "clock_drift_ppm = 5000.0", "-1000 to 1000 ppm", "line 10"),
    ("cn0_dbhz = 45.0", "cn0_dbhz = 450.0", "0 to 90 dB-Hz", "line 12"),
    ("cn0_dbhz = 45.0", "cn0_by_satellite = { G01 = -3.0 }", "G01 = -3 must be 0 to 90", ""),
    ("fading = []", "fading = [[1.0, 0.0], [0.0, 0.0]]", "times must increase", ""),
    ("ionosphere = \"none\"", "ionosphere = \"klobuchar\"", "needs coefficients", ""),
    ("impulse_share = 0.0", "impulse_share = 1.5", "1.5 must be a number from 0 to 1", "line 18"),
    ("impulse_share = 0.0", "impulse_share = -0.1", "a number from 0 to 1", "line 18"),
    ("variance_ratio = 1.0", "variance_ratio = 0.0", "above 0", "line 19"),
    ("background_variance = 1.0", "background_variance = -1.0", "above 0", "line 17"),
    ("rate_hz = 2.6e6", "rate_hz = 2.6", "1e6 to 1e9 samples", "line 21"),
    ("if_hz = 0.0", "if_hz = 1.4e6", "outside the samples'", ""),
    ("if_hz = 0.0", "real = true", "set bandwidth_hz and if_hz", ""),
    ("if_hz = 0.0", "bandwidth_hz = 3e6", "exceeds rate_hz", ""),
    ("bits = 8", "bits = 5", "5 bits: write 1, 2, 3, 4, 8 or 16", "line 23"),
    ("[front_end]", "[frontend]", "unknown field `frontend`", "line 20"),
    ("[signal]", "[signal", "unclosed table", "line 11"),
    ("[signal]", "[array]\n[signal]", "give one of elements_m, linear", "line 11"),
    ("[signal]", "[array]\nlinear = { count = 0 }\n[signal]", "must be 1 to 1024", "line 11"),
    ("[signal]", "[array]\nlinear = { many = 2 }\n[signal]", "unknown field `many`", "line 12"),
    ("[signal]", "[array]\nline = 1\n[signal]", "unknown field `line`", "line 12"),
    ("[signal]", "[[jammer]]\nkind = \"hum\"\n[signal]", "unknown variant `hum`", "line 12"),
    ("[signal]", "[[jammer]]\nkind = \"cw\"\npower_db = 1e9\n[signal]", "150 dB", "line 13"),
    ("[signal]", "[[jammer]]\nkind = \"cw\"\npower_db = 10\n[signal]", "`direction`", "line 11"),
    (
        "[signal]",
        "[[jammer]]\nkind = \"cw\"\npower_db = 10\ndirection.cone_deg = 10\n[signal]",
        "[[jammer]] 1: direction.cone_deg needs an [array] whose elements lie on a line",
        "",
    ),
    (
        "[signal]",
        "[[jammer]]\nkind = \"cw\"\npower_db = 10\nfrequency_hz = 2e6\n\
         direction.sky = { azimuth_deg = 0, elevation_deg = 0 }\n[signal]",
        "frequencies up to 2000000 Hz lie outside",
        "",
    ),
    (
        "[signal]",
        "[[jammer]]\nkind = \"noise\"\npower_db = 10\nstart_s = 2\nstop_s = 1\n\
         direction.sky = { azimuth_deg = 0, elevation_deg = 0 }\n[signal]",
        "stop_s 1 must come after start_s 2",
        "",
    ),
    ("[signal]", "[spoofer]\ndirection.cone_deg = 100\n[signal]", "-90 to 90", "line 12"),
    (
        "[signal]",
        "[spoofer]\nsatellites = [\"G32\"]\n\
         direction.sky = { azimuth_deg = 0, elevation_deg = 0 }\n[signal]",
        "G32 is not among the satellites simulated: G01",
        "",
    ),
];

#[test]
fn each_wrong_value_is_refused_with_its_reason_and_line() -> Tested {
    ScenarioSource::new(&Scenario::parse(GOOD, "good.toml")?)?;
    let mut wrongly = Vec::new();
    for (right, wrong, reason, line) in CASES {
        assert!(GOOD.contains(right), "{right}");
        let text = GOOD.replacen(right, wrong, 1);
        let result = Scenario::parse(&text, "bad.toml").and_then(|s| ScenarioSource::new(&s));
        let message = result.err().map_or("accepted".to_owned(), |e| e.to_string());
        if !(message.contains(reason) && message.contains(line)) {
            wrongly.push(format!("{wrong}: {message}"));
        }
    }
    assert!(wrongly.is_empty(), "{}", wrongly.join("\n"));
    Ok(())
}

#[test]
fn the_command_refuses_with_exit_code_2_and_leaves_no_file() -> Tested {
    let folder = tempfile::tempdir()?;
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("good.toml"), GOOD)?;
    let orbits = "[orbits]\nnavigation_file = \"none.22n\"";
    std::fs::write(
        path("nav.toml"),
        GOOD.replace("[orbits.walker]\npattern = \"24/6/1\"", orbits),
    )?;
    let run = |arguments: &[&str]| {
        let mut command = assert_cmd::Command::cargo_bin("sdr-rx").expect("built");
        command.current_dir(folder.path()).arg("simulate").args(arguments).assert()
    };
    for (arguments, reason) in [
        (&["good.toml", "--out", "x.wav"][..], "must end in .sigmf-meta"),
        (&["good.toml", "--out", "x.cs8", "--duration", "-3"], "must be above 0"),
        (&["good.toml", "--out", "no/such/x.cs8"], "writing 'no/such/x.cs8'"),
        (&["none.toml", "--out", "x.cs8"], "reading scenario 'none.toml'"),
        (&["nav.toml", "--out", "x.cs8"], "none.22n"),
        (&["good.toml"], "--out"),
    ] {
        let error = run(arguments).code(2).stdout("").get_output().stderr.clone();
        let error = String::from_utf8(error)?;
        assert!(error.contains(reason), "{arguments:?}: {error}");
    }
    assert_eq!(std::fs::read_dir(folder.path())?.count(), 2);

    run(&["good.toml", "--out", "x.sigmf-meta"]).code(0).stdout("").stderr("");
    run(&["good.toml", "--out", "x.cs8"]).code(0);
    run(&["good.toml", "--out", "x.b1"]).code(0);
    let pipe = run(&["good.toml", "--out", "-"]).code(0).get_output().stdout.clone();
    let bytes = std::fs::read(path("x.sigmf-data"))?;
    assert_eq!(bytes.len(), 52_000);
    assert!(bytes == std::fs::read(path("x.cs8"))? && bytes == pipe);
    let ones = std::fs::read(path("x.b1"))?;
    let bits = bytes.chunks_exact(8).map(|c| c.iter().fold(0, |b, &x| b << 1 | x >> 7));
    assert!(bits.eq(ones));
    let truth: serde_json::Value = serde_json::from_slice(&std::fs::read(path("x.truth.json"))?)?;
    assert_eq!(truth["epochs"][0]["gps_week"], 2190);
    assert_eq!(truth["scenario"]["seed"], 0);
    let navigation = sdr_rx::gnss::format::rinex_nav::read(path("x.nav.rnx"))?.data;
    // Twelve digits of a file: 1e-12 of an orbit's radius, and of an angle times that radius, 3e-5 m each.
    let scenario = Scenario::parse(GOOD, "good.toml")?;
    for eph in scenario.navigation()?.iter() {
        let read = navigation.ephemeris(eph.sv, scenario.start).ok_or("a satellite is missing")?;
        let (ours, file) = (eph.state(scenario.start), read.state(scenario.start));
        assert!((ours.position_m - file.position_m).norm() < 1e-3, "{}", eph.sv);
    }
    Ok(())
}
