//! `sdr-rx network rinex`: real stations as a network.

use super::files::Network;
use anyhow::ensure;
use sdr_rx::gnss::format::{LeftOut, rinex_nav};
use sdr_rx::gnss::{NavigationData, Sv};
use sdr_rx::network::code_bias::{Carriers, elevation_weight};
use sdr_rx::network::file::rinex::{CodeOptions, StationEpoch, satellites, station_epochs};
use sdr_rx::network::file::{ModelFile, ObservationEntry};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

/// Make a network of real stations that estimate satellite code biases, from three-frequency RINEX observations:
/// the same files as `sdr-rx network make` writes
///
/// Example: sdr-rx network rinex pair base.obs rover.obs --nav base.nav
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Rinex {
    /// Write the files into this folder
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// A RINEX observation file for each station, each linked with the next
    #[arg(value_name = "OBS.rnx", required = true)]
    observations: Vec<PathBuf>,
    /// RINEX navigation files: elevations need orbits
    #[arg(long, value_name = "NAV.rnx", required = true, num_args = 1)]
    nav: Vec<PathBuf>,
    /// The three codes of L1, L2 and L5 that are combined, by their RINEX names
    #[arg(
        long,
        value_name = "A,B,C",
        value_delimiter = ',',
        num_args = 3,
        default_value = "C1C,C2L,C5Q"
    )]
    signals: Vec<String>,
    /// Leave lower satellites out, degrees
    #[arg(long, value_name = "DEG", default_value_t = 10.0)]
    elevation_mask: f64,
    /// Standard deviation of a code at the zenith, m
    #[arg(long, value_name = "M", default_value_t = 0.2)]
    sigma: f64,
    /// The nodes listen on this port of the loopback interface and those above it
    #[arg(long, value_name = "PORT", default_value_t = 7400)]
    base_port: u16,
}

/// Writes the files.
pub fn run(args: &Rinex) -> anyhow::Result<ExitCode> {
    ensure!(args.sigma > 0.0, "--sigma {}: must be above 0 m", args.sigma);
    let signals = <[String; 3]>::try_from(args.signals.clone());
    let signals = signals.map_err(|given| {
        anyhow::anyhow!(
            "--signals: three codes are needed, such as C1C,C2L,C5Q; these are {}",
            given.len()
        )
    })?;
    let options = CodeOptions {
        signals,
        carriers: Carriers::GPS,
        elevation_mask_rad: args.elevation_mask.to_radians(),
        zenith_sigma_m: args.sigma,
    };
    let mut navigation = NavigationData::default();
    for path in &args.nav {
        let file = rinex_nav::read(path)?;
        warn(&file.left_out);
        navigation.merge(file.data);
    }
    let mut stations: Vec<Vec<StationEpoch>> = Vec::new();
    for path in &args.observations {
        let file = station_epochs(path, &navigation, None, &options)?;
        warn(&file.left_out);
        stations.push(file.epochs);
    }
    let parameters = satellites(stations.iter().flatten());
    let names = args.observations.iter().map(|path| {
        let stem = path.file_stem().unwrap_or(path.as_os_str());
        stem.to_string_lossy().into_owned()
    });
    let nodes = names.zip(stations.iter().map(|epochs| model(epochs, &options))).collect();
    Network {
        name: args.folder.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        parameters: parameters.iter().map(Sv::to_string).collect(),
        nodes,
        links: (1..stations.len()).map(|k| (k - 1, k)).collect(),
        hubs: None,
        base_port: args.base_port,
    }
    .write(&args.folder)
}

/// Names what was left out of a file.
fn warn(left_out: &LeftOut) {
    left_out.kinds().iter().for_each(|kind| eprintln!("warning: {kind}"));
}

/// A station's whole file: the weighted mean of each satellite's combinations, with the assumption of white
/// errors and a constant receiver bias.
fn model(epochs: &[StationEpoch], options: &CodeOptions) -> ModelFile {
    let mut sums: BTreeMap<Sv, (f64, f64)> = BTreeMap::new();
    let zenith_variance = options.carriers.variance_factor() * options.zenith_sigma_m.powi(2);
    for combination in epochs.iter().flat_map(|epoch| &epoch.combinations) {
        let weight = elevation_weight(combination.elevation_rad) / zenith_variance;
        let (weights, values) = sums.entry(combination.sv).or_default();
        *weights += weight;
        *values += weight * combination.value_m;
    }
    let entry = |(sv, (weights, values)): (Sv, (f64, f64))| ObservationEntry {
        coefficients: BTreeMap::from([(sv.to_string(), 1.0)]),
        value: values / weights,
        sigma: weights.powf(-0.5),
    };
    ModelFile { receiver_bias: true, observations: sums.into_iter().map(entry).collect() }
}
