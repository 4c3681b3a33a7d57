//! The 45 s capture of the independent simulator: cold, from the signals alone.

use crate::common::{Failed, Tested, data, data_and};
use crate::program::{Answer, file, median, run, vector};
use nalgebra::Vector3;
use sdr_rx::gnss::Ephemeris;
use sdr_rx::gnss::constants::GPS_PI;
use sdr_rx::gnss::format::rinex_nav;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

const PLACE: Vector3<f64> = Vector3::new(-3_959_617.5, 3_350_136.6, 3_699_531.5);
const SATELLITES: [&str; 10] =
    ["G10", "G12", "G13", "G15", "G18", "G19", "G23", "G24", "G25", "G32"];

/// The record of a run, and the files it wrote.
struct Run {
    answer: Answer,
    files: BTreeMap<String, Vec<u8>>,
}

/// One run on one thread and one on two, made once for all tests.
fn runs() -> Result<&'static [Run; 2], Failed> {
    static RUNS: OnceLock<Result<[Run; 2], String>> = OnceLock::new();
    let make = |threads| -> Result<Run, Failed> {
        let data = data().ok_or("no data")?;
        let capture = file(data, "captures/sim_tokyo_2.6MHz_45s_1bit.bin");
        let folder = tempfile::tempdir()?;
        let out = folder.path().join("out");
        let out_name = out.display().to_string();
        let arguments = ["process", &capture, "-f", "b1", "-r", "2.6M", "--troposphere", "none"];
        let others = ["--threads", threads, "--out", &out_name, "--report"];
        let answer = run(&[&arguments[..], &others].concat())?;
        let mut files = BTreeMap::new();
        for entry in std::fs::read_dir(&out)? {
            let entry = entry?;
            files.insert(
                entry.file_name().to_string_lossy().into_owned(),
                std::fs::read(entry.path())?,
            );
        }
        Ok(Run { answer, files })
    };
    let both = || -> Result<_, Failed> { Ok([make("1")?, make("2")?]) };
    let runs = RUNS.get_or_init(|| both().map_err(|e| e.to_string()));
    runs.as_ref().map_err(|e| e.as_str().into())
}

impl Run {
    /// Writes the files whose names end like this into a folder, for another program.
    fn unpack(&self, folder: &Path, end: &str) -> Result<PathBuf, Failed> {
        let (name, bytes) = self.files.iter().find(|f| f.0.ends_with(end)).ok_or("no such file")?;
        let path = folder.join(name);
        std::fs::write(&path, bytes)?;
        Ok(path)
    }
}

#[test]
fn a_cold_start_gives_the_position() -> Tested {
    let Some(_) = data() else { return Ok(()) };
    let answer = &runs()?[0].answer;
    let fixes = answer.rows("fixes");
    let errors: Vec<f64> = fixes.iter().map(|f| (vector(&f["ecef_m"]) - PLACE).norm()).collect();
    let speeds: Vec<f64> = fixes.iter().map(|f| vector(&f["velocity_mps"]).norm()).collect();
    let maximum = |list: &[f64]| list.iter().copied().fold(0.0, f64::max);
    let (far, fast) = (maximum(&errors), maximum(&speeds));
    let middle = median(errors);
    let first = answer.json["first_fix_s"].as_f64().unwrap_or(f64::NAN);
    println!(
        "{} fixes, first needs {first:.1} s, median error {middle:.2} m, maximum {far:.2} m; speed: median {:.3}, maximum {fast:.3} m/s",
        fixes.len(),
        median(speeds.clone())
    );
    // Times are as accurate as positions: 15 m are 50 ns.
    let on_time = fixes.iter().all(|f| {
        let truth = 525_600.0 + f["sample"].as_f64().unwrap_or(f64::NAN) / 2.6e6;
        f["gps_week"] == 2190 && (f["tow_s"].as_f64().unwrap_or(f64::NAN) - truth).abs() < 1e-6
    });
    let right = answer.code == 0
        && first <= 20.0
        && fixes.len() >= 43
        && middle <= 4.0
        && far <= 15.0
        && fast <= 0.1
        && on_time;
    if right {
        Ok(())
    } else {
        Err(format!("exit code {}, {} fixes, first {first} s, median {middle} m, maximum {far} m, {fast} m/s, on time: {on_time}\n{}", answer.code, fixes.len(), answer.messages()).into())
    }
}

/// Each field of each satellite's message within one step of the file's: the independent simulator
/// truncates where rounding may give the next step; our file's 12 digits add 0.01 of a step.
#[test]
fn decoded_ephemerides_are_those_of_the_broadcast_file() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let folder = tempfile::tempdir()?;
    let ours = rinex_nav::read(runs()?[0].unpack(folder.path(), "navigation.rnx")?)?.data;
    let theirs = rinex_nav::read(data.join("nav/brdc0010.22n"))?.data;
    for name in SATELLITES {
        let sv = name.parse()?;
        let decoded = ours.iter().find(|e| e.sv == sv).ok_or(format!("{name} not decoded"))?;
        let same = |e: &&Ephemeris| e.sv == sv && e.toe == decoded.toe;
        let sent = theirs.iter().find(same).ok_or(format!("{name}: no toe {}", decoded.toe))?;
        let whole = |e: &Ephemeris| (e.iode, e.iodc, e.health, e.toc, e.fit_interval_flag);
        if whole(decoded) != whole(sent) {
            return Err(format!("{name}: {:?} instead of {:?}", whole(decoded), whole(sent)).into());
        }
        for (k, (a, b)) in fields(decoded).into_iter().zip(fields(sent)).enumerate() {
            if (a.0 - b.0).abs() > 1.02 * a.1 {
                return Err(format!("{name} field {k}: {:e} instead of {:e}", a.0, b.0).into());
            }
        }
    }
    Ok(())
}

