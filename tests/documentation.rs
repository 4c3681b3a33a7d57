//! Commands and programs of README, help and examples work as printed.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

type Tested = Result<(), Box<dyn Error>>;

/// Runs `sdr-rx` with the words of a line in a folder that holds `signals/`.
fn run(line: &str, folder: &Path) -> std::io::Result<Output> {
    Command::new(env!("CARGO_BIN_EXE_sdr-rx"))
        .args(line.split_whitespace())
        .current_dir(folder)
        .output()
}

/// A folder with a copy of `signals/` in which commands may leave files.
fn workplace() -> std::io::Result<tempfile::TempDir> {
    let folder = tempfile::tempdir()?;
    std::fs::create_dir(folder.path().join("signals"))?;
    for entry in std::fs::read_dir(repository().join("signals"))? {
        let path = entry?.path();
        std::fs::copy(&path, folder.path().join("signals").join(path.file_name().unwrap()))?;
    }
    Ok(folder)
}

fn repository() -> PathBuf {
    env!("CARGO_MANIFEST_DIR").into()
}

#[test]
fn the_example_in_the_help_of_each_command_works_as_printed() -> Tested {
    let folder = workplace()?;
    for command in ["process", "acquire", "info", "simulate"] {
        let help = String::from_utf8(run(&format!("{command} --help"), folder.path())?.stdout)?;
        let example = help.lines().find_map(|l| l.trim().strip_prefix("Example: sdr-rx "));
        let example = example.ok_or_else(|| format!("{command} --help shows no example"))?;
        assert!(example.starts_with(command), "{example}");
        // As printed but for the length: 50 ms give no full fix, and exit code 1.
        let output = run(&format!("{example} --duration 0.05"), folder.path())?;
        let expected = if command == "process" { 1 } else { 0 };
        let complaint = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(expected), "{example}: {complaint}");
    }
    Ok(())
}

#[test]
fn each_command_of_the_readme_is_understood() -> Tested {
    let folder = workplace()?;
    let readme = std::fs::read_to_string(repository().join("README.md"))?;
    let prefixes = ["sdr-rx ", "cargo run --release -- "];
    let lines: Vec<&str> = readme
        .lines()
        .map(|line| line.split('#').next().unwrap_or_default().trim())
        .filter_map(|line| prefixes.iter().find_map(|p| line.strip_prefix(p)))
        .collect();
    assert!(lines.len() >= 5, "{lines:?}");
    for line in lines {
        let ours = line.contains("signals/");
        let long = ours && !line.contains("--duration");
        let shortened = if long { format!("{line} --duration 0.05") } else { line.to_owned() };
        let output = run(&shortened, folder.path())?;
        let complaint = String::from_utf8_lossy(&output.stderr);
        // Recordings of users are missing; no other error is allowed.
        assert!(!complaint.contains("Usage:"), "{line}: {complaint}");
        assert!(output.status.code() != Some(2) || !ours, "{line}: {complaint}");
    }
    Ok(())
}

#[test]
fn each_local_link_of_the_pages_leads_somewhere() -> Tested {
    for page in ["README.md", "docs/README.md"] {
        let page = repository().join(page);
        let text = std::fs::read_to_string(&page)?;
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let target = page.parent().unwrap().join(link.split('#').next().unwrap_or_default());
            assert!(link.starts_with("http") || target.exists(), "{}: {link}", page.display());
        }
    }
    Ok(())
}

#[test]
fn each_example_program_runs() -> Tested {
    let test = std::env::current_exe()?;
    let built = test.parent().and_then(Path::parent).ok_or("no target folder")?.join("examples");
    for entry in std::fs::read_dir(repository().join("examples"))? {
        let path = entry?.path();
        let program = built.join(path.file_stem().unwrap());
        let output = Command::new(&program).output().map_err(|e| {
            format!("{}: {e}: run `cargo build --examples` first", program.display())
        })?;
        assert!(output.status.success(), "{}: {output:?}", program.display());
        assert!(
            std::fs::read_to_string(&path)?.lines().count() <= 60,
            "{} is long",
            path.display()
        );
    }
    Ok(())
}

#[test]
fn the_main_command_of_the_readme_finds_the_position() -> Tested {
    let folder = workplace()?;
    let output = run("process signals/static_8sv.toml --out fix --json -", folder.path())?;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: serde_json::Value = serde_json::from_slice(&output.stdout)?;
    assert_eq!(result["seed"], 1);
    // Observation files are not smoothed.
    let unsmoothed =
        run("process signals/static_8sv.toml --smoothing off --json -", folder.path())?;
    let unsmoothed = serde_json::from_slice(&unsmoothed.stdout)?;
    the_example_of_solve_gives_the_same_fixes(folder.path(), &unsmoothed)?;
    let fixes = result["fixes"].as_array().ok_or("no fixes")?;
    assert!(fixes.len() >= 10, "{} fixes", fixes.len());
    let truth_m =
        sdr_rx::gnss::coordinates::Geodetic::from_degrees(48.1372, 11.5755, 560.0).to_ecef();
    let mut errors: Vec<f64> = fixes
        .iter()
        .map(|fix| {
            let ecef = |k: usize| fix["ecef_m"][k].as_f64().unwrap_or(f64::NAN);
            (nalgebra::Vector3::new(ecef(0), ecef(1), ecef(2)) - truth_m).norm()
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    // Code noise of a loop of 0.5 Hz with taps at 0.25 chips at 43 dB-Hz: 0.73 m; times a PDOP of 1.7
    // and 3.4 standard deviations: 4.2 m. (The scenario has the troposphere that the receiver takes out.)
    let median = errors[errors.len() / 2];
    assert!(median < 4.2, "{median} m");
    Ok(())
}

/// The files that `process` left in `folder/fix` go into `solve` as in its help: as many fixes as those of
/// `process`, and the same positions but for the rounding of ranges to 1 mm and of the assumed noise.
fn the_example_of_solve_gives_the_same_fixes(folder: &Path, result: &serde_json::Value) -> Tested {
    let help = String::from_utf8(run("solve --help", folder)?.stdout)?;
    let example = help.lines().find_map(|l| l.trim().strip_prefix("Example: sdr-rx "));
    let example = example.ok_or("solve --help shows no example")?;
    let output = run(&format!("{example} --json -"), folder)?;
    assert!(output.status.success(), "{example}: {}", String::from_utf8_lossy(&output.stderr));
    let solved: serde_json::Value = serde_json::from_slice(&output.stdout)?;
    let count = |r: &serde_json::Value| r["fixes"].as_array().map_or(0, Vec::len);
    assert_eq!(count(&solved), count(result));
    for (ours, theirs) in solved["fixes"].as_array().into_iter().flatten().zip(0..) {
        for axis in 0..3 {
            let ecef = |fix: &serde_json::Value| fix["ecef_m"][axis].as_f64().unwrap_or(f64::NAN);
            // Weights that differ by C/N0 move a solution by a part of its error of metres.
            let apart_m = (ecef(ours) - ecef(&result["fixes"][theirs])).abs();
            assert!(apart_m < 2.0, "{apart_m} m");
        }
    }
    let accuracy = &solved["accuracy"];
    assert!(accuracy["error_50_m"].as_f64().is_some_and(|m| m < 5.0), "{accuracy}");
    Ok(())
}
