//! `sdr-rx network make`: a made network as files.

use clap::ValueEnum;
use sdr_rx::experiment::SplitMix64;
use sdr_rx::experiment::distributed_ls::scene::{Layout, Scene};
use sdr_rx::network::Datum;
use sdr_rx::network_file::{DatumName, ModelFile, NetworkFile, NodeEntry, ObservationEntry};
use sdr_rx::report::OutputDir;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

/// Make a network of simulated stations that estimate satellite code biases: network.toml, a model for each
/// station, and a configuration for each process of `sdr-rx-node`
///
/// Example: sdr-rx network make nine && sdr-rx network run nine/network.toml
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Make {
    /// Write the files into this folder
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Which network
    #[arg(long, value_name = "WHICH", default_value = "nine")]
    layout: LayoutArg,
    /// Places, sky, biases and noise are drawn from this
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// The nodes listen on this port of the loopback interface and those above it
    #[arg(long, value_name = "PORT", default_value_t = 7400)]
    base_port: u16,
}

#[derive(Clone, Copy, ValueEnum)]
enum LayoutArg {
    /// The nine nodes of a paper's figure
    Nine,
    /// 110 stations in eight regions, nine hubs that are linked among themselves
    Hubs,
    /// The same, the hubs linked by stations between them
    Bridges,
}

impl From<LayoutArg> for Layout {
    fn from(arg: LayoutArg) -> Self {
        match arg {
            LayoutArg::Nine => Self::Nine,
            LayoutArg::Hubs => Self::Hubs,
            LayoutArg::Bridges => Self::Bridges,
        }
    }
}

/// Writes the files.
pub fn run(args: &Make) -> anyhow::Result<ExitCode> {
    let scene = Scene::new(args.layout.into(), args.seed)?;
    let nodes = scene.graph.nodes();
    anyhow::ensure!(
        usize::from(args.base_port) + nodes < 65_536,
        "--base-port {}: {nodes} ports from there do not exist, take one below {}",
        args.base_port,
        65_536 - nodes
    );
    let names: Vec<String> = (0..nodes).map(|k| format!("N{k:03}")).collect();
    let models = scene.models(0, Datum::ZeroMean, &mut SplitMix64::new(args.seed));
    let satellites = models.first().map_or(0, |model| model.design.ncols());
    let parameters: Vec<String> = (1..=satellites).map(|k| format!("S{k:02}")).collect();
    let folder = OutputDir::create(&args.folder)?;
    for (station, name) in names.iter().enumerate() {
        let view = scene.view(station, 0);
        let entry = |(k, (satellite, sine)): (usize, &(usize, f64))| ObservationEntry {
            coefficients: BTreeMap::from([(parameters[*satellite].clone(), 1.0)]),
            value: models[station].observations[k],
            sigma: Scene::sigma_m(*sine),
        };
        let observations = view.iter().enumerate().map(entry).collect();
        let model = ModelFile { receiver_bias: true, observations };
        folder.write(&format!("{name}.json"), serde_json::to_string_pretty(&model)? + "\n")?;
        let config = format!("network = \"network.toml\"\nnode = \"{name}\"\n");
        folder.write(&format!("{name}.toml"), config)?;
    }
    let entry = |(k, name): (usize, &String)| NodeEntry {
        name: name.clone(),
        address: Some(format!("tcp/127.0.0.1:{}", usize::from(args.base_port) + k)),
        model: format!("{name}.json").into(),
    };
    let file = NetworkFile {
        name: format!("made-{}", args.seed),
        solver: Default::default(),
        datum: DatumName::ZeroMean,
        rho: None,
        relaxation: None,
        links: scene.graph.links().map(|(a, b)| (names[a].clone(), names[b].clone())).collect(),
        constraint_nodes: Some(scene.hubs.iter().map(|&hub| names[hub].clone()).collect()),
        node: names.iter().enumerate().map(entry).collect(),
        parameters,
    };
    folder.write("network.toml", toml::to_string(&file)?)?;
    println!(
        "{nodes} nodes, {} links: {}",
        file.links.len(),
        args.folder.join("network.toml").display()
    );
    Ok(ExitCode::SUCCESS)
}
