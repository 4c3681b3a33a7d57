//! A network of receivers as files: nodes and links (TOML), and the observations of each node (JSON).

mod error;
mod model;
pub mod rinex;

pub use error::NetworkFileError;
pub use model::{ModelFile, ObservationEntry};

use crate::solver::{Agreement, NetworkSolver};
use crate::{Constraints, Datum, Graph, LinearModel, constraints, plan};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A file that all nodes of a network share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkFile {
    /// Name of the network: messages of others are refused.
    pub name: String,
    /// Names of the common parameters, in the order of all vectors.
    pub parameters: Vec<String>,
    /// Solver.
    #[serde(default)]
    pub solver: NetworkSolver,
    /// What fixes the parameters: "observed", or "zero-mean" where every receiver has a bias of its own.
    #[serde(default)]
    pub datum: DatumName,
    /// Weight of agreement; where it is not given, planned from the graph for the solver "info".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rho: Option<f64>,
    /// Over-relaxation of synchronous nodes; planned from the graph where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relaxation: Option<f64>,
    /// Links: pairs of nodes, by name.
    pub links: Vec<(String, String)>,
    /// The constraint nodes by name; chosen from the graph where they are not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub constraint_nodes: Option<Vec<String>>,
    /// The nodes.
    pub node: Vec<NodeEntry>,
}

/// A node of a network file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodeEntry {
    /// Its name.
    pub name: String,
    /// Address, for nodes that are processes of their own: `tcp/127.0.0.1:7401`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub address: Option<String>,
    /// Its observations, a JSON file; relative to the network file's folder.
    pub model: PathBuf,
}

/// The datum by its name in files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DatumName {
    /// [`Datum::Observed`].
    #[default]
    Observed,
    /// [`Datum::ZeroMean`].
    ZeroMean,
}

impl From<DatumName> for Datum {
    fn from(name: DatumName) -> Self {
        match name {
            DatumName::Observed => Self::Observed,
            DatumName::ZeroMean => Self::ZeroMean,
        }
    }
}

/// A network that can run.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkSetup {
    /// The file.
    pub file: NetworkFile,
    /// Its path.
    pub path: PathBuf,
    /// Graph, constraint nodes, solver and weight.
    pub agreement: Agreement,
    /// Over-relaxation of synchronous nodes.
    pub relaxation: f64,
    /// Fraction of a disagreement that remains after a round, where the settings were planned.
    pub radius: Option<f64>,
}

impl NetworkSetup {
    /// Reads a network file, checks it, and plans what it does not specify. The nodes' own files are not read.
    ///
    /// # Errors
    /// [`NetworkFileError`].
    pub fn read(path: &Path) -> Result<Self, NetworkFileError> {
        let text = error::read(path)?;
        let file: NetworkFile = toml::from_str(&text).map_err(|source| NetworkFileError::Toml {
            path: path.into(),
            source: Box::new(source),
        })?;
        Self::new(file, path)
    }

