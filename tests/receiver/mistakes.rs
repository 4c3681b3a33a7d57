//! Mistakes in options: each message names the mistake and a remedy, and no exit code is 0.

use crate::common::{Tested, data};
use crate::program::{file, run};
use std::path::Path;

/// A capture with its correct options and some of its satellites: six are enough for advice, and quick.
const TOKYO: [&str; 2] = ["sim_tokyo_2.6MHz_1s_cs8.bin", "G10,G12,G13,G15,G18,G19"];
/// Its Dopplers are 7 to 12 kHz.
const CTTC: [&str; 2] = ["cttc_L1_4MHz_4ms_cf32.bin", "G29,G25,G31,G12,G02,G05"];
const POCKET_4: [&str; 2] = ["pocketsdr_L1_4MHz_iq_cs8.bin", "G26,G31,G29,G16,J02,J03"];
const POCKET_12: [&str; 2] = ["pocketsdr_L1_12MHz_real_s8.bin", "G05,G13,G20,G15,G30,J01"];

/// Runs `process` on a mistaken reading. The exit code must be 1 or 2, and the messages contain all parts.
fn named(data: &Path, [name, prn]: [&str; 2], options: &str, parts: &[&str]) -> Option<String> {
    let capture = file(data, &format!("captures/{name}"));
    let navigation = file(data, "nav/brdc0010.22n");
    let options = options.replace("NAV", &navigation);
    let mut arguments = vec!["process", &capture, "--prn", prn];
    arguments.extend(options.split_whitespace());
    complaint(&arguments, parts)
}

/// What is wrong with the answer, if anything.
fn complaint(arguments: &[&str], parts: &[&str]) -> Option<String> {
    let answer = match run(arguments) {
        Ok(answer) => answer,
        Err(error) => return Some(format!("{arguments:?}: {error:?}")),
    };
    let messages = answer.messages();
    let names = parts.iter().all(|part| messages.contains(part));
    let right = names && (answer.code == 1 || answer.code == 2);
    (!right).then(|| {
        format!(
            "{}: exit code {}, wanted {parts:?} in: {messages}",
            arguments[1..].join(" "),
            answer.code
        )
    })
}

fn all(complaints: impl IntoIterator<Item = Option<String>>) -> Tested {
    let list: Vec<String> = complaints.into_iter().flatten().collect();
    if list.is_empty() { Ok(()) } else { Err(list.join("\n").into()) }
}

#[test]
fn a_wrong_sample_type_is_named() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let complex = ["cs16", "cf32", "b1"];
    let tokyo = complex.map(|f| named(data, TOKYO, &format!("-f {f} -r 2.6M"), &["--format cs8"]));
    let pocket = named(data, POCKET_4, "-f cs16 -r 4M --conjugate", &["--format cs8"]);
    let real_for_complex = named(data, TOKYO, "-f rs8 -r 2.6M", &["real samples", "--if"]);
    let complex_for_real =
        named(data, POCKET_12, "-f cs8 -r 12M", &["--format rs8", "--if 3000000"]);
    all(tokyo.into_iter().chain([pocket, real_for_complex, complex_for_real]))
}

#[test]
fn a_wrong_rate_is_named() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    all([
        named(data, TOKYO, "-f cs8 -r 4M", &["--rate 2600000"]),
        named(data, TOKYO, "-f cs8 -r 2.5M", &["--rate 2600000"]),
        named(data, TOKYO, "-f cs8 -r 5.2M", &["--rate 2600000"]),
        named(data, POCKET_4, "-f cs8 -r 4.092M --conjugate", &["--rate 4000000"]),
        named(data, POCKET_12, "-f rs8 -r 6M --if 1.5M", &["--rate 12000000"]),
    ])
}

#[test]
fn a_wrong_intermediate_frequency_is_named() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    all([
        named(data, TOKYO, "-f cs8 -r 2.6M --if 420k", &["--if 0"]),
        named(data, TOKYO, "-f cs8 -r 2.6M --if=-48.75k", &["--if 0"]),
        // 12 kHz is 7.6 ppm: the satellites are found, and so is what shifts them.
        named(data, TOKYO, "-f cs8 -r 2.6M --if 12k", &["ppm off", "--if"]),
        named(data, CTTC, "-f cf32 -r 4M", &["ppm off", "--doppler-max"]),
        named(data, POCKET_12, "-f rs8 -r 12M --if 4.092M", &["--if 3000000"]),
        named(data, POCKET_12, "-f rs8 -r 12M --if 0", &["--if 3000000"]),
        named(data, POCKET_12, "-f rs8 -r 12M", &["real samples", "--if"]),
    ])
}

#[test]
fn a_wrong_sign_of_the_spectrum_is_named() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let fix = "--nav NAV --time 2190:525633";
    all([
        named(
            data,
            TOKYO,
            &format!("-f cs8 -r 2.6M --conjugate {fix}"),
            &["mirrored", "--conjugate"],
        ),
        named(data, POCKET_4, "-f cs8 -r 4M", &["mirrored", "--conjugate"]),
    ])
}

#[test]
fn a_wrong_date_or_time_is_named() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let other_nav = file(data, "orbits/sp3-2010-182/brdc1820.10n");
    let read = "-f cs8 -r 2.6M";
    all([
        named(
            data,
            TOKYO,
            &format!("{read} --nav {other_nav} --time 2190:525633"),
            &["hours from the given time", "navigation file"],
        ),
        named(
            data,
            TOKYO,
            &format!("{read} --nav NAV --time 2022-01-02T02:00:15Z"),
            &["hours from the given time", "navigation file"],
        ),
        named(data, TOKYO, &format!("{read} --nav NAV --time 2190:525933"), &["time"]),
        named(data, TOKYO, &format!("{read} --nav NAV --time 2190:511233"), &["time"]),
    ])
}

#[test]
fn what_is_missing_for_a_fix_is_named() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    all([
        named(data, TOKYO, "-f cs8 -r 2.6M", &["--nav", "--time"]),
        named(data, TOKYO, "-f cs8 -r 2.6M --nav NAV", &["--time"]),
        named(data, TOKYO, "-f cs8 -r 2.6M --time 2190:525633", &["--nav"]),
        named(data, TOKYO, "-f cs8", &["--rate"]),
        named(data, TOKYO, "-r 2.6M", &["--format"]),
    ])
}

#[test]
fn files_that_hold_no_samples_are_named() -> Tested {
    let folder = tempfile::tempdir()?;
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (empty, none, text) = (path("empty.cs8"), path("none.cs8"), path("text.cs8"));
    std::fs::write(&empty, b"")?;
    std::fs::write(&text, b"not samples\n")?;
    let zeros = path("zeros.cs8");
    std::fs::write(&zeros, vec![0u8; 200_000])?;
    let process = |file: &str, parts: &[&str]| complaint(&["process", file, "-r", "2.6M"], parts);
    let folder_name = folder.path().display().to_string();
    all([
        process(&empty, &["empty"]),
        process(&none, &["none.cs8"]),
        process(&text, &["few"]),
        process(&zeros, &["no satellite"]),
        complaint(&["process", &folder_name, "-f", "cs8", "-r", "2.6M"], &["directory"]),
        complaint(&["process", &zeros, "-r", "2.6M", "--nav", &text], &["text.cs8"]),
    ])
}
