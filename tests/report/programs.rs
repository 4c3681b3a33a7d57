//! RTKLIB and gpsd read what is written.

use crate::common::{Failed, Tested, data_and};
use crate::scene::{EPOCHS, Scene, TRUTH_M};
use nalgebra::Vector3;
use sdr_rx::gnss::coordinates::Geodetic;
use sdr_rx::report::{OutputDir, write_all};
use std::path::PathBuf;
use std::process::{Command, Stdio};

fn written(scene: &Scene) -> Result<(tempfile::TempDir, Vec<PathBuf>), Failed> {
    let folder = tempfile::tempdir()?;
    let paths = write_all(&scene.run(), &OutputDir::create(folder.path())?, true)?;
    Ok((folder, paths))
}

/// RTKLIB's single point positioning, atmosphere off as in the scene. The file gives ranges to 1 mm: the
/// rounding (uniform, 0.3 mm rms) times a PDOP of about 2 is below a millimetre; RTKLIB stops iterating
/// below 0.1 mm and prints 0.1 mm. 1 cm leaves a factor of ten.
#[test]
fn rtklib_finds_the_position_from_our_rinex_files() -> Tested {
    let Some(data) = data_and("rnx2rtkp") else { return Ok(()) };
    let scene = Scene::new(data)?;
    let (_folder, paths) = written(&scene)?;
    let output =
        Command::new("rnx2rtkp").args(["-p", "0", "-e", "-m", "10"]).args(&paths[1..3]).output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let mut count = 0;
    for line in text.lines().filter(|l| !l.starts_with('%') && !l.is_empty()) {
        let numbers: Vec<f64> = line.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        let [.., _] = numbers[..] else { return Err(format!("rnx2rtkp printed '{line}'").into()) };
        let first = line.split_whitespace().skip(2).take(3).filter_map(|w| w.parse().ok());
        let position = Vector3::from_iterator(first.chain(std::iter::repeat(f64::NAN)).take(3));
        let miss = (position - TRUTH_M).norm();
        if miss.is_nan() || miss > 0.01 {
            return Err(format!("rnx2rtkp is {miss} m off: {line}").into());
        }
        count += 1;
    }
    if count == EPOCHS {
        Ok(())
    } else {
        Err(format!("{count} positions of {EPOCHS}: {text}").into())
    }
}

/// The position and satellites that gpsd reports are those of the fixes: 1e-6 minutes are 2 mm, a
/// millimetre of height; both are printed by gpsd to 1e-9 deg and 0.1 mm or better.
#[test]
fn gpsd_reads_our_nmea() -> Tested {
    let Some(data) = data_and("gpsdecode") else { return Ok(()) };
    let scene = Scene::new(data)?;
    let (_folder, paths) = written(&scene)?;
    let nmea = paths.iter().find(|p| p.ends_with("track.nmea")).ok_or("no NMEA file")?;
    let output =
        Command::new("gpsdecode").stdin(Stdio::from(std::fs::File::open(nmea)?)).output()?;
    let reports: Vec<serde_json::Value> = String::from_utf8_lossy(&output.stdout)
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect();
    let of = |class: &str| reports.iter().filter(|r| r["class"] == class).collect::<Vec<_>>();
    let truth = Geodetic::from_ecef(&TRUTH_M);
    // gpsd needs the first epochs for the cycle of sentences before it reports.
    if of("TPV").len() < EPOCHS - 2 {
        return Err(format!("{} of {EPOCHS} positions", of("TPV").len()).into());
    }
    for tpv in of("TPV") {
        let number = |name: &str| tpv[name].as_f64().unwrap_or(f64::NAN);
        let close = (number("lat") - truth.latitude.to_degrees()).abs() < 2e-8
            && (number("lon") - truth.longitude.to_degrees()).abs() < 2e-5
            && (number("altHAE") - truth.height).abs() < 2e-3;
        if !close {
            return Err(format!("gpsd reads {tpv}").into());
        }
    }
    let used = |report: &&serde_json::Value| {
        report["uSat"].as_u64() == Some(scene.fixes[0].residuals.len() as u64)
    };
    let good = of("SKY").into_iter().filter(|s| used(s)).count();
    if good < EPOCHS - 2 {
        return Err(format!("{good} of {EPOCHS} sky reports: {reports:?}").into());
    }
    Ok(())
}
