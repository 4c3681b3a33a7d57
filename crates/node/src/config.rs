//! The file of one node, beside the one that all nodes of the network share.

use anyhow::{Context, Result, bail, ensure};
use sdr_rx_network::file::NetworkSetup;
use sdr_rx_network::solver::NetworkSolver;
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// When a node moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// All nodes synchronous: fewest rounds; one silent node holds all.
    Synchronous,
    /// Each by its own clock, each link when its last message is acknowledged: for links that lose messages and
    /// nodes that come and go.
    #[default]
    Asynchronous,
}

/// A node's own file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodeFile {
    /// The network file, relative to this file's folder.
    pub network: PathBuf,
    /// Which of its nodes this is, by name.
    pub node: String,
    /// When it moves.
    #[serde(default)]
    pub mode: Mode,
    /// Over-relaxation; else the network file's; else 1.3 for asynchronous nodes, and planned from the graph for
    /// synchronous ones.
    pub relaxation: Option<f64>,
    /// Shortest time between two moves.
    #[serde(default = "five_milliseconds")]
    pub pace_ms: u64,
    /// Rest after so many moves; without, the node goes on until it is stopped.
    pub rounds: Option<u64>,
    /// Which observations these are: messages of another epoch are refused.
    #[serde(default)]
    pub epoch: u64,
    /// A neighbour that has been silent for so long is considered dead.
    #[serde(default = "ten_seconds")]
    pub lease_ms: u64,
    /// Probability that a packet that came in is thrown away, for experiments.
    #[serde(default)]
    pub loss: f64,
    /// Where the status records go, a file relative to this file's folder, or - for standard output.
    #[serde(default = "standard_output")]
    pub status: String,
    /// Time between two status records.
    #[serde(default = "one_second")]
    pub status_ms: u64,
    /// Encryption and authentication.
    #[serde(default)]
    pub security: Security,
}

/// Encryption and authentication, by zenoh; file names are relative to the node file's folder.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Security {
    /// The certificate (PEM) of the authority that signs the nodes' certificates; for addresses tls/...
    pub authority: Option<PathBuf>,
    /// This node's certificate (PEM).
    pub certificate: Option<PathBuf>,
    /// Its private key (PEM).
    pub key: Option<PathBuf>,
    /// This node's name at its neighbours.
    pub user: Option<String>,
    /// Its password.
    pub password: Option<String>,
    /// A file with a line `user:password` for each neighbour that may connect.
    pub users: Option<PathBuf>,
}

fn five_milliseconds() -> u64 {
    5
}

fn ten_seconds() -> u64 {
    10_000
}

fn one_second() -> u64 {
    1000
}

fn standard_output() -> String {
    "-".into()
}

/// Configuration of a node.
#[derive(Debug)]
pub struct Setup {
    /// The node's own file.
    pub file: NodeFile,
    /// The network.
    pub network: NetworkSetup,
    /// This node's number.
    pub id: usize,
    folder: PathBuf,
}

impl Setup {
    /// Reads a node's file and the network's, and checks both.
    pub fn read(path: &Path) -> Result<Self> {
        let doing = || format!("reading '{}'", path.display());
        let text = std::fs::read_to_string(path).with_context(doing)?;
        let file: NodeFile = toml::from_str(&text).with_context(doing)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let network = NetworkSetup::read(&folder.join(&file.network))?;
        let id = network.node(&file.node)?;
        let setup = Self { file, network, id, folder };
        setup.check().with_context(doing)?;
        Ok(setup)
    }

