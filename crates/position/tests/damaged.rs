//! Files of others, damaged as files are: what is whole is used, and what is not is named.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sdr_rx_gnss::NavigationData;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::format::rinex_obs::ObservationReader;
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

/// Files computed for one place without noise, as RTKLIB solves them to a millimetre: whatever is wrong in them, two fixes
/// at least of the four epochs (of two where there are two) are there.
#[test]
fn one_bad_record_loses_one_record() -> Result<(), Box<dyn Error>> {
    let Some(cases) = data().map(|data| data.join("cases")) else { return Ok(()) };
    let truth = Geodetic::from_degrees(48.1372, 11.5755, 560.0).to_ecef();
    let mut count = 0;
    let mut check = |observations: &Path, nav: &Path| -> Result<(), Box<dyn Error>> {
        let file = rinex_nav::read(nav)?;
        let (fixes, left_out) = solved(observations, &file.data)?;
        let name = format!("{} {}", observations.display(), nav.display());
        assert!(fixes.len() >= 2, "{name}: {} fixes", fixes.len());
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

/// One of forty kinds of damage at a random place.
fn damage(text: &str, kind: usize, rng: &mut ChaCha8Rng) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let body = lines.iter().position(|l| l.contains("END OF HEADER")).map_or(0, |k| k + 1);
    let from = if kind < 30 { body } else { 0 };
    let at = rng.random_range(from..lines.len().max(from + 1)).min(lines.len() - 1);
    let column = rng.random_range(0..lines[at].len().max(1));
    let other = rng.random_range(0..lines.len());
    let put = |line: &str, with: &str| {
        let mut bytes: Vec<u8> = line.bytes().collect();
        for (k, b) in with.bytes().enumerate() {
            if let Some(place) = bytes.get_mut(column + k) {
                *place = b;
            }
        }
        String::from_utf8_lossy(&bytes).into_owned()
    };
    const WORDS: [&str; 10] = ["NaN", "9", "-", "*****", ">", "G", "  ", "1e99", "\0", "\u{1a}"];
    match kind % 20 {
        0 => drop(lines.remove(at)),
        1 => lines.insert(at, lines[other].clone()),
        2 => lines.swap(at, other),
        3 => lines.truncate(at + 1),
        4 => lines[at].truncate(column),
        5 => lines.insert(at, "> junk".into()),
        6 => lines.insert(at, format!("{:60}COMMENT", "here")),
        7 => lines[at] = lines[at].chars().rev().collect(),
        8 => lines[at].clear(),
        9 => lines[at] += &" ".repeat(200),
        k => lines[at] = put(&lines[at], WORDS[k - 10]),
    }
    lines.join(if kind.is_multiple_of(7) { "\r\n" } else { "\n" })
}

/// Damage of one place touches an epoch or two of a file (of version 2 all of its satellites), or a record or two: the
/// rest is read. Where it is the header's that everything needs, the file is refused with a reason.
#[test]
fn forty_kinds_of_damage_lose_what_they_touch() -> Result<(), Box<dyn Error>> {
    let Some(data) = data() else { return Ok(()) };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let folders = ["obs/matrtklib-static", "obs/gps-sdr-sim-rtk", "nav"].map(|n| data.join(n));
    let all = folders.iter().flat_map(|f| files(f, &[".obs", ".nav", ".22n", ".sp3"]));
    let mut count = 0;
    for path in all {
        let text = String::from_utf8_lossy(&std::fs::read(&path)?).into_owned();
        // The first thousand lines serve.
        let text: String = text.lines().take(1000).map(|l| format!("{l}\n")).collect();
        let epochs = |text: &str| {
            let mut reader = ObservationReader::new(text.as_bytes(), "x").ok()?;
            let read = reader.by_ref().filter_map(Result::ok).count();
            Some((read, !reader.left_out().kinds().is_empty()))
        };
        let records = |text: &str| {
            let file = rinex_nav::parse(text, "x").ok()?;
            Some((file.data.iter().count() + file.skipped, !file.left_out.kinds().is_empty()))
        };
        let read: &dyn Fn(&str) -> Option<(usize, bool)> =
            if path.extension().is_some_and(|e| e == "obs") { &epochs } else { &records };
        let (whole, _) = read(&text).ok_or("not read")?;
        for kind in 0..40 {
            let damaged = damage(&text, kind, &mut rng);
            let is_cut = kind % 20 == 3;
            if let Some((left, _)) = read(&damaged).filter(|_| kind < 30 && !is_cut) {
                assert!(left + 3 >= whole, "{path:?}, damage {kind}: {left} of {whole}");
                count += 1;
            }
        }
    }
    println!("{count} damaged files");
    Ok(())
}
