//! Detection and exclusion of the worst observation of a network: the same verdict at every node.
//!
//! Each node tests its own observations ([`LocalTests`]) with the solution it has. The largest |w| travels
//! through the network in the [`News`] that each message carries: a node passes on the largest it has received;
//! the owner renews it in each round, and what was not renewed for twice the diameter is dropped. When
//! the consensus has settled everywhere ([`Stopping`]), the tests reject, and the same observation has been the
//! network's worst for long enough that no worse one can be under way, every node suspects it, and its owner
//! excludes it. Nothing else is excluded before the consensus has settled again.
//!
//! Not from the paper: an observation is suspected from |w| above the limit of one observation (0.1 %), and the
//! network rejected where the test of the model rejects (1 %) *or* the largest |w| is above the limit of the
//! largest of all (1 %). The test of the model alone hardly sees a single fault in a large network: at 267
//! degrees of freedom it misses every third of two minimal detectable biases.

use super::message::{News, Suspect};
use super::quality::{Levels, LocalTests, ModelTest};
use super::solver::{Agreement, NetworkSolver};
use super::stopping::Stopping;
use super::{Graph, LinearModel, NetworkError, NetworkSolution};

/// Verdict of a node on the network's observations.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// The consensus has not settled, or no agreement has been reached on what is worst.
    Unsettled,
    /// All tests are passed.
    Credible,
    /// The tests reject, and this observation is the worst: its owner is about to exclude it.
    Named(Suspect),
    /// This node has just excluded an observation of its own: [`Monitor::model`] is without it, and the
    /// node's term of the problem must be set to that.
    Excluded {
        /// The observations that no test can distinguish, the excluded one first. If there are two, the
        /// receiver had no others, and now contributes nothing.
        observations: Vec<usize>,
        /// |w|.
        statistic: f64,
    },
    /// The test of the model rejects, but no single observation: the weights or the model are wrong.
    Unexplained,
}

/// The quality control of a node, beside its [`Node`](super::consensus::Node).
#[derive(Clone, Debug)]
pub struct Monitor {
    id: usize,
    agreement: Agreement,
    model: LinearModel,
    levels: Levels,
    diameter: u32,
    stopping: Stopping,
    /// The solution of the round before.
    last: Option<NetworkSolution>,
    suspect: Option<Suspect>,
    /// For how many rounds it has been the same one.
    held: u32,
}

impl Monitor {
    /// Of node `id`, which observes `model`.
    ///
    /// # Errors
    /// [`NetworkError::NoCovariance`] for a solver that gives none; [`NetworkError::Disconnected`].
    pub fn new(
        id: usize,
        agreement: &Agreement,
        model: LinearModel,
        levels: Levels,
    ) -> Result<Self, NetworkError> {
        let spoken = spoken(agreement)?;
        spoken.require_connected()?;
        let diameter = spoken.diameter().unwrap_or(0);
        Ok(Self {
            id,
            agreement: agreement.clone(),
            model,
            levels,
            diameter: diameter as u32,
            stopping: Stopping::new(spoken.neighbours(id), diameter),
            last: None,
            suspect: None,
            held: 0,
        })
    }

    /// The node's observations, without those excluded.
    pub fn model(&self) -> &LinearModel {
        &self.model
    }

    /// Other observations, as of a new epoch.
    pub fn set_model(&mut self, model: LinearModel) {
        self.model = model;
        self.withdraw();
        self.stopping.restart();
    }

    /// The solution of the last round.
    pub fn solution(&self) -> Option<&NetworkSolution> {
        self.last.as_ref()
    }

    /// Whether the consensus has settled at all nodes: they may stop.
    pub fn settled(&self) -> bool {
        self.stopping.everywhere(1)
    }

    /// Takes the news of a neighbour's message.
    pub fn hear(&mut self, sender: usize, news: &News) {
        self.stopping.hear(sender, news.calm);
        let own = self.id as u32;
        let oldest = 2 * self.diameter;
        let word = news.suspect.filter(|s| s.node != own && s.age <= oldest && s.statistic > 0.0);
        let Some(word) = word else { return };
        let better = self.suspect.is_none_or(|held| {
            if held.node == word.node { word.age < held.age } else { worse(&word, &held) }
        });
        if better {
            self.take(word);
        }
    }

    /// The news for the node's messages.
    pub fn news(&self) -> News {
        News { calm: self.stopping.calm(), suspect: self.suspect }
    }

