//! Files that others reported: what is whole is used, and what is not is named.

use sdr_rx_gnss::NavigationData;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::format::{LeftOut, rinex_nav, rinex_obs, sp3};
use sdr_rx_position::{Fix, PositioningOptions, solve_epoch};
use std::error::Error;
use std::path::{Path, PathBuf};

fn data() -> Option<PathBuf> {
    let data = std::env::var_os("SDR_RX_DATA").map(PathBuf::from);
    if data.is_none() {
        println!("SDR_RX_DATA is not set: files of others are not read");
    }
    data
}

/// Files of a folder with these ends of names.
fn files(folder: &Path, ends: &[&str]) -> Vec<PathBuf> {
    let all = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let named = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        ends.iter().any(|end| name.ends_with(end))
    };
    let mut files: Vec<PathBuf> = all.filter(named).collect();
    files.sort();
    files
}

/// The fixes of a file, and what was left out of it.
fn solved(
    observations: &Path,
    nav: &NavigationData,
) -> Result<(Vec<Fix>, LeftOut), Box<dyn Error>> {
    let options = PositioningOptions::default();
    let mut reader = rinex_obs::open(observations)?;
    let epochs: Vec<_> = reader.by_ref().collect::<Result<_, _>>()?;
    let fixes = epochs.iter().filter_map(|epoch| solve_epoch(epoch, nav, &options).ok()).collect();
    Ok((fixes, reader.left_out().clone()))
}

/// Files computed for one place without noise. Of their epochs RTKLIB solves all four of most, three of one that is cut, two
/// of one that counts wrongly and of those with two; of the navigation files it has all satellites but the bad one.
#[test]
fn one_bad_record_loses_one_record() -> Result<(), Box<dyn Error>> {
    let Some(cases) = data().map(|data| data.join("cases")) else { return Ok(()) };
    let truth = Geodetic::from_degrees(48.1372, 11.5755, 560.0).to_ecef();
    let mut count = 0;
    let mut check = |observations: &Path, nav: &Path| -> Result<(), Box<dyn Error>> {
        let file = rinex_nav::read(nav)?;
        let (fixes, left_out) = solved(observations, &file.data)?;
        let name = format!("{} {}", observations.display(), nav.display());
        let of_two = name.contains("count1more3") || name.contains("12-negative");
        let least = if of_two { 2 } else { 3 + usize::from(!name.contains("trunc3.rnx")) };
        assert!(fixes.len() >= least, "{name}: {} fixes", fixes.len());
        assert!(file.data.iter().count() >= 8, "{name}: {} satellites", file.data.iter().count());
        for fix in &fixes {
            let error_m = (fix.position_m - truth).norm();
            assert!(error_m < 0.01, "{name}: {error_m} m");
        }
        for kind in left_out.kinds().iter().chain(file.left_out.kinds()) {
            assert!(kind.count <= 4 && kind.first.contains(", line "), "{name}: {kind}");
        }
        count += 1;
        Ok(())
    };
    let folder = |name: &str| cases.join(name);
    let records = folder("09-one-record-loses-the-file");
    for observations in files(&records, &["3.rnx", ".obs"]) {
        check(&observations, &records.join("nav.22n"))?;
    }
    for nav in files(&records, &[".n"]) {
        check(&records.join("ok3.rnx"), &nav)?;
    }
    let header = folder("10-header-line-that-nobody-needs");
    for observations in files(&header, &[".rnx"]) {
        check(&observations, &records.join("nav.22n"))?;
    }
    for nav in files(&header, &[".n"]) {
        check(&header.join("obs.rnx"), &nav)?;
    }
    for (name, end) in [("11-scale-factor", "3.rnx"), ("12-negative-pseudorange", ".rnx")] {
        for observations in files(&folder(name), &[end]) {
            check(&observations, &folder(name).join("nav.22n"))?;
        }
    }
    println!("{count} pairs of files");
    Ok(())
}

/// A file cut within its last position: all other positions are read, and it is not used with half a number.
#[test]
fn a_cut_table_of_orbits_keeps_what_came_before() -> Result<(), Box<dyn Error>> {
    let Some(data) = data() else { return Ok(()) };
    let path = data.join("cases/09-one-record-loses-the-file/trunc.sp3");
    if !path.exists() {
        println!("{} is not there", path.display());
        return Ok(());
    }
    let text = std::fs::read_to_string(&path)?;
    let whole = text.lines().filter(|line| line.starts_with("PG")).count() - 1;
    let file = sp3::read(&path)?;
    let read: usize = file.orbits.values().map(|orbit| orbit.points().len()).sum();
    // Positions that are not known stand there as zeros.
    let zeros = text.lines().filter(|l| {
        l.starts_with("PG") && l.contains("      0.000000      0.000000      0.000000")
    });
    assert_eq!(read, whole - zeros.count());
    let [kind] = file.left_out.kinds() else { return Err("one kind".into()) };
    assert!(kind.count == 1 && kind.first.contains("a coordinate is missing"), "{kind}");
    Ok(())
}

#[test]
fn orbits_of_too_few_points_are_told() -> Result<(), Box<dyn Error>> {
    let Some(data) = data() else { return Ok(()) };
    let folder = data.join("cases/15-sp3-too-short-or-cut");
    for path in files(&folder, &[".sp3"]) {
        let file = sp3::read(&path)?;
        assert!(file.orbits.values().any(|orbit| orbit.too_few() == Some((8, 11))), "{path:?}");
        let nav = file.into_navigation_data();
        let mut reader = rinex_obs::open(folder.join("o.rnx"))?;
        let epoch = reader.next().ok_or("no epoch")??;
        let error = solve_epoch(&epoch, &nav, &PositioningOptions::default()).unwrap_err();
        assert!(error.to_string().contains("11 are needed"), "{error}");
    }
    Ok(())
}