    fn check(&self) -> Result<()> {
        let (file, name) = (&self.file, &self.network.file.name);
        ensure!((0.0..1.0).contains(&file.loss), "loss is {}, must be in [0, 1)", file.loss);
        ensure!(file.lease_ms >= 100, "lease_ms is {}, must be at least 100", file.lease_ms);
        ensure!(file.status_ms > 0, "status_ms is 0, must be at least 1");
        ensure!(
            (1..=60_000).contains(&file.pace_ms),
            "pace_ms is {}, must be from 1 to 60000",
            file.pace_ms
        );
        let relaxation = self.relaxation();
        ensure!(
            relaxation > 0.0 && relaxation < 2.0,
            "relaxation is {relaxation}, must be above 0 and below 2"
        );
        ensure!(
            !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || "-_.".contains(c)),
            "the network's name '{name}' is part of the messages' keys: letters, digits, '-', '_' \
             and '.' only"
        );
        let security = &file.security;
        let tls = [&security.authority, &security.certificate, &security.key];
        let given = tls.iter().filter(|path| path.is_some()).count();
        ensure!(
            given == 0 || given == 3,
            "[security] needs authority, certificate and key together, or none of them"
        );
        ensure!(
            security.user.is_some() == security.password.is_some(),
            "[security] needs user and password together, or neither"
        );
        for path in tls.into_iter().chain([&security.users]).flatten() {
            let path = self.folder.join(path);
            ensure!(path.is_file(), "[security]: there is no file '{}'", path.display());
        }
        for node in self.neighbours().chain([self.id]) {
            let (address, name) = (self.address(node)?, &self.network.file.node[node].name);
            let encrypted = address.starts_with("tls/");
            ensure!(
                encrypted || address.starts_with("tcp/"),
                "the address of node '{name}' is '{address}': 'tcp/HOST:PORT' or 'tls/HOST:PORT' is right"
            );
            ensure!(
                encrypted == (given == 3),
                "node '{name}' has the address '{address}': with authority, certificate and key in \
                 [security] all addresses begin with tls/, without them with tcp/"
            );
            ensure!(
                !encrypted || cfg!(feature = "tls"),
                "the address '{address}' needs a program with encryption: build with --features tls"
            );
        }
        Ok(())
    }

    /// The neighbours, ascending.
    pub fn neighbours(&self) -> impl Iterator<Item = usize> {
        self.network.agreement.graph.neighbours(self.id).iter().copied()
    }

    /// The constraint nodes among the neighbours.
    pub fn stars(&self) -> Vec<usize> {
        let hubs = self.network.agreement.constraints.hubs_of(self.id);
        hubs.iter().copied().filter(|&hub| hub != self.id).collect()
    }

    /// Whether a move waits for the answers of all neighbours. The sums over a tree do not need that.
    pub fn is_synchronous(&self) -> bool {
        self.file.mode == Mode::Synchronous && self.network.agreement.solver != NetworkSolver::Tree
    }

    /// Shortest time between two moves.
    pub fn pace(&self) -> Duration {
        Duration::from_millis(self.file.pace_ms)
    }

    /// Over-relaxation alpha.
    pub fn relaxation(&self) -> f64 {
        let usual = match self.file.mode {
            Mode::Synchronous => self.network.relaxation,
            Mode::Asynchronous => self.network.file.relaxation.unwrap_or(1.3),
        };
        self.file.relaxation.unwrap_or(usual)
    }

    /// Where the status records go.
    pub fn status(&self) -> PathBuf {
        match self.file.status.as_str() {
            "-" => "-".into(),
            path => self.folder.join(path),
        }
    }

    fn address(&self, node: usize) -> Result<&str> {
        let entry = &self.network.file.node[node];
        match &entry.address {
            Some(address) => Ok(address),
            None => bail!(
                "node '{}' has no address in '{}': address = \"tcp/127.0.0.1:7401\" is one",
                entry.name,
                self.network.path.display()
            ),
        }
    }

    /// The configuration of zenoh: a peer connected to its configured neighbours only. The node
    /// of the larger number connects, and tries for ever (a timeout of 0 would mean once).
    pub fn zenoh(&self, longest_packet: usize) -> Result<Value> {
        let smaller = self.neighbours().filter(|&node| node < self.id);
        let endpoints: Vec<&str> = smaller.map(|node| self.address(node)).collect::<Result<_>>()?;
        let security = &self.file.security;
        let path = |path: &Option<PathBuf>| path.as_ref().map(|path| self.folder.join(path));
        let (certificate, key) = (path(&security.certificate), path(&security.key));
        Ok(json!({
            "mode": "peer",
            "listen": { "endpoints": [self.address(self.id)?] },
            "connect": {
                "endpoints": endpoints,
                "timeout_ms": -1,
                "exit_on_failure": false,
                "retry": { "period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5 },
            },
            "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
            "transport": {
                "link": {
                    "tx": { "lease": self.file.lease_ms },
                    // The engine's own messages need room too.
                    "rx": { "max_message_size": longest_packet + (1 << 20) },
                    "tls": {
                        "root_ca_certificate": path(&security.authority),
                        "listen_certificate": certificate,
                        "listen_private_key": key,
                        "connect_certificate": certificate,
                        "connect_private_key": key,
                        "enable_mtls": certificate.is_some(),
                    },
                },
                "auth": {
                    "usrpwd": {
                        "user": security.user,
                        "password": security.password,
                        "dictionary_file": path(&security.users),
                    },
                },
            },
        }))
    }
}
