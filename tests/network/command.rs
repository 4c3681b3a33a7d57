//! The command line: a network is made, run, and falsified.

use crate::common::{Failed, Tested};
use assert_cmd::Command;
use serde_json::Value;
use std::path::Path;

fn sdr_rx(arguments: &[&str]) -> Result<Command, Failed> {
    let mut command = Command::cargo_bin("sdr-rx")?;
    command.arg("network").args(arguments);
    Ok(command)
}

fn make(folder: &Path) -> Result<String, Failed> {
    let folder = folder.to_str().ok_or("a folder's name in UTF-8")?;
    sdr_rx(&["make", folder])?.assert().success();
    Ok(format!("{folder}/network.toml"))
}

fn run(arguments: &[&str]) -> Result<Value, Failed> {
    let output = sdr_rx(&[&["run"], arguments, &["--json"]].concat())?.output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned().into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

/// The largest difference of any node's parameters from the centre's.
fn off(result: &Value) -> Result<f64, Failed> {
    let centre = result["centre"]["x"].as_array().ok_or("no centre")?;
    let mut off = 0.0f64;
    for node in result["nodes"].as_array().ok_or("no nodes")? {
        for (x, c) in node["x"].as_array().ok_or("no x")?.iter().zip(centre) {
            off = off.max((x.as_f64().ok_or("x")? - c.as_f64().ok_or("c")?).abs());
        }
    }
    Ok(off)
}

/// The planned number of rounds leaves a billionth of the disagreement of some metres.
#[test]
fn a_simulated_network_agrees_with_a_centre_by_every_solver() -> Tested {
    let folder = tempfile::tempdir()?;
    let network = make(folder.path())?;
    let text = std::fs::read_to_string(&network)?;
    for (line, bound) in [
        ("solver = \"info\"", 1e-6),
        ("solver = \"tree\"", 1e-9),
        ("solver = \"admm\"\nrho = 1.0", 1e-6),
    ] {
        std::fs::write(&network, text.replace("solver = \"info\"", line))?;
        let off = off(&run(&[&network])?)?;
        if off > bound {
            return Err(format!("{line}: {off} off").into());
        }
    }
    Ok(())
}

#[test]
fn slow_clocks_and_lost_messages_change_nothing_but_the_time() -> Tested {
    let folder = tempfile::tempdir()?;
    let network = make(folder.path())?;
    for loss in ["0", "0.1", "0.5"] {
        let result = run(&["--asynchronous", "--loss", loss, "--rounds", "2000", &network])?;
        let off = off(&result)?;
        if off > 1e-9 {
            return Err(format!("{loss} lost: {off} off").into());
        }
    }
    Ok(())
}

#[test]
fn a_falsified_observation_is_identified_by_every_node_and_excluded() -> Tested {
    let folder = tempfile::tempdir()?;
    let network = make(folder.path())?;
    let correct = run(&[&network])?;
    let result = run(&["--fault", "N004:1:25", &network])?;
    for node in result["nodes"].as_array().ok_or("no nodes")? {
        let first = &node["named"][0];
        if (first["node"].as_u64(), first["observation"].as_u64()) != (Some(4), Some(1)) {
            return Err(format!("{} named {first}", node["name"]).into());
        }
        // Consistent with the unfalsified observations: within five standard deviations of their solution.
        let both = |key| node[key].as_array().into_iter().flatten().filter_map(Value::as_f64);
        let correct = correct["centre"]["x"].as_array().into_iter().flatten();
        for ((x, sigma), h) in both("x").zip(both("sigma")).zip(correct.filter_map(Value::as_f64)) {
            if (x - h).abs() > 5.0 * sigma {
                return Err(format!("{x} +- {sigma}, unfalsified {h}").into());
            }
        }
    }
    if result["nodes"][4]["excluded"][0] != 1 || off(&result)? > 1e-6 {
        return Err(format!("{}: {} off", result["nodes"][4], off(&result)?).into());
    }
    Ok(())
}

#[test]
fn mistakes_in_a_network_are_named() -> Tested {
    let folder = tempfile::tempdir()?;
    let network = make(folder.path())?;
    let text = std::fs::read_to_string(&network)?;
    let model = std::fs::read_to_string(folder.path().join("N003.json"))?;
    let refused = |expected: &str, arguments: &[&str]| -> Tested {
        let output = sdr_rx(&[&["run"], arguments].concat())?.output()?;
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        let right = output.status.code() == Some(2) && message.contains(expected);
        if right { Ok(()) } else { Err(format!("expected '{expected}', got '{message}'").into()) }
    };
    refused("No such file", &["nowhere.toml"])?;
    refused("no node 'N999'", &["--fault", "N999:0:1", &network])?;
    refused("observations, counted from 0", &["--fault", "N003:99:1", &network])?;
    refused("at least 0 and below 1", &["--asynchronous", "--loss", "1.5", &network])?;
    std::fs::write(&network, text.replace("made-1", "made-1\"\nrho = -1.0 #"))?;
    refused("rho is -1, must be above 0", &[&network])?;
    std::fs::write(&network, &text)?;
    let path = folder.path().join("N003.json");
    std::fs::write(&path, model.replacen("S0", "X0", 1))?;
    refused("the network has no parameter 'X0", &[&network])?;
    std::fs::write(&path, model.replacen("\"sigma\"", "\"sigma_m\"", 1))?;
    refused("unknown field `sigma_m`", &[&network])?;
    std::fs::remove_file(&path)?;
    refused("N003.json", &[&network])
}

#[test]
fn the_same_seed_makes_the_same_bytes() -> Tested {
    let folders = [tempfile::tempdir()?, tempfile::tempdir()?];
    let mut message = Vec::new();
    for folder in &folders {
        let network = make(folder.path())?;
        let out = folder.path().join("out");
        let out = out.to_str().ok_or("a folder's name in UTF-8")?;
        sdr_rx(&["run", "--asynchronous", "--loss", "0.2", "--out", out, &network])?
            .assert()
            .success();
        let read = |name| std::fs::read(folder.path().join("out").join(name));
        message.push((read("result.json")?, read("way.csv")?, read("way.svg")?));
    }
    if message[0] == message[1] { Ok(()) } else { Err("two runs differ".into()) }
}