/// Values and steps (IS-GPS-200N, tables 20-I and 20-III).
fn fields(e: &Ephemeris) -> [(f64, f64); 19] {
    let pi = |exponent: i32| GPS_PI * 2f64.powi(exponent);
    let two = |exponent: i32| 2f64.powi(exponent);
    [
        (e.af0, two(-31)),
        (e.af1, two(-43)),
        (e.af2, two(-55)),
        (e.tgd, two(-31)),
        (e.sqrt_a, two(-19)),
        (e.e, two(-33)),
        (e.m0, pi(-31)),
        (e.delta_n, pi(-43)),
        (e.omega0, pi(-31)),
        (e.omega_dot, pi(-43)),
        (e.i0, pi(-31)),
        (e.idot, pi(-43)),
        (e.omega, pi(-31)),
        (e.cuc, two(-29)),
        (e.cus, two(-29)),
        (e.crc, two(-5)),
        (e.crs, two(-5)),
        (e.cic, two(-29)),
        (e.cis, two(-29)),
    ]
}

#[test]
fn one_and_two_threads_give_the_same_bytes() -> Tested {
    let Some(_) = data() else { return Ok(()) };
    let [one, two] = runs()?;
    let names = |run: &Run| run.files.keys().cloned().collect::<Vec<_>>();
    println!("{:?}", names(one));
    if one.answer.bytes != two.answer.bytes {
        return Err("the JSON records differ".into());
    }
    let differing: Vec<_> =
        names(one).into_iter().filter(|n| one.files.get(n) != two.files.get(n)).collect();
    if names(one) == names(two) && differing.is_empty() {
        Ok(())
    } else {
        Err(format!("{:?} and {:?}; different: {differing:?}", names(one), names(two)).into())
    }
}

/// RTKLIB's single point positions within 3 m of our fixes at the same times, with the same models (the
/// ionosphere's coefficients are in the signals) and the same mask; its weights differ from ours.
#[test]
fn rtklib_finds_our_fixes_from_our_rinex_files() -> Tested {
    let Some(data) = data_and("rnx2rtkp") else { return Ok(()) };
    let made = &runs()?[0];
    // RTKLIB uses each observation by itself, as these fixes do.
    let capture = file(data, "captures/sim_tokyo_2.6MHz_45s_1bit.bin");
    let arguments = ["process", &capture, "-f", "b1", "-r", "2.6M", "--troposphere", "none"];
    let answer = run(&[&arguments[..], &["--smoothing", "off"]].concat())?;
    let folder = tempfile::tempdir()?;
    let options = folder.path().join("options.conf");
    std::fs::write(
        &options,
        "pos1-posmode=single\npos1-elmask=5\npos1-ionoopt=brdc\npos1-tropopt=off\nout-solformat=xyz\nout-timesys=gpst\nout-timeform=tow\n",
    )?;
    let output = Command::new("rnx2rtkp")
        .arg("-k")
        .arg(&options)
        .arg(made.unpack(folder.path(), "_MO.rnx")?)
        .arg(made.unpack(folder.path(), "navigation.rnx")?)
        .output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let mut apart = Vec::new();
    for line in text.lines().filter(|l| !l.starts_with('%') && !l.is_empty()) {
        let numbers: Vec<f64> = line.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        let [_, tow, x, y, z, ..] = numbers[..] else {
            return Err(format!("rnx2rtkp printed '{line}'").into());
        };
        let near = |f: &&serde_json::Value| (f["tow_s"].as_f64().unwrap_or(0.0) - tow).abs() < 0.01;
        let fix =
            answer.rows("fixes").iter().find(near).ok_or(format!("no fix of ours: {line}"))?;
        apart.push((vector(&fix["ecef_m"]) - Vector3::new(x, y, z)).norm());
    }
    let largest = apart.iter().copied().fold(0.0, f64::max);
    println!("{} positions, at most {largest:.2} m apart", apart.len());
    let enough = apart.len() == answer.rows("fixes").len() && !apart.is_empty();
    if enough && largest <= 3.0 {
        Ok(())
    } else {
        Err(format!("{} positions, {largest} m apart\n{text}", apart.len()).into())
    }
}

/// gpsd needs the first two epochs for the cycle of sentences; then it reports each of our fixes.
#[test]
fn gpsd_reads_our_fixes_from_our_nmea() -> Tested {
    let Some(_) = data_and("gpsdecode") else { return Ok(()) };
    let run = &runs()?[0];
    let folder = tempfile::tempdir()?;
    let nmea = std::fs::File::open(run.unpack(folder.path(), ".nmea")?)?;
    let output = Command::new("gpsdecode").stdin(Stdio::from(nmea)).output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let reports: Vec<serde_json::Value> =
        text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    let positions: Vec<_> = reports.iter().filter(|r| r["class"] == "TPV").collect();
    let fixes = run.answer.rows("fixes");
    // 1e-6 minutes are 2e-8 deg.
    let ours = |tpv: &serde_json::Value| {
        let close = |fix: &serde_json::Value, ours: &str, theirs: &str| {
            let difference = fix[ours].as_f64().zip(tpv[theirs].as_f64()).map(|(a, b)| a - b);
            difference.is_some_and(|d| d.abs() < 2e-8)
        };
        fixes.iter().any(|f| close(f, "lat_deg", "lat") && close(f, "lon_deg", "lon"))
    };
    println!("{} of {} fixes", positions.len(), fixes.len());
    let right = positions.len() + 2 >= fixes.len() && positions.iter().all(|tpv| ours(tpv));
    if right && !positions.is_empty() { Ok(()) } else { Err(text.into_owned().into()) }
}
