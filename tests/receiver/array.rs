//! Captures of several antenna elements: directions, positions, and signals that come from no sky.

use crate::common::data_trial;
use crate::program::{Answer, file, run, vector};
use libtest_mimic::{Failed, Trial};
use sdr_rx::gnss::coordinates::Geodetic;
use serde_json::Value;
use std::path::Path;

pub fn trials() -> Vec<Trial> {
    vec![
        data_trial("four_elements_find_every_satellite_in_20_ms", four_elements_20_ms),
        data_trial("four_elements_tell_directions_and_the_site_in_100_ms", four_elements_100_ms),
        data_trial("one_antenna_on_two_channels_is_named_and_its_phase_measured", splitter),
    ]
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

fn four_elements_20_ms(data: &Path) -> Result<(), Failed> {
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

fn four_elements_100_ms(data: &Path) -> Result<(), Failed> {
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
    if !(error < 20.0) || answer.said().contains("suspected") {
        return Err(format!("{error} m off; {}", answer.said()).into());
    }
    Ok(())
}

fn splitter(data: &Path) -> Result<(), Failed> {
    let files = ["ifen.smfx", "ifen_ant0_L1_20MHz_2bit.bin", "ifen_ant1_L1_20MHz_2bit.bin"]
        .map(|name| file(data, &format!("captures/{name}")));
    let answer = run(&["acquire", &files[0], &files[1], &files[2]])?;
    if !answer.said().contains("come from one direction") {
        return Err(format!("not named: {}", answer.said()).into());
    }
    let seen = answer.json["sky"]["satellites"].as_array().ok_or("no signatures")?;
    for (k, row) in seen.iter().enumerate() {
        let phase = row["elements"][1]["phase_deg"].as_f64().unwrap_or(f64::NAN);
        println!("{}: {phase:.2} deg", row["sv"]);
        // The makers' list ends at the eleventh; weaker ones are noisier than a degree.
        if k < 11 && !((phase - 98.4).abs() < 1.0) {
            return Err(format!("{}: {phase} deg", row["sv"]).into());
        }
    }
    if seen.len() < 11 { Err("fewer than 11 satellites".into()) } else { Ok(()) }
}
