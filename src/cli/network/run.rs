//! `sdr-rx network run`: all nodes of a network in one process.

use crate::cli::progress::thousandths;
use crate::cli::protect::protect;
use anyhow::{Context, ensure};
use sdr_rx::network::consensus::{NodeOptions, Rule};
use sdr_rx::network::file::NetworkSetup;
use sdr_rx::network::message::Suspect;
use sdr_rx::network::monitor::Verdict;
use sdr_rx::network::quality::{Levels, ModelTest};
use sdr_rx::network::sim::{self, Conditions, Simulation};
use sdr_rx::network::solver::{Estimate, NetworkSolver};
use sdr_rx::network::station::Station;
use sdr_rx::network::{LinearModel, NetworkSolution, Normals};
use sdr_rx::report::{Curve, LinePlot, OutputDir, write_atomically};
use serde_json::json;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// All nodes of a network in this process: the solution of each, compared with a centre's
///
/// Example: sdr-rx network make nine && sdr-rx network run nine/network.toml
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Run {
    /// The network, and the models that it names
    #[arg(value_name = "NETWORK.toml")]
    network: PathBuf,
    /// Iterations, or ticks of asynchronous nodes [default: as many as the graph needs, and as many again after
    /// an observation was taken out; 2000 for admm]
    #[arg(long, value_name = "N")]
    rounds: Option<u64>,
    /// Nodes have clocks of their own, and links delay
    #[arg(long)]
    asynchronous: bool,
    /// Probability that a message is lost, on asynchronous links
    #[arg(long, value_name = "PROBABILITY", default_value_t = 0.0, requires = "asynchronous")]
    loss: f64,
    /// Falsify an observation before the start: node, observation counted from 0, error; such as N004:1:8.5
    #[arg(long, value_name = "NODE:K:ERROR", value_parser = fault)]
    fault: Option<Fault>,
    /// Seed of clocks, delays and losses
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Write the solution, and the convergence as CSV and SVG, into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write the result as one JSON object to a file, or - for standard output
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true, default_missing_value = "-")]
    json: Option<PathBuf>,
}

/// An observation that is falsified.
#[derive(Clone, Debug)]
struct Fault {
    node: String,
    observation: usize,
    error: f64,
}

fn fault(text: &str) -> Result<Fault, String> {
    let mut parts = text.rsplitn(3, ':');
    let (error, observation, node) = (parts.next(), parts.next(), parts.next());
    let fault = (|| {
        let node = node?.to_owned();
        Some(Fault { node, observation: observation?.parse().ok()?, error: error?.parse().ok()? })
    })();
    fault.ok_or_else(|| "a node's name, a number from 0 and an error are needed: N004:1:8.5".into())
}

impl Fault {
    fn apply(&self, setup: &NetworkSetup, models: &mut [LinearModel]) -> anyhow::Result<()> {
        let observations = &mut models[setup.node(&self.node)?].observations;
        let count = observations.len();
        ensure!(
            self.observation < count,
            "--fault {}:{}: the node has {count} observations, counted from 0",
            self.node,
            self.observation
        );
        observations[self.observation] += self.error;
        Ok(())
    }
}

/// Multiple of the rounds that a graph needs after which no verdict is awaited.
const PATIENCE: u64 = 20;

/// Over-relaxation for links with losses and delays.
const ASYNCHRONOUS_RELAXATION: f64 = 1.3;

