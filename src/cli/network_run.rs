//! `sdr-rx network run`: all nodes of a network in one process.

use super::experiment::thousandths;
use anyhow::Context;
use sdr_rx::network::consensus::{NodeOptions, Rule};
use sdr_rx::network::sim::{self, Conditions, Participant, Simulation};
use sdr_rx::network::{LinearModel, Normals, Solution};
use sdr_rx::network_file::NetworkSetup;
use sdr_rx::report::{Curve, LinePlot, OutputDir, write_atomically};
use serde_json::json;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// All nodes of a network in this process: what each arrives at, beside what a centre would have computed
///
/// Example: sdr-rx network make nine && sdr-rx network run nine/network.toml
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Run {
    /// The network, and the models that it names
    #[arg(value_name = "NETWORK.toml")]
    network: PathBuf,
    /// Iterations, or ticks of asynchronous nodes [default: as many as the graph needs, 2000 for admm]
    #[arg(long, value_name = "N")]
    rounds: Option<u64>,
    /// Nodes have clocks of their own, and links delay
    #[arg(long)]
    asynchronous: bool,
    /// Share of messages that are lost, on asynchronous links
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, requires = "asynchronous")]
    loss: f64,
    /// Clocks, delays and losses are drawn from this
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Write the solution, and the way there as CSV and SVG, into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write the result as one JSON object to a file, or - for standard output
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
}

/// Steadiest over links that lose and delay.
const ASYNCHRONOUS_RELAXATION: f64 = 1.3;

type Nodes = Vec<Box<dyn Participant + Send>>;

/// Runs the network and prints what came out.
pub fn run(args: &Run) -> anyhow::Result<ExitCode> {
    let setup = NetworkSetup::read(&args.network)?;
    let count = setup.file.node.len();
    let models: Vec<LinearModel> = (0..count).map(|k| setup.model(k)).collect::<Result<_, _>>()?;
    let mut sum = Normals::none(setup.agreement.parameters);
    let normals: Vec<Normals> = models.iter().map(LinearModel::normals).collect();
    normals.iter().for_each(|one| sum.add(one));
    let centre = sum.solve(setup.agreement.datum).with_context(|| {
        format!("solving all of '{}' at once, to compare with", args.network.display())
    })?;

    let options = options(args, &setup);
    let nodes = normals.iter().enumerate();
    let nodes = nodes.map(|(id, one)| setup.agreement.participant(id, one, options));
    let nodes: Nodes = nodes.collect::<Result<_, _>>()?;
    let (nodes, trace) = drive(args, &setup, nodes, &centre)?;
    let found = Found { args, setup: &setup, centre: &centre, nodes: &nodes, trace: &trace };
    if let Some(folder) = &args.out {
        found.write(&OutputDir::create(folder)?)?;
    }
    match &args.json {
        Some(path) if path.as_os_str() == "-" => println!("{}", found.json()),
        Some(path) => write_atomically(path, format!("{}\n", found.json()).as_bytes())?,
        None => print!("{}", found.text()),
    }
    Ok(ExitCode::SUCCESS)
}

fn options(args: &Run, setup: &NetworkSetup) -> NodeOptions {
    let (rule, relaxation) = match args.asynchronous {
        false => (Rule::Synchronous, setup.relaxation),
        true => (Rule::Acknowledged, setup.file.relaxation.unwrap_or(ASYNCHRONOUS_RELAXATION)),
    };
    NodeOptions { relaxation, rule, first_sequence: 0 }
}

/// The way there: after each round, the largest difference of any node from the centre, none while too little
/// has been heard.
fn drive(
    args: &Run,
    setup: &NetworkSetup,
    nodes: Nodes,
    centre: &Solution,
) -> anyhow::Result<(Nodes, Vec<f64>)> {
    let rounds = args.rounds.unwrap_or_else(|| setup.default_rounds(args.asynchronous));
    let off = |node: &Box<dyn Participant + Send>| {
        let read = setup.agreement.read(node.estimate());
        read.map_or(f64::INFINITY, |found| (found.x() - &centre.x).amax())
    };
    let worst = |nodes: &Nodes| nodes.iter().map(off).fold(0.0, f64::max);
    let bar = thousandths()?;
    let mut trace = Vec::new();
    let conditions = Conditions { loss: args.loss, ..Conditions::default() };
    let mut simulation = Simulation::new(nodes, conditions, args.seed)?;
    for round in 0..rounds {
        match args.asynchronous {
            true => simulation.tick(),
            false => sim::iterate(&mut simulation.nodes),
        }
        trace.push(worst(&simulation.nodes));
        bar.set_position(1000 * (round + 1) / rounds);
    }
    bar.finish_and_clear();
    Ok((simulation.nodes, trace))
}

