//! `sdr-rx network make`: a simulated network as files.

use super::files::Network;
use clap::ValueEnum;
use sdr_rx::gnss::random::SplitMix64;
use sdr_rx::network::file::{ModelFile, ObservationEntry};
use sdr_rx::network::scene::{NetworkLayout, StationScene};
use sdr_rx::network::{Datum, LinearModel};
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
    /// Seed of positions, satellites, biases and noise
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

impl From<LayoutArg> for NetworkLayout {
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
    let scene = StationScene::new(args.layout.into(), args.seed)?;
    let models = scene.models(0, Datum::ZeroMean, &mut SplitMix64::new(args.seed));
    let satellites = models.first().map_or(0, |model| model.design.ncols());
    let parameters: Vec<String> = (1..=satellites).map(|k| format!("S{k:02}")).collect();
    let node = |(station, model): (usize, LinearModel)| {
        let entry = |(k, (satellite, sine)): (usize, &(usize, f64))| ObservationEntry {
            coefficients: BTreeMap::from([(parameters[*satellite].clone(), 1.0)]),
            value: model.observations[k],
            sigma: StationScene::sigma_m(*sine),
        };
        let observations = scene.view(station, 0).iter().enumerate().map(entry).collect();
        (format!("N{station:03}"), ModelFile { receiver_bias: true, observations })
    };
    let nodes = models.into_iter().enumerate().map(node).collect();
    Network {
        name: format!("made-{}", args.seed),
        nodes,
        links: scene.graph.links().collect(),
        hubs: Some(scene.hubs),
        base_port: args.base_port,
        parameters,
    }
    .write(&args.folder)
}
