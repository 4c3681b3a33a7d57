//! All nodes of a network on this machine, each a process of its own, until all agree with the centre.
//!
//! ```sh
//! cargo run -- network make hubs110 --layout hubs
//! cargo run -p sdr-rx-node --example all_nodes -- hubs110/network.toml
//! ```

use anyhow::{Context, Result, ensure};
use clap::Parser;
use sdr_rx_network::Normals;
use sdr_rx_network::file::NetworkSetup;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Start all nodes of a network, and report when each is as near to the centre's solution as specified.
#[derive(Parser)]
struct Arguments {
    /// The network file; its nodes' addresses must be of this machine.
    network: PathBuf,
    /// When a node moves: synchronous or asynchronous.
    #[arg(long, default_value = "synchronous")]
    mode: String,
    /// Shortest time between two moves of a node (ms).
    #[arg(long, default_value_t = 20)]
    pace_ms: u64,
    /// How near, in the unit of the parameters.
    #[arg(long, default_value_t = 1e-3)]
    within: f64,
    /// Give up after so long (s).
    #[arg(long, default_value_t = 60)]
    patience_s: u64,
}

/// The processes, ended when dropped.
struct Nodes(Vec<Child>);

impl Drop for Nodes {
    fn drop(&mut self) {
        for child in &mut self.0 {
            // It may have ended by itself.
            _ = child.kill();
            _ = child.wait();
        }
    }
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let setup = NetworkSetup::read(&arguments.network)?;
    let count = setup.file.node.len();
    let mut sum = Normals::none(setup.agreement.parameters);
    for node in 0..count {
        sum.add(&setup.model(node)?.normals());
    }
    let centre = sum.solve(setup.agreement.datum)?;

    let example = std::env::current_exe()?;
    let folder = example.parent().and_then(Path::parent).context("no folder of programs")?;
    let program = folder.join("sdr-rx-node");
    ensure!(program.is_file(), "build it first: there is no '{}'", program.display());
    let folder = tempfile::tempdir()?;
    let network = std::fs::canonicalize(&arguments.network)?;
    let start = Instant::now();
    let mut nodes = Nodes(Vec::new());
    for (k, node) in setup.file.node.iter().enumerate() {
        let config = folder.path().join(format!("{k}.toml"));
        let text = format!(
            "network = {network:?}\nnode = {:?}\nmode = {:?}\npace_ms = {}\nstatus = \"{k}.jsonl\"\n\
             status_ms = 200\n",
            node.name, arguments.mode, arguments.pace_ms
        );
        std::fs::write(&config, text)?;
        nodes.0.push(Command::new(&program).arg(config).stdout(Stdio::null()).spawn()?);
    }
    let started = start.elapsed();
    let record = |k: usize| -> Option<Value> {
        let text = std::fs::read_to_string(folder.path().join(format!("{k}.jsonl"))).ok()?;
        let whole = &text[..text.rfind('\n')?];
        serde_json::from_str(whole.lines().last()?).ok()
    };
    let off = |record: &Value| -> Option<f64> {
        let x = record["x"].as_array()?.iter().zip(&centre.x);
        x.map(|(x, centre)| Some((x.as_f64()? - centre).abs()))
            .try_fold(0.0, |m, d| Some(d?.max(m)))
    };
    let near =
        |k| record(k).and_then(|record| off(&record)).is_some_and(|off| off < arguments.within);
    while !(0..count).all(near) {
        let late = start.elapsed() > Duration::from_secs(arguments.patience_s);
        let there = || (0..count).filter(|&k| near(k)).count();
        ensure!(!late, "after {} s {} of {count} are there", arguments.patience_s, there());
        std::thread::sleep(Duration::from_millis(100));
    }
    let settled = start.elapsed();
    let memory: Vec<f64> = nodes.0.iter().filter_map(|child| peak_memory(child.id())).collect();
    let last = (0..count).filter_map(record);
    let worst = last.clone().filter_map(|record| off(&record)).fold(0.0, f64::max);
    let result = json!({
        "nodes": count,
        "links": setup.file.links.len(),
        "mode": arguments.mode,
        "all_started_s": started.as_secs_f64(),
        "all_within_s": settled.as_secs_f64(),
        "within": arguments.within,
        "off": worst,
        "most_rounds": last.filter_map(|record| record["round"].as_u64()).max(),
        "peak_memory_mb": memory.iter().copied().fold(0.0, f64::max),
        "peak_memory_of_all_mb": memory.iter().sum::<f64>(),
    });
    println!("{result:#}");
    Ok(())
}

/// The most memory that a process has had in use (MB), where the system gives it.
fn peak_memory(process: u32) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? / 1024.0)
}