/// What there is to print.
struct Found<'a> {
    args: &'a Run,
    setup: &'a NetworkSetup,
    centre: &'a Solution,
    nodes: &'a Nodes,
    trace: &'a [f64],
}

impl Found<'_> {
    /// The first round after which every node stays this near to the centre.
    fn settled(&self, within: f64) -> Option<usize> {
        let last_beyond = self.trace.iter().rposition(|off| !(*off < within));
        let first = last_beyond.map_or(0, |k| k + 1);
        (first < self.trace.len()).then_some(first + 1)
    }

    fn text(&self) -> String {
        let agreement = &self.setup.agreement;
        let name = |k: usize| self.setup.file.node[k].name.as_str();
        let hubs: Vec<&str> = agreement.constraints.hubs().iter().map(|&k| name(k)).collect();
        let mut text = format!(
            "{}: {} nodes, {} links, constraint nodes {}\n",
            self.setup.file.name,
            agreement.graph.nodes(),
            agreement.graph.links().count(),
            hubs.join(" ")
        );
        let unit = if self.args.asynchronous { "ticks" } else { "rounds" };
        let within = |bound| match self.settled(bound) {
            Some(round) => format!("{round} {unit}"),
            None => format!("not within {} {unit}", self.trace.len()),
        };
        let _ = writeln!(
            text,
            "every node within 1e-3 of a centre's solution: {}; within 1e-6: {}; at the end {:.1e} off\n",
            within(1e-3),
            within(1e-6),
            self.trace.last().copied().unwrap_or(f64::INFINITY)
        );
        let read = self.nodes.first().and_then(|n| agreement.read(n.estimate()).ok());
        let _ = writeln!(
            text,
            "{:>12}  {:>12}  {:>10}  {:>12}",
            "parameter", "node", "sigma", "centre"
        );
        for (k, parameter) in self.setup.file.parameters.iter().enumerate() {
            let x = read.as_ref().map_or(f64::NAN, |found| found.x()[k]);
            let solution = read.as_ref().and_then(|found| found.solution());
            let sigma = solution.map_or("-".into(), |s| format!("{:.6}", s.sigma()[k]));
            let centre = self.centre.x[k];
            let _ = writeln!(text, "{parameter:>12}  {x:>12.6}  {sigma:>10}  {centre:>12.6}");
        }
        text
    }

    fn json(&self) -> serde_json::Value {
        let agreement = &self.setup.agreement;
        let nodes: Vec<_> = (self.nodes.iter().zip(&self.setup.file.node))
            .map(|(node, entry)| {
                let read = agreement.read(node.estimate()).ok();
                let solution = read.as_ref().and_then(|found| found.solution().cloned());
                json!({
                    "name": entry.name,
                    "x": read.as_ref().map(|found| found.x().as_slice().to_vec()),
                    "sigma": solution.map(|s| s.sigma().as_slice().to_vec()),
                })
            })
            .collect();
        let hubs = agreement.constraints.hubs();
        json!({
            "schema": "sdr-rx-network/1",
            "network": self.setup.file.name,
            "parameters": self.setup.file.parameters,
            "solver": agreement.solver,
            "constraint_nodes": hubs.iter().map(|&k| &self.setup.file.node[k].name).collect::<Vec<_>>(),
            "rho": agreement.rho,
            "asynchronous": self.args.asynchronous,
            "loss": self.args.loss,
            "seed": self.args.seed,
            "rounds": self.trace.len(),
            "rounds_to_1e-3": self.settled(1e-3),
            "rounds_to_1e-6": self.settled(1e-6),
            "off": self.trace.last(),
            "centre": {"x": self.centre.x.as_slice(), "sigma": self.centre.sigma().as_slice()},
            "nodes": nodes,
        })
    }

    fn write(&self, folder: &OutputDir) -> anyhow::Result<()> {
        let points = self.trace.iter().enumerate().map(|(k, off)| ((k + 1) as f64, *off)).collect();
        let unit = if self.args.asynchronous { "tick" } else { "round" };
        let plot = LinePlot {
            name: "way".into(),
            title: format!("{}: the farthest node from a centre's solution", self.setup.file.name),
            axes: [unit.into(), "difference".into()],
            log: [false, true],
            curves: vec![Curve { name: "farthest node".into(), points }],
        };
        folder.write("way.csv", plot.csv())?;
        folder.write("way.svg", plot.svg()?)?;
        folder.write("result.json", format!("{:#}\n", self.json()))?;
        Ok(())
    }
}
