//! A network's folder: network.toml, a model for each node, and a configuration for each process.

use anyhow::ensure;
use sdr_rx::network::file::{DatumName, ModelFile, NetworkFile, NodeEntry};
use sdr_rx::report::OutputDir;
use std::path::Path;
use std::process::ExitCode;

/// A network of receivers, each with a bias of its own.
pub(super) struct Network {
    pub name: String,
    /// Names of the common parameters.
    pub parameters: Vec<String>,
    /// Each node with its observations.
    pub nodes: Vec<(String, ModelFile)>,
    /// Links between nodes.
    pub links: Vec<(usize, usize)>,
    /// Constraint nodes, where they are not chosen from the graph.
    pub hubs: Option<Vec<usize>>,
    /// The first node's port on the loopback interface.
    pub base_port: u16,
}

impl Network {
    /// Writes all files, and prints their folder.
    pub fn write(self, path: &Path) -> anyhow::Result<ExitCode> {
        let count = self.nodes.len();
        ensure!(
            usize::from(self.base_port) + count < 65_536,
            "--base-port {}: {count} ports from there do not exist, take one below {}",
            self.base_port,
            65_536 - count
        );
        let folder = OutputDir::create(path)?;
        let name = |k: &usize| self.nodes[*k].0.clone();
        for (name, model) in &self.nodes {
            folder.write(&format!("{name}.json"), serde_json::to_string_pretty(model)? + "\n")?;
            let config = format!("network = \"network.toml\"\nnode = \"{name}\"\n");
            folder.write(&format!("{name}.toml"), config)?;
        }
        let entry = |(k, (name, _)): (usize, &(String, ModelFile))| NodeEntry {
            name: name.clone(),
            address: Some(format!("tcp/127.0.0.1:{}", usize::from(self.base_port) + k)),
            model: format!("{name}.json").into(),
        };
        let file = NetworkFile {
            solver: Default::default(),
            datum: DatumName::ZeroMean,
            rho: None,
            relaxation: None,
            links: self.links.iter().map(|(a, b)| (name(a), name(b))).collect(),
            constraint_nodes: self.hubs.as_ref().map(|hubs| hubs.iter().map(name).collect()),
            node: self.nodes.iter().enumerate().map(entry).collect(),
            name: self.name,
            parameters: self.parameters,
        };
        folder.write("network.toml", toml::to_string(&file)?)?;
        let links = file.links.len();
        println!("{count} nodes, {links} links: {}", path.join("network.toml").display());
        Ok(ExitCode::SUCCESS)
    }
}
