//! Captures of several antenna elements: number of satellites, directions, positions.

use crate::common::{Failed, Tested, data};
use crate::program::{Answer, file, run, vector};
use assert_cmd::Command;
use sdr_rx::gnss::coordinates::Geodetic;
use serde_json::Value;
use std::path::Path;

#[test]
fn fifty_elements_find_eight_satellites_and_the_position() -> Tested {
    line("ula50", &[])
}

#[test]
fn sixteen_elements_find_six_satellites_and_the_position() -> Tested {
    line("ula16", &[])
}

#[test]
fn the_solver_of_the_paper_finds_the_same() -> Tested {
    line("ula16", &["--engine", "lda"])
}

#[test]
fn eight_elements_find_five_satellites_and_the_position() -> Tested {
    line("ula8", &[])
}

#[test]
fn four_elements_find_six_satellites_and_the_position() -> Tested {
    line("ula4", &[])
}

/// LDA-l1,1 and its rows, and AW-DGN-BT on what is found in them: no other search and no other solver.
#[test]
fn the_methods_of_the_papers_alone_give_the_position_under_impulses() -> Tested {
    for name in ["ula16", "ula50"] {
        let (answer, truth) = snapshot(name, &["--method", "papers"])?;
        let known = truth["satellites"].as_array().ok_or("no truth")?;
        let sky = &answer.json["sky"]["look"];
        if answer.satellites().len() != known.len() || sky["decision"] != "row rule" {
            return Err(format!("{name}: {:?} by {}", answer.satellites(), sky["decision"]).into());
        }
        let fix = answer.rows("fixes").first().ok_or("no fix")?;
        if sky["engine"] != "LDA-l1,1"
            || fix["solver"] != "aw-dgn-bt"
            || fix["failed_solver"] != Value::Null
        {
            return Err(format!("{name}: {} and {}", sky["engine"], fix["solver"]).into());
        }
        within_sigma(&answer, &truth, &format!("{name}: "))?;
    }
    Ok(())
}

/// Whether a number is one, and below a bound.
pub fn below(number: f64, bound: f64) -> bool {
    number < bound
}

