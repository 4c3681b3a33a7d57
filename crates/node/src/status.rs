//! Status records of a node, as JSON Lines.

use anyhow::{Context, Result};
use sdr_rx_network::message::Suspect;
use sdr_rx_network::wire::Refused;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;
use std::time::Duration;

/// Counts of received packets.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Packets {
    /// With something new.
    pub taken: u64,
    /// Older than an earlier one of the sender.
    pub old: u64,
    /// Well formed, but of no neighbour.
    pub foreign: u64,
    /// Lost on purpose, for experiments.
    pub lost: u64,
    /// Refused, by reason.
    pub refused: BTreeMap<Refused, u64>,
}

/// One record.
#[derive(Debug, Serialize)]
pub struct StatusRecord<'a> {
    /// Number of the node.
    pub node: usize,
    /// Its name.
    pub name: &'a str,
    /// State: `waiting` for neighbours, `running`, `resting` after the last round, `ended`.
    pub state: &'a str,
    /// Seconds since the node started.
    pub elapsed_s: f64,
    /// Number of times that the estimate has been computed.
    pub round: u64,
    /// The estimate; absent until the observations received determine it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub x: Option<Vec<f64>>,
    /// Its standard deviations, where the solver gives them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Vec<f64>>,
    /// The largest |x_i - z_s| of the last move, in the units of what is agreed on.
    pub primal: f64,
    /// The largest |z_s - z_s before|.
    pub dual: f64,
    /// Whether all nodes are near agreement.
    pub settled: bool,
    /// Observations that the network found faulty.
    #[serde(skip_serializing_if = "<[Suspect]>::is_empty")]
    pub named: &'a [Suspect],
    /// This node's excluded observations, counted from 0.
    #[serde(skip_serializing_if = "<[usize]>::is_empty")]
    pub excluded: &'a [usize],
    /// Connected neighbours.
    pub live: &'a BTreeSet<usize>,
    /// Neighbours not connected.
    pub missing: Vec<usize>,
    /// Received packets.
    pub packets: &'a Packets,
}

/// Output of the records.
pub struct Log(Box<dyn Write>);

impl Log {
    /// Appends to a file, or writes to standard output for `-`.
    pub fn open(path: &Path) -> Result<Self> {
        if path == Path::new("-") {
            return Ok(Self(Box::new(std::io::stdout())));
        }
        let file = OpenOptions::new().create(true).append(true).open(path);
        Ok(Self(Box::new(
            file.with_context(|| format!("cannot write the status file '{}'", path.display()))?,
        )))
    }

    /// Writes one record, as one line at once.
    pub fn write(&mut self, record: &StatusRecord) -> Result<()> {
        let line = serde_json::to_string(record)? + "\n";
        let written = self.0.write_all(line.as_bytes()).and_then(|()| self.0.flush());
        written.context("cannot write a status record")
    }
}

/// When the next record is due.
pub struct Schedule {
    every: Duration,
    next: Duration,
}

impl Schedule {
    /// A record at once, then one every so often.
    pub fn new(every: Duration) -> Self {
        Self { every, next: Duration::ZERO }
    }

    /// Whether one is due at this time since the start.
    pub fn due(&mut self, now: Duration) -> bool {
        let due = now >= self.next;
        if due {
            self.next = now + self.every;
        }
        due
    }
}