    /// Checks a network file that is to lie at `path`, and plans what it does not specify.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn new(file: NetworkFile, path: &Path) -> Result<Self, NetworkFileError> {
        let wrong = |what: String| NetworkFileError::Content { path: path.into(), what };
        let unusable = |source| NetworkFileError::Network { path: path.into(), source };
        require_distinct("node", file.node.iter().map(|node| &node.name)).map_err(wrong)?;
        require_distinct("parameter", file.parameters.iter()).map_err(wrong)?;
        let links: Result<Vec<_>, _> =
            file.links.iter().map(|(a, b)| Ok((file.find(a)?, file.find(b)?))).collect();
        let graph = Graph::new(file.node.len(), &links.map_err(wrong)?).map_err(unusable)?;
        let constraints = match &file.constraint_nodes {
            None => constraints::choose(&graph),
            Some(names) => {
                let hubs: Result<Vec<_>, _> = names.iter().map(|name| file.find(name)).collect();
                Constraints::new(&graph, &hubs.map_err(wrong)?)
            }
        }
        .map_err(unusable)?;
        let planned = (file.rho.is_none() || file.relaxation.is_none())
            .then(|| plan::plan(&constraints).map_err(unusable))
            .transpose()?;
        let rho = match (file.rho, file.solver, planned) {
            (Some(rho), ..) => rho,
            (None, NetworkSolver::Admm, _) => {
                return Err(wrong(
                    "solver = \"admm\" needs rho: half the mean diagonal element of the nodes' normal \
                     matrices is a good value"
                        .into(),
                ));
            }
            (None, _, planned) => planned.map_or(1.0, |plan| plan.rho),
        };
        let relaxation = match (file.relaxation, file.solver, planned) {
            (Some(relaxation), ..) => relaxation,
            (None, NetworkSolver::Info, Some(plan)) => plan.relaxation,
            (None, ..) => 1.6,
        };
        let (solver, datum, parameters) = (file.solver, file.datum.into(), file.parameters.len());
        let agreement = Agreement { graph, constraints, solver, rho, datum, parameters };
        let radius = planned.filter(|_| file.rho.is_none() && file.relaxation.is_none());
        let radius = radius.map(|plan| plan.radius);
        Ok(Self { file, path: path.into(), agreement, relaxation, radius })
    }

    /// Rounds, or ticks of nodes with clocks of their own, that leave a billionth of a disagreement; for the
    /// paper's solver, whose speed depends on the observations, 2000.
    pub fn default_rounds(&self, asynchronous: bool) -> u64 {
        let nodes = self.agreement.graph.nodes() as u64;
        let in_step = match self.agreement.solver {
            NetworkSolver::Info => {
                self.radius.map_or(200, |radius| (1e-9f64.ln() / radius.ln()) as u64 + 1)
            }
            NetworkSolver::Admm => 2000,
            NetworkSolver::Tree => nodes,
        };
        // Two exchanges a round, each of a few ticks.
        if asynchronous { 12 * in_step } else { in_step }
    }

    /// Number of the node of this name.
    ///
    /// # Errors
    /// [`NetworkFileError::Content`] with the names that there are.
    pub fn node(&self, name: &str) -> Result<usize, NetworkFileError> {
        let wrong = |what| NetworkFileError::Content { path: self.path.clone(), what };
        self.file.find(name).map_err(wrong)
    }

    /// Reads the observations of a node.
    ///
    /// # Errors
    /// [`NetworkFileError`].
    pub fn model(&self, node: usize) -> Result<LinearModel, NetworkFileError> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        ModelFile::read(&folder.join(&self.file.node[node].model), &self.file.parameters)
    }
}

impl NetworkFile {
    fn find(&self, name: &str) -> Result<usize, String> {
        let found = self.node.iter().position(|node| node.name == name);
        found.ok_or_else(|| {
            let names: Vec<&str> = self.node.iter().map(|node| node.name.as_str()).collect();
            format!("there is no node '{name}': the nodes are {}", names.join(", "))
        })
    }
}

fn require_distinct<'a>(
    what: &str,
    names: impl Iterator<Item = &'a String> + Clone,
) -> Result<(), String> {
    if names.clone().next().is_none() {
        return Err(format!("there is no {what}: at least one is needed"));
    }
    let mut seen = std::collections::BTreeSet::new();
    match names.into_iter().find(|name| !seen.insert(name.as_str())) {
        Some(twice) => Err(format!("the {what} '{twice}' is listed twice: names must differ")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const THREE: &str = r#"
        name = "three"
        parameters = ["a", "b"]
        links = [["A", "B"], ["B", "C"]]
        node = [
            { name = "A", model = "a.json" },
            { name = "B", model = "b.json" },
            { name = "C", model = "c.json" },
        ]
    "#;

    fn setup(text: &str) -> Result<NetworkSetup, NetworkFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("network.toml");
        std::fs::write(&path, text).unwrap();
        NetworkSetup::read(&path)
    }

    #[test]
    fn unspecified_settings_are_planned_from_the_graph() {
        let setup = setup(THREE).unwrap();
        assert_eq!(setup.agreement.constraints.hubs(), [1]);
        assert_eq!(setup.agreement.solver, NetworkSolver::Info);
        assert!(setup.agreement.rho > 0.0 && setup.relaxation > 0.0);
    }

    #[test]
    fn each_mistake_is_named() {
        let cases = [
            (
                THREE.replace("[\"B\", \"C\"]", "[\"B\", \"D\"]"),
                "no node 'D': the nodes are A, B, C",
            ),
            (THREE.replace(", [\"B\", \"C\"]", ""), "falls into 2 parts"),
            (THREE.replace("\"a\", \"b\"", "\"a\", \"a\""), "the parameter 'a' is listed twice"),
            (THREE.replace("\"a\", \"b\"", ""), "there is no parameter"),
            (THREE.replace("name = \"C\"", "name = \"A\""), "the node 'A' is listed twice"),
            (format!("solver = \"admm\"\n{THREE}"), "needs rho"),
            (format!("constraint_nodes = [\"A\"]\n{THREE}"), "without a star"),
            (format!("colour = 3\n{THREE}"), "unknown field `colour`"),
            (format!("solver = \"magic\"\n{THREE}"), "unknown variant `magic`"),
        ];
        for (text, expected) in cases {
            let message = setup(&text).unwrap_err().to_string();
            assert!(message.contains(expected) && message.contains("network.toml"), "{message}");
        }
    }
}
