//! A receiver in its network: the solver's state machine with quality control.

use super::admm::{NodeLeastSquares, Weight};
use super::consensus::{Node, NodeOptions, Received, Residuals};
use super::info::{self, Average};
use super::message::{News, NodeMessage, Suspect};
use super::monitor::{Monitor, Verdict};
use super::quality::Levels;
use super::sim::Participant;
use super::solver::{Agreement, Estimate, NetworkSolver};
use super::tree::TreeNode;
use super::{LinearModel, NetworkError, Normals};

/// A node for a transport.
#[derive(Clone, Debug)]
pub struct Station {
    agreement: Agreement,
    machine: Machine,
    /// Normal equations of the node's accepted observations.
    normals: Normals,
    /// For solvers that give a covariance.
    monitor: Option<Monitor>,
    verdict: Verdict,
    named: Vec<Suspect>,
    excluded: Vec<usize>,
}

/// The solver's state machine.
#[derive(Clone, Debug)]
enum Machine {
    Info(Node<Average>),
    Admm(Node<NodeLeastSquares>),
    Tree(TreeNode),
}

impl Station {
    /// Node `id`, which observes `model`.
    ///
    /// # Errors
    /// [`NetworkError`] for settings out of range, or a model of another number of parameters.
    pub fn new(
        id: usize,
        agreement: &Agreement,
        model: LinearModel,
        options: NodeOptions,
    ) -> Result<Self, NetworkError> {
        let (found, expected) = (model.design.ncols(), agreement.parameters);
        if found != expected {
            let what = format!("the model of node {id}");
            return Err(NetworkError::WrongSize { what, found, expected });
        }
        let rho = agreement.rho;
        if !(rho > 0.0 && rho.is_finite()) {
            return Err(NetworkError::BadSetting { name: "rho", value: rho, range: "above 0" });
        }
        let (constraints, normals) = (&agreement.constraints, model.normals());
        let shared = normals.clone();
        let machine = match agreement.solver {
            NetworkSolver::Info => {
                let own = info::pack(&normals);
                Machine::Info(Node::new(id, constraints, Average { own, rho }, options)?)
            }
            NetworkSolver::Admm => {
                let count = constraints.hubs_of(id).len();
                let problem = NodeLeastSquares::new(shared, &Weight::Scalar(rho), count)?;
                Machine::Admm(Node::new(id, constraints, problem, options)?)
            }
            NetworkSolver::Tree => {
                let tree = agreement.graph.spanning_tree()?;
                let own = info::pack(&normals);
                Machine::Tree(TreeNode::new(id, &tree, own, options.first_sequence))
            }
        };
        let monitor = match agreement.solver {
            NetworkSolver::Admm => None,
            _ => Some(Monitor::new(id, agreement, model, Levels::default())?),
        };
        Ok(Self {
            agreement: agreement.clone(),
            machine,
            normals,
            monitor,
            verdict: Verdict::Unsettled,
            named: Vec::new(),
            excluded: Vec::new(),
        })
    }

    /// The node's solution for the common parameters.
    ///
    /// # Errors
    /// [`NetworkError::Singular`] while too few messages have arrived.
    pub fn read(&self) -> Result<Estimate, NetworkError> {
        self.agreement.read(self.estimate())
    }

    /// The node's verdict on the network's observations.
    pub fn verdict(&self) -> &Verdict {
        &self.verdict
    }

    /// The observations that the network found faulty, in the order in which this node received them.
    pub fn named(&self) -> &[Suspect] {
        &self.named
    }

    /// The node's own excluded observations, in their order; of indistinguishable ones all.
    pub fn excluded(&self) -> &[usize] {
        &self.excluded
    }

    /// The normal equations of the node's accepted observations.
    pub fn normals(&self) -> &Normals {
        &self.normals
    }

    /// Whether the consensus has settled at all nodes.
    pub fn settled(&self) -> bool {
        self.monitor.as_ref().is_some_and(Monitor::settled)
    }

    fn machine(&self) -> &dyn Participant {
        match &self.machine {
            Machine::Info(node) => node,
            Machine::Admm(node) => node,
            Machine::Tree(node) => node,
        }
    }

    fn machine_mut(&mut self) -> &mut dyn Participant {
        match &mut self.machine {
            Machine::Info(node) => node,
            Machine::Admm(node) => node,
            Machine::Tree(node) => node,
        }
    }

    /// Continues from the last state with other normal equations.
    fn set_normals(&mut self, normals: Normals) {
        match &mut self.machine {
            Machine::Info(node) => node.problem.own = info::pack(&normals),
            Machine::Tree(node) => node.set_own(info::pack(&normals)),
            // Without covariance nothing is ever excluded.
            Machine::Admm(_) => {}
        }
        self.normals = normals;
    }

    fn remember(&mut self, suspect: Suspect) {
        let same =
            |held: &Suspect| (held.node, held.observation) == (suspect.node, suspect.observation);
        if !self.named.iter().any(same) {
            self.named.push(suspect);
        }
    }
}

impl Participant for Station {
    fn receive(&mut self, message: &NodeMessage) -> Received {
        let received = self.machine_mut().receive(message);
        if let (Some(monitor), Received::Taken) = (&mut self.monitor, received) {
            monitor.hear(message.sender as usize, &message.news);
        }
        received
    }

    fn step(&mut self) -> bool {
        let moved = self.machine_mut().step();
        let Some(monitor) = self.monitor.as_mut().filter(|_| moved) else { return moved };
        let estimate = match &self.machine {
            Machine::Info(node) => Participant::estimate(node),
            Machine::Admm(node) => Participant::estimate(node),
            Machine::Tree(node) => Participant::estimate(node),
        };
        // The estimate has the size of the agreement: it was made with it.
        self.verdict = monitor.observe(estimate).unwrap_or(Verdict::Unsettled);
        let news = monitor.news();
        match &self.verdict {
            Verdict::Named(suspect) => self.remember(*suspect),
            Verdict::Excluded { observations, .. } => {
                self.excluded.extend(observations);
                let normals = monitor.model().normals();
                self.set_normals(normals);
            }
            _ => {}
        }
        self.machine_mut().set_news(news);
        moved
    }

    fn messages(&self) -> Vec<(usize, NodeMessage)> {
        self.machine().messages()
    }

    fn estimate(&self) -> &[f64] {
        self.machine().estimate()
    }

    fn residuals(&self) -> Residuals {
        self.machine().residuals()
    }

    fn set_news(&mut self, news: News) {
        self.machine_mut().set_news(news);
    }
}