pub fn scenario(name: &str) -> String {
    format!("{}/signals/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

/// Simulates 0.2 s of a shipped scenario, processes them with the navigation file beside: the answer and the
/// truth of the first sample.
pub fn snapshot(name: &str, rest: &[&str]) -> Result<(Answer, Value), Failed> {
    let folder = tempfile::tempdir()?;
    let at = |file: &str| folder.path().join(file).display().to_string();
    let made = Command::new(env!("CARGO_BIN_EXE_sdr-rx"))
        .args(["simulate", &scenario(name), "--duration", "0.2", "--out", &at("line.sigmf-meta")])
        .output()?;
    if !made.status.success() {
        return Err(String::from_utf8_lossy(&made.stderr).into_owned().into());
    }
    let truth: Value = serde_json::from_slice(&std::fs::read(at("line.truth.json"))?)?;
    let (capture, nav) = (at("line.sigmf-meta"), at("line.nav.rnx"));
    let answer = run(&[&["process", &capture, "--nav", &nav][..], rest].concat())?;
    Ok((answer, truth["epochs"][0].clone()))
}

/// Distance of the snapshot's position from the truth, m.
fn error_m(answer: &Answer, truth: &Value) -> f64 {
    let truth_m = vector(&truth["position_ecef_m"]);
    answer.rows("fixes").first().map_or(f64::NAN, |fix| (vector(&fix["ecef_m"]) - truth_m).norm())
}

/// A simulated line of elements in impulsive noise, cold: number of signals, angles and satellites are the
/// simulated ones, and the position is found from the snapshot and the navigation file beside it.
fn line(name: &str, rest: &[&str]) -> Tested {
    let (answer, truth) = snapshot(name, rest)?;
    let known = truth["satellites"].as_array().ok_or("no truth")?;

    let sky = &answer.json["sky"];
    let number = |v: &Value| v.as_f64().unwrap_or(f64::NAN);
    let elements = number(&sky["elements"]);
    let name = |s: &Value| s["sv"].as_str().unwrap_or_default().to_owned();
    let mut names: Vec<String> = known.iter().map(name).collect();
    names.sort();
    if answer.satellites() != names {
        return Err(format!("{:?} instead of {names:?}", answer.satellites()).into());
    }
    let angle_of = |s: &Value| number(&s["array_angle_deg"]);
    let mut errors = Vec::new();
    for satellite in known {
        let row = sky["satellites"]
            .as_array()
            .and_then(|r| r.iter().find(|r| r["sv"] == satellite["sv"]));
        let row = row.ok_or("a satellite without a direction")?;
        let (error, sigma) =
            (number(&row["angle_deg"]) - angle_of(satellite), number(&row["sigma_deg"]));
        // Five standard deviations, and what the satellite moves in 0.2 s.
        if !below(error.abs(), 5.0 * sigma + 0.01) {
            return Err(format!("{}: {error} deg off, sigma {sigma}", row["sv"]).into());
        }
        errors.push(error);
    }
    // Before any code: as many sources as satellites, at their angles.
    let sources = sky["look"]["sources"].as_array().ok_or("no look")?;
    if sources.len() != known.len() {
        return Err(format!("{} sources, not {}", sources.len(), known.len()).into());
    }
    for source in sources {
        let truth = known.iter().find(|s| s["sv"] == source["sv"]).ok_or("a source too many")?;
        let error = number(&source["angle_deg"]) - angle_of(truth);
        let sigma = number(&source["sigma_deg"]);
        if !below(error.abs(), 5.0 * sigma + 0.01) {
            return Err(format!("{}: {error} deg off, sigma {sigma}", source["sv"]).into());
        }
    }
    // The engine is the one that ran.
    let engine = if rest.contains(&"lda") { "LDA-l1,1" } else { "ADMM" };
    if sky["look"]["engine"] != engine || !below(number(&sky["look"]["duality_gap"]), 1e-2) {
        return Err(
            format!("{} of gap {}", sky["look"]["engine"], sky["look"]["duality_gap"]).into()
        );
    }
    // The attitude of the scenarios' lines, which the directions of the satellites give again.
    let attitude = &sky["attitude"];
    let (heading, sigma) = (number(&attitude["yaw_deg"]), number(&attitude["heading_sigma_deg"]));
    println!("heading {heading:.3} +- {sigma:.3} deg");
    if !below((heading - 80.0).abs(), 5.0 * sigma + 0.02) {
        return Err(format!("heading {heading} deg, sigma {sigma}, not 80").into());
    }
    let given = answer.json["fixes"][0]["directions"].as_array().map_or(0, Vec::len);
    if given != known.len() {
        return Err(format!("the fix has directions of {given} of {}", known.len()).into());
    }
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    within_sigma(&answer, &truth, &format!("{elements} elements: angles {rms:.3} deg rms, "))
}

/// The fix lies within four of its standard deviations.
pub fn within_sigma(answer: &Answer, truth: &Value, what: &str) -> Tested {
    let error = error_m(answer, truth);
    let sigma = answer.rows("fixes").first().map_or(f64::NAN, |f| vector(&f["sigma_m"]).norm());
    println!("{what}position {error:.2} m off, sigma {sigma:.2} m");
    // The standard deviation itself must be plausible for 0.2 s: a refinement of 45 dB-Hz and more is good to a
    // metre, and no geometry of five satellites here has a PDOP above 10.
    if below(error, 4.0 * sigma) && below(sigma, 20.0) {
        Ok(())
    } else {
        Err(format!("{error} m off, sigma {sigma} m: {}", answer.messages()).into())
    }
}

const ARRAY4: &str = "captures/sim_array4_2MHz_0.5s_cs8";

/// The independent simulator's capture of 2 x 2 elements, processed.
fn array4(data: &Path, rest: &[&str]) -> Result<Answer, Failed> {
    let (capture, nav) = (file(data, &format!("{ARRAY4}.bin")), file(data, "nav/brdc0010.22n"));
    let how = [
        "process",
        &capture,
        "-f",
        "cs8",
        "-r",
        "2M",
        "--channels",
        "4",
        "--array",
        "ura:2x2",
        "--nav",
        &nav,
        "--time",
        "2190:551667",
        "--troposphere",
        "none",
    ];
    run(&[&how[..], rest].concat())
}

/// Name, azimuth and elevation (degrees) of each satellite simulated.
fn truth(data: &Path) -> Result<Vec<(String, f64, f64)>, Failed> {
    let text = std::fs::read_to_string(data.join(format!("{ARRAY4}.json")))?;
    let truth: Value = serde_json::from_str(&text)?;
    let number = |v: &Value| v.as_f64().unwrap_or(f64::NAN);
    let satellites = truth["satellites"].as_object().ok_or("no satellites in the truth")?;
    let row = |(prn, s): (&String, &Value)| {
        (format!("G{:02}", prn.parse::<u8>().unwrap_or(0)), number(&s["az"]), number(&s["el"]))
    };
    Ok(satellites.iter().map(row).collect())
}

#[test]
fn four_elements_find_every_satellite_in_20_ms() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let answer = array4(data, &["--duration", "0.02"])?;
    let found = answer.satellites();
    let truth = truth(data)?;
    for (sv, _, elevation) in &truth {
        if *elevation > 5.0 && !found.contains(sv) {
            return Err(format!("{sv} at {elevation} deg is not among {found:?}").into());
        }
    }
    match found.iter().find(|sv| truth.iter().all(|t| t.0 != **sv)) {
        Some(sv) => Err(format!("{sv} was not simulated").into()),
        None => Ok(()),
    }
}

#[test]
fn four_elements_give_directions_and_the_position_in_100_ms() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let answer = array4(data, &["--duration", "0.1"])?;
    let seen = answer.json["sky"]["satellites"].as_array().ok_or("no directions")?;
    let [mut cosines, mut azimuths, mut elevations] = [const { Vec::new() }; 3];
    for (sv, azimuth, elevation) in truth(data)? {
        let Some(row) = seen.iter().find(|row| row["sv"] == *sv) else { continue };
        let number = |v: &Value| v.as_f64().unwrap_or(f64::NAN);
        let ((sa, ca), ce) = (azimuth.to_radians().sin_cos(), elevation.to_radians().cos());
        cosines.push(number(&row["cosines"][0]) - ce * sa);
        cosines.push(number(&row["cosines"][1]) - ce * ca);
        if elevation > 15.0 {
            let turned = number(&row["azimuth_deg"]) - azimuth + 540.0;
            azimuths.push((turned.rem_euclid(360.0) - 180.0) * ce);
            elevations.push(number(&row["elevation_deg"]) - elevation);
        }
        if row["suspected"] == true {
            return Err(format!("{sv} is suspected").into());
        }
    }
    let rms = |v: &[f64]| (v.iter().map(|e| e * e).sum::<f64>() / v.len() as f64).sqrt();
    let [c, a, e] = [rms(&cosines), rms(&azimuths), rms(&elevations)];
    println!("{} satellites: cosines {c:.4}, azimuth {a:.2} deg, elevation {e:.2} deg", seen.len());
    if !(seen.len() >= 14 && c < 0.01 && a < 1.5 && e < 1.5) {
        return Err(format!("{} satellites, rms {c} {a} {e}", seen.len()).into());
    }
    let site = Geodetic::from_degrees(-1.292_066, 36.821_945, 1700.0).to_ecef();
    let error = (vector(&answer.json["fixes"][0]["ecef_m"]) - site).norm();
    println!("position {error:.1} m off");
    if !below(error, 20.0) || answer.messages().contains("suspected") {
        return Err(format!("{error} m off; {}", answer.messages()).into());
    }
    Ok(())
}

#[test]
fn one_antenna_on_two_channels_is_named_and_its_phase_measured() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let files = ["ifen.smfx", "ifen_ant0_L1_20MHz_2bit.bin", "ifen_ant1_L1_20MHz_2bit.bin"]
        .map(|name| file(data, &format!("captures/{name}")));
    let answer = run(&["acquire", &files[0], &files[1], &files[2]])?;
    if !answer.messages().contains("come from one direction") {
        return Err(format!("not named: {}", answer.messages()).into());
    }
    let seen = answer.json["sky"]["satellites"].as_array().ok_or("no signatures")?;
    for (k, row) in seen.iter().enumerate() {
        let phase = row["elements"][1]["phase_deg"].as_f64().unwrap_or(f64::NAN);
        println!("{}: {phase:.2} deg", row["sv"]);
        // The makers' list ends at the eleventh; weaker ones are noisier than a degree.
        if k < 11 && !below((phase - 98.4).abs(), 1.0) {
            return Err(format!("{}: {phase} deg", row["sv"]).into());
        }
    }
    if seen.len() < 11 { Err("fewer than 11 satellites".into()) } else { Ok(()) }
}