/// Runs the network and prints the results.
pub fn run(args: &Run) -> anyhow::Result<ExitCode> {
    let setup = NetworkSetup::read(&args.network)?;
    let count = setup.file.node.len();
    let mut models: Vec<LinearModel> =
        (0..count).map(|k| setup.model(k)).collect::<Result<_, _>>()?;
    if let Some(fault) = &args.fault {
        fault.apply(&setup, &mut models)?;
    }
    let options = options(args, &setup);
    let nodes = models.into_iter().enumerate();
    let nodes = nodes.map(|(id, model)| Station::new(id, &setup.agreement, model, options));
    let nodes: Vec<Station> = nodes.collect::<Result<_, _>>()?;
    let (nodes, trace) = drive(args, &setup, nodes)?;
    let centre = centre(&setup, &nodes)?;
    let found = Found { args, setup: &setup, centre: &centre, nodes: &nodes, trace: &trace };
    let json = args.json.iter().map(PathBuf::as_path);
    protect(json, std::slice::from_ref(&args.network), false)?;
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

/// A centre's solution of all observations that the nodes have accepted.
fn centre(setup: &NetworkSetup, nodes: &[Station]) -> anyhow::Result<NetworkSolution> {
    let mut sum = Normals::none(setup.agreement.parameters);
    nodes.iter().for_each(|node| sum.add(node.normals()));
    let solution = sum.solve(setup.agreement.datum);
    solution.with_context(|| format!("solving all of '{}' at once", setup.path.display()))
}

/// The convergence: after each round, the maximum difference of any node from the centre; none while too few messages
/// have arrived.
fn drive(
    args: &Run,
    setup: &NetworkSetup,
    nodes: Vec<Station>,
) -> anyhow::Result<(Vec<Station>, Vec<f64>)> {
    let worst = |nodes: &[Station], centre: &NetworkSolution| {
        let off = |found: &Estimate| (found.x() - &centre.x).amax();
        let each = nodes.iter().map(|node| node.read().as_ref().map_or(f64::INFINITY, off));
        each.fold(0.0, f64::max)
    };
    let excluded = |nodes: &[Station]| nodes.iter().map(|node| node.excluded().len()).sum();
    let mut goal = centre(setup, &nodes)?;
    let mut missing: usize = 0;
    let needed = setup.default_rounds(args.asynchronous);
    let mut rounds = args.rounds.unwrap_or(needed);
    let bar = thousandths()?;
    let mut trace = Vec::new();
    let conditions = Conditions { loss: args.loss, ..Conditions::default() };
    let mut simulation = Simulation::new(nodes, conditions, args.seed)?;
    // The run does not end while a detected fault is not yet excluded, or a node still waits for the others.
    let checked = args.rounds.is_none() && setup.agreement.solver != NetworkSolver::Admm;
    let waits = |node: &Station| matches!(node.verdict(), Verdict::Named(_) | Verdict::Unsettled);
    let open =
        |nodes: &[Station], now| checked && now < PATIENCE * needed && nodes.iter().any(waits);
    while (trace.len() as u64) < rounds || open(&simulation.nodes, trace.len() as u64) {
        match args.asynchronous {
            true => simulation.tick(),
            false => sim::iterate(&mut simulation.nodes),
        }
        let now = trace.len() as u64 + 1;
        let excluded: usize = excluded(&simulation.nodes);
        if excluded > missing {
            missing = excluded;
            goal = centre(setup, &simulation.nodes)?;
            rounds = args.rounds.unwrap_or(now + needed);
        }
        trace.push(worst(&simulation.nodes, &goal));
        bar.set_position(1000 * now / rounds.max(now));
    }
    bar.finish_and_clear();
    Ok((simulation.nodes, trace))
}

/// Whether two suspicions are of the same observation.
fn same(a: &Suspect, b: &Suspect) -> bool {
    (a.node, a.observation) == (b.node, b.observation)
}

/// Results to print.
struct Found<'a> {
    args: &'a Run,
    setup: &'a NetworkSetup,
    centre: &'a NetworkSolution,
    nodes: &'a [Station],
    trace: &'a [f64],
}

impl Found<'_> {
    /// The first round after which every node stays this near to the centre.
    fn settled(&self, within: f64) -> Option<usize> {
        let last_beyond = self.trace.iter().rposition(|off| off.is_nan() || *off >= within);
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
        text += &self.quality();
        let read = self.nodes.first().and_then(|node| node.read().ok());
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

    /// The nodes' verdicts on the observations.
    fn quality(&self) -> String {
        let name = |k: u32| self.setup.file.node[k as usize].name.as_str();
        let mut text = String::new();
        for (k, suspect) in self.named() {
            let by =
                self.nodes.iter().filter(|node| node.named().iter().any(|s| same(s, &suspect)));
            let owner = &self.nodes[suspect.node as usize];
            let gone = owner.excluded().contains(&(suspect.observation as usize));
            let _ = writeln!(
                text,
                "{}. observation {} of {} does not fit, |w| {:.1}: named by {} of {} nodes, {}",
                k + 1,
                suspect.observation,
                name(suspect.node),
                suspect.statistic,
                by.count(),
                self.nodes.len(),
                if gone { "taken out" } else { "kept" }
            );
        }
        let solution =
            self.nodes.first().and_then(|node| Some(node.read().ok()?.solution()?.clone()));
        if let Some(solution) = solution {
            let test = ModelTest::new(&solution, Levels::default().model);
            let _ = writeln!(
                text,
                "test of the model: {:.1}, of {} degrees of freedom, limit {:.1} at 1 %: {}\n",
                test.statistic,
                test.freedom.round(),
                test.limit,
                if test.rejects() { "rejected" } else { "passed" }
            );
        }
        text
    }

    /// All observations that any node suspects, each once.
    fn named(&self) -> impl Iterator<Item = (usize, Suspect)> {
        let mut all: Vec<Suspect> = Vec::new();
        for suspect in self.nodes.iter().flat_map(|node| node.named()) {
            if !all.iter().any(|known| same(known, suspect)) {
                all.push(*suspect);
            }
        }
        all.into_iter().enumerate()
    }

    fn json(&self) -> serde_json::Value {
        let agreement = &self.setup.agreement;
        let nodes: Vec<_> = (self.nodes.iter().zip(&self.setup.file.node))
            .map(|(node, entry)| {
                let read = node.read().ok();
                let solution = read.as_ref().and_then(|found| found.solution().cloned());
                json!({
                    "name": entry.name,
                    "x": read.as_ref().map(|found| found.x().as_slice().to_vec()),
                    "sigma": solution.as_ref().map(|s| s.sigma().as_slice().to_vec()),
                    "misfit": solution.as_ref().map(|s| s.misfit),
                    "freedom": solution.as_ref().map(|s| s.freedom),
                    "named": node.named(),
                    "excluded": node.excluded(),
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
