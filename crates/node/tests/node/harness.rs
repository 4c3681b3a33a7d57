//! A network of nine nodes (figure 5 of Khodabandeh & Teunissen 2019) as processes.

use sdr_rx_network::consensus::{NodeOptions, Rule};
use sdr_rx_network::file::{ModelFile, NetworkFile, NetworkSetup, NodeEntry, ObservationEntry};
use sdr_rx_network::message::Suspect;
use sdr_rx_network::sim::Participant;
use sdr_rx_network::station::Station;
use sdr_rx_network::{NINE_NODES, NetworkSolution, Normals};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tempfile::TempDir;

pub const NODES: usize = 9;
/// The constraint nodes of the figure.
const HUBS: [usize; 5] = [0, 2, 3, 5, 8];
/// A constraint node with the most neighbours, and a node that is none.
pub const CENTRAL_HUB: usize = 2;
pub const STATION: usize = 6;
const PARAMETERS: usize = 4;
const TRUTH: [f64; PARAMETERS] = [1.5, -0.7, 3.0, 0.2];

/// A status record, as far as the tests read it.
#[derive(Clone, Debug, Deserialize)]
pub struct Record {
    pub state: String,
    pub round: u64,
    pub x: Option<Vec<f64>>,
    pub settled: bool,
    #[serde(default)]
    pub named: Vec<Suspect>,
    #[serde(default)]
    pub excluded: Vec<usize>,
    pub live: Vec<usize>,
    pub missing: Vec<usize>,
    pub packets: Packets,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Packets {
    pub foreign: u64,
    pub lost: u64,
    pub refused: BTreeMap<String, u64>,
}

/// One network at a time, so that networks do not compete for the processor.
static TURN: Mutex<()> = Mutex::new(());

pub struct Network {
    _turn: MutexGuard<'static, ()>,
    folder: TempDir,
    pub setup: NetworkSetup,
    pub centre: NetworkSolution,
    processes: Vec<Option<Child>>,
}

/// The process of a node file, not yet started.
pub fn program(config: &std::path::Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sdr-rx-node"));
    command.arg(config).stdout(Stdio::null());
    command
}

impl Network {
    /// Writes the files of a network whose nodes have this in their own files too, and listen on free ports.
    pub fn new(node_file: &str) -> Self {
        Self::with_fault(node_file, None)
    }

    /// The same, with an error of 20 sigma in the first observation of a node; the centre excludes it.
    pub fn with_fault(node_file: &str, faulty: Option<usize>) -> Self {
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().unwrap();
        // All at once, so that they differ.
        let free: Vec<_> = (0..NODES).map(|_| TcpListener::bind("127.0.0.1:0").unwrap()).collect();
        let name = |k: usize| format!("N{k}");
        let node = (0..NODES).map(|k| NodeEntry {
            name: name(k),
            address: Some(format!("tcp/{}", free[k].local_addr().unwrap())),
            model: format!("{k}.json").into(),
        });
        let parameters: Vec<String> = (0..PARAMETERS).map(|k| format!("p{k}")).collect();
        let file = NetworkFile {
            name: "nine".into(),
            solver: Default::default(),
            datum: Default::default(),
            rho: None,
            relaxation: None,
            links: NINE_NODES.iter().map(|&(a, b)| (name(a), name(b))).collect(),
            constraint_nodes: Some(HUBS.iter().map(|&k| name(k)).collect()),
            node: node.collect(),
            parameters: parameters.clone(),
        };
        let write = |name: String, text: String| {
            std::fs::write(folder.path().join(name), text).unwrap();
        };
        write("network.toml".into(), toml::to_string(&file).unwrap());
        for k in 0..NODES {
            // Each node observes two of four parameters: none can determine all of them alone.
            // Their errors are within one sigma: the only fault is the requested one.
            let entry = |j: usize| {
                let (parameter, sigma) = ((k + j) % PARAMETERS, 0.2 + 0.05 * (k + j) as f64);
                let fault = if faulty == Some(k) && j == 0 { 20.0 } else { 0.0 };
                ObservationEntry {
                    coefficients: BTreeMap::from([(parameters[parameter].clone(), 1.0)]),
                    value: TRUTH[parameter] + sigma * (((3 * k + 7 * j) as f64).sin() + fault),
                    sigma,
                }
            };
            let observations = (0..2).map(entry).collect();
            let model = ModelFile { receiver_bias: false, observations };
            write(format!("{k}.json"), serde_json::to_string(&model).unwrap());
            let config = format!(
                "network = 'network.toml'\nnode = 'N{k}'\nstatus = '{k}.jsonl'\nstatus_ms = 50\n\
                 {node_file}"
            );
            write(format!("{k}.toml"), config);
        }
        let setup = NetworkSetup::read(&folder.path().join("network.toml")).unwrap();
        let mut sum = Normals::none(PARAMETERS);
        for k in 0..NODES {
            let model = setup.model(k).unwrap();
            let model = if faulty == Some(k) { model.without(0) } else { model };
            sum.add(&model.normals());
        }
        let centre = sum.solve(setup.agreement.datum).unwrap();
        let processes = (0..NODES).map(|_| None).collect();
        Self { _turn: turn, folder, setup, centre, processes }
    }