    /// The verdict after a round, in which the estimate (as [`Agreement::read`] takes it) was computed anew.
    ///
    /// # Errors
    /// [`NetworkError::WrongSize`] for an estimate of another network.
    pub fn observe(&mut self, estimate: &[f64]) -> Result<Verdict, NetworkError> {
        let solution = match self.agreement.read(estimate) {
            Ok(estimate) => estimate.solution().cloned(),
            Err(NetworkError::Singular(_)) => None,
            Err(error) => return Err(error),
        };
        let Some(solution) = solution else {
            self.last = None;
            self.stopping.observe(false);
            return Ok(Verdict::Unsettled);
        };
        let near = self.last.as_ref().is_some_and(|last| near(last, &solution));
        self.stopping.observe(near);
        let tests = LocalTests::new(&self.model, &solution);
        let verdict = self.judge(&solution, &tests);
        self.last = Some(solution);
        Ok(verdict)
    }

    fn judge(&mut self, solution: &NetworkSolution, tests: &LocalTests) -> Verdict {
        self.held = self.held.saturating_add(1);
        self.refresh(tests);
        let diameter = self.diameter;
        if !self.stopping.everywhere(1) || (self.suspect.is_some() && self.held <= diameter) {
            return Verdict::Unsettled;
        }
        let rejected = ModelTest::new(solution, self.levels.model).rejects();
        let limit = self.levels.largest_limit(solution.freedom);
        let Some(suspect) = self.suspect.filter(|s| rejected || s.statistic > limit) else {
            return if rejected { Verdict::Unexplained } else { Verdict::Credible };
        };
        // Three diameters: the suspicion has reached every node, and has been held there for another two.
        let long = self.held > 3 * diameter && self.stopping.everywhere(3);
        if suspect.node as usize != self.id || !long {
            return Verdict::Named(suspect);
        }
        let worst = suspect.observation as usize;
        let mut observations = tests.indistinguishable(worst);
        observations.sort_by_key(|&j| j != worst);
        self.set_model(self.model.without(worst));
        Verdict::Excluded { observations, statistic: suspect.statistic }
    }

    /// Ages what was received, and renews the node's own suspicion.
    fn refresh(&mut self, tests: &LocalTests) {
        let (own, oldest) = (self.id as u32, 2 * self.diameter);
        if let Some(suspect) = &mut self.suspect {
            suspect.age += 1;
        }
        if self.suspect.is_some_and(|held| held.node != own && held.age > oldest) {
            self.withdraw();
        }
        let worst = tests.worst().filter(|(_, w)| *w > self.levels.observation_limit());
        let worst = worst.map(|(observation, statistic)| Suspect {
            statistic,
            node: own,
            observation: observation as u32,
            age: 0,
        });
        let mine = self.suspect.is_some_and(|held| held.node == own);
        match worst {
            Some(worst) if mine || self.suspect.is_none_or(|held| worse(&worst, &held)) => {
                self.take(worst);
            }
            None if mine => self.withdraw(),
            _ => {}
        }
    }

    fn take(&mut self, word: Suspect) {
        let same = |held: Suspect| (held.node, held.observation) == (word.node, word.observation);
        if !self.suspect.is_some_and(same) {
            self.held = 0;
        }
        self.suspect = Some(word);
    }

    fn withdraw(&mut self) {
        (self.suspect, self.held) = (None, 0);
    }
}

/// Whether a suspicion has the larger statistic; of two equal ones, the lower node's.
fn worse(word: &Suspect, other: &Suspect) -> bool {
    let order = word.statistic.total_cmp(&other.statistic);
    order.then(other.node.cmp(&word.node)).is_gt()
}

/// Whether a round hardly changed the solution: parameters by less than a tenth of their standard
/// deviations, T by less than a tenth of its own.
fn near(last: &NetworkSolution, now: &NetworkSolution) -> bool {
    let sigma = now.sigma();
    let spread = (2.0 * now.freedom.max(1.0)).sqrt();
    (0..now.x.len()).all(|j| (now.x[j] - last.x[j]).abs() <= 0.1 * sigma[j])
        && (now.misfit - last.misfit).abs() < 0.1 * spread
        && (now.freedom - last.freedom).abs() < 0.5
}

/// The links that carry messages.
fn spoken(agreement: &Agreement) -> Result<Graph, NetworkError> {
    let constraints = &agreement.constraints;
    match agreement.solver {
        NetworkSolver::Admm => Err(NetworkError::NoCovariance),
        NetworkSolver::Tree => agreement.graph.spanning_tree(),
        NetworkSolver::Info => {
            let star = |&hub: &usize| {
                let members = constraints.members(hub).iter().filter(move |&&k| k != hub);
                members.map(move |&member| (hub, member))
            };
            let links: Vec<_> = constraints.hubs().iter().flat_map(star).collect();
            Graph::new(constraints.nodes(), &links)
        }
    }
}
