//! Outputs destroy nothing: neither inputs, nor files of others, nor devices; and leave nothing of an earlier run.

use crate::common::Tested;
use assert_cmd::Command;
use std::path::Path;

fn sdr_rx(folder: &Path, arguments: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_sdr-rx"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("the program runs");
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code().unwrap_or(-1), errors)
}

#[test]
fn inputs_and_files_of_others_stay_as_they_are() -> Tested {
    let folder = tempfile::tempdir()?;
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("signals/static_8sv.toml");
    let scenario = scenario.display().to_string();
    let at = folder.path();
    let made = sdr_rx(at, &["simulate", &scenario, "--duration", "0.05", "--out", "a.cs8"]);
    assert_eq!(made.0, 0, "{}", made.1);
    let capture = std::fs::read(at.join("a.cs8"))?;
    std::fs::write(at.join("b.cs8"), &capture)?;
    std::fs::write(at.join("notes.txt"), "mine")?;
    std::fs::write(at.join("track.kml"), "mine")?;
    let rate = ["-r", "2.6M"];
    // The second file is a channel more, not the value of --json.
    sdr_rx(at, &[&["acquire", "--json", "a.cs8", "b.cs8"][..], &rate].concat());
    for (arguments, name) in [
        (vec!["acquire", "a.cs8", "--json=a.cs8"], "a.cs8"),
        (vec!["acquire", "a.cs8", "--json=a.cs8", "--force"], "a.cs8"),
        (vec!["acquire", "a.cs8", "--json=notes.txt"], "notes.txt"),
        (vec!["process", "a.cs8", "--events=notes.txt"], "notes.txt"),
        (vec!["process", "a.cs8", "--out", "."], "track.kml"),
    ] {
        let (code, message) = sdr_rx(at, &[&arguments[..], &rate].concat());
        assert_eq!(code, 2, "{arguments:?}: {message}");
        assert!(message.contains(name), "{message}");
    }
    assert!(std::fs::read(at.join("a.cs8"))? == capture);
    assert!(std::fs::read(at.join("b.cs8"))? == capture);
    assert_eq!(std::fs::read(at.join("notes.txt"))?, b"mine");
    assert_eq!(std::fs::read(at.join("track.kml"))?, b"mine");
    // The navigation file of a folder of reports, the samples beside metadata, and what a simulation writes beside.
    std::fs::create_dir(at.join("fix"))?;
    std::fs::copy(at.join("a.nav.rnx"), at.join("fix/navigation.rnx"))?;
    std::fs::write(at.join("c.truth.json"), "mine")?;
    let known = ["process", "a.cs8", "--nav", "fix/navigation.rnx", "--out", "fix", "--force"];
    for (arguments, name) in [
        ([&known[..], &rate].concat(), "navigation.rnx"),
        (vec!["simulate", &scenario, "--duration", "0.05", "--out", "c.cs8"], "c.truth.json"),
    ] {
        let (code, message) = sdr_rx(at, &arguments);
        assert_eq!(code, 2, "{arguments:?}: {message}");
        assert!(message.contains(name), "{message}");
    }
    assert!(std::fs::read(at.join("fix/navigation.rnx"))? == std::fs::read(at.join("a.nav.rnx"))?);
    assert!(!at.join("c.cs8").exists());
    // What is ours is replaced, and with --force all but inputs.
    for _ in 0..2 {
        let (code, message) =
            sdr_rx(at, &[&["acquire", "a.cs8", "--json=r.json"][..], &rate].concat());
        assert_eq!(code, 0, "{message}");
    }
    let forced = ["acquire", "a.cs8", "--json=notes.txt", "--force", "-r", "2.6M"];
    assert_eq!(sdr_rx(at, &forced).0, 0);
    assert!(std::fs::read(at.join("notes.txt"))?.starts_with(b"{\"schema\":\"sdr-rx"));
    Ok(())
}

#[cfg(unix)]
#[test]
fn links_and_devices_are_written_through() -> Tested {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let folder = tempfile::tempdir()?;
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("signals/static_8sv.toml");
    let scenario = scenario.display().to_string();
    symlink(folder.path().join("there.json"), folder.path().join("link.json"))?;
    std::fs::write(folder.path().join("there.json"), "")?;
    let short = ["acquire", &scenario, "--duration", "0.05"];
    let (code, message) = sdr_rx(folder.path(), &[&short[..], &["--json=link.json"]].concat());
    assert_eq!(code, 0, "{message}");
    assert!(std::fs::symlink_metadata(folder.path().join("link.json"))?.is_symlink());
    assert!(std::fs::read(folder.path().join("there.json"))?.starts_with(b"{\"schema\""));
    // A device of our own is not at hand; as an ordinary user the folder of devices would refuse anyway.
    let (code, _) = sdr_rx(folder.path(), &[&short[..], &["--json=/dev/null"]].concat());
    assert_eq!(code, 0);
    assert!(std::fs::metadata("/dev/null")?.file_type().is_char_device());
    Ok(())
}

#[test]
fn reports_of_an_earlier_run_do_not_stay_beside_those_of_the_next() -> Tested {
    let folder = tempfile::tempdir()?;
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("signals/static_8sv.toml");
    let scenario = scenario.display().to_string();
    let run = |seconds: &str, page: &[&str]| {
        let arguments = ["process", &scenario, "--duration", seconds, "--out", "fix"];
        sdr_rx(folder.path(), &[&arguments[..], page].concat())
    };
    assert_eq!(run("20", &["--report"]).0, 0);
    let names = || -> Vec<String> {
        let entries = std::fs::read_dir(folder.path().join("fix")).into_iter().flatten().flatten();
        let mut names: Vec<String> =
            entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    };
    assert!(names().len() >= 7, "{:?}", names());
    // No fix in so short a time: observations, and no track.
    let before = names();
    assert_eq!(run("8", &[]).0, 1);
    assert_eq!(names().len(), 2, "{:?}", names());
    let new = |name: &&String| !before.contains(name);
    assert_eq!(names().iter().filter(new).count(), 1, "of another length");
    Ok(())
}