    /// With all of its nodes running: on a busy machine a program takes time to
    /// start.
    pub fn started(mut self) -> Self {
        (0..NODES).for_each(|k| self.start(k));
        self.until(60, |network| (0..NODES).all(|k| network.status(k).is_some()));
        self
    }

    pub fn path(&self, name: &str) -> std::path::PathBuf {
        self.folder.path().join(name)
    }

    pub fn start(&mut self, k: usize) {
        let process = program(&self.path(&format!("{k}.toml"))).spawn().unwrap();
        self.processes[k] = Some(process);
    }

    /// kill -9.
    pub fn kill(&mut self, k: usize) {
        let mut process = self.processes[k].take().unwrap();
        process.kill().unwrap();
        process.wait().unwrap();
        std::fs::remove_file(self.path(&format!("{k}.jsonl"))).unwrap();
    }

    pub fn signal(&self, k: usize, signal: &str) {
        let pid = self.processes[k].as_ref().unwrap().id().to_string();
        assert!(Command::new("kill").args([signal, &pid]).status().unwrap().success());
    }

    /// Waits for a process that was stopped; whether it ended without error.
    pub fn ended_well(&mut self, k: usize) -> bool {
        self.processes[k].take().unwrap().wait().unwrap().success()
    }

    /// The last status record of a node, as text.
    pub fn last_line(&self, k: usize) -> Option<String> {
        let text = std::fs::read_to_string(self.path(&format!("{k}.jsonl"))).ok()?;
        let whole = text.rfind('\n').map(|end| &text[..end])?;
        whole.lines().last().map(str::to_owned)
    }

    /// The last status record of a node.
    pub fn status(&self, k: usize) -> Option<Record> {
        self.last_line(k).map(|line| serde_json::from_str(&line).unwrap())
    }

    /// The largest difference of a node's estimate from a centre's solution.
    pub fn off(&self, k: usize) -> f64 {
        let Some(x) = self.status(k).and_then(|record| record.x) else { return f64::INFINITY };
        x.iter().zip(&self.centre.x).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    pub fn all_within(&self, bound: f64) -> bool {
        (0..NODES).all(|k| self.off(k) < bound)
    }

    /// Waits until something holds; how long that took. Panics, with the last status records, when it takes too
    /// long.
    pub fn until(&self, seconds: u64, holds: impl Fn(&Self) -> bool) -> Duration {
        let start = Instant::now();
        while !holds(self) {
            let late = start.elapsed() > Duration::from_secs(seconds);
            let records = || (0..NODES).map(|k| self.status(k)).collect::<Vec<_>>();
            assert!(!late, "not within {seconds} s; status records {:#?}", records());
            std::thread::sleep(Duration::from_millis(20));
        }
        start.elapsed()
    }

    /// Each node's solution after so many synchronous rounds, computed in this process.
    pub fn in_process(&self, rounds: u64) -> Vec<NetworkSolution> {
        let agreement = &self.setup.agreement;
        let options = NodeOptions {
            relaxation: self.setup.relaxation,
            rule: Rule::Synchronous,
            first_sequence: 0,
        };
        let station = |k| {
            let model = self.setup.model(k).unwrap();
            Station::new(k, agreement, model, options).unwrap()
        };
        let mut nodes: Vec<_> = (0..NODES).map(station).collect();
        let mut moves = [0; NODES];
        while moves.iter().any(|&moves| moves < rounds) {
            let sent: Vec<_> = nodes.iter().flat_map(|node| node.messages()).collect();
            sent.iter().for_each(|(to, message)| _ = nodes[*to].receive(message));
            for (node, moves) in nodes.iter_mut().zip(&mut moves) {
                if *moves < rounds {
                    *moves += u64::from(node.step());
                }
            }
        }
        nodes.iter().map(|node| node.read().unwrap().solution().unwrap().clone()).collect()
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        for process in self.processes.iter_mut().flatten() {
            // It may have ended by itself.
            _ = process.kill();
            _ = process.wait();
        }
    }
}
