//! A node of the network: consensus ADMM, as a state machine without clock and transport.
//!
//! Figure 6 of Khodabandeh & Teunissen (Meas. Sci. Technol. 30 (2019) 044005), in the form of Douglas and
//! Rachford, which needs one vector for each edge (i, s) between a node i and a constraint node s, itself
//! included where i is one: t_is = x_i + u_is.
//! ```text
//! node i : l = mean_s (2 z_s - t_is);  x_i = argmin f_i(x) + c_i/2 |x - l|_W^2;  t_is += alpha (x_i - z_s)
//! hub s  : z_s = mean over its star of the last t_is
//! ```
//! c_i is the number of constraint nodes of node i. alpha = 1 is exactly the figure, 1 < alpha < 2 over-relaxes.
//! f_i is given by the [`Proximal`]: the solvers differ in nothing else.
//!
//! Where links lose or delay messages and clocks differ, a link's t_is moves only when the neighbour's answer
//! acknowledges the last one sent ([`Rule::Acknowledged`]). The two other obvious rules diverge.

use super::message::{Body, News, NodeMessage};
use super::{Constraints, NetworkError};
use std::collections::BTreeMap;

/// A node's term f_i of the sum that the network minimises.
pub trait Proximal {
    /// How many numbers the network agrees on.
    fn dimension(&self) -> usize;

    /// x = argmin f_i(x) + `constraints`/2 |x - `pull`|_W^2, with the problem's own weight matrix W.
    fn minimise(&mut self, pull: &[f64], constraints: usize, x: &mut [f64]);
}

/// When a link's state may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Rule {
    /// When all links have been answered: all nodes are synchronous, as in the paper's iterations.
    Synchronous,
    /// Each link when its last state is acknowledged: for links that lose and delay.
    #[default]
    Acknowledged,
    /// Each link when something new came from its hub. Diverges under over-relaxation: kept to demonstrate it.
    Fresh,
    /// Each link at each step. Diverges: kept to demonstrate it.
    Always,
}

/// Settings of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeOptions {
    /// Over-relaxation alpha, 0 < alpha < 2.
    pub relaxation: f64,
    /// When a link moves.
    pub rule: Rule,
    /// The first sequence number: higher than any that the node used before it was restarted, such as
    /// nanoseconds since 1970.
    pub first_sequence: u64,
}

impl Default for NodeOptions {
    fn default() -> Self {
        Self { relaxation: 1.6, rule: Rule::Synchronous, first_sequence: 0 }
    }
}

/// Result of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received {
    /// It was new.
    Taken,
    /// Newer messages of the sender had come before.
    Old,
    /// The sender is no neighbour, or the contents do not fit this network.
    Foreign,
}

/// The link of a node to a constraint node.
#[derive(Clone, Debug)]
struct Link {
    hub: usize,
    t: Vec<f64>,
    /// Of t.
    sequence: u64,
    z: Vec<f64>,
    /// Of z; `None` before the first.
    heard: Option<u64>,
    /// The sequence number of t that z holds.
    acknowledged: Option<u64>,
    /// Whether z is newer than the last move.
    fresh: bool,
    /// The largest |z - z before|.
    shift: f64,
    /// 2 z - t, as of the last time that z held t.
    pull: Vec<f64>,
}

/// A star's centre.
#[derive(Clone, Debug)]
struct Hub {
    /// The last state of each member, with its sequence number.
    states: BTreeMap<usize, Option<(u64, Vec<f64>)>>,
    z: Vec<f64>,
    sequence: u64,
    acknowledged: Vec<(u32, u64)>,
}

/// A node: a member of the stars around it, and the centre of its own where it is a constraint node.
#[derive(Clone, Debug)]
pub struct Node<P> {
    id: usize,
    /// The node's own term of the problem; it may change while the network runs.
    pub problem: P,
    options: NodeOptions,
    links: Vec<Link>,
    hub: Option<Hub>,
    x: Vec<f64>,
    moves: u64,
    residuals: Residuals,
    /// News that the node passes on beside the estimation.
    pub news: News,
}

/// Distance of a node from agreement, in the units of x.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residuals {
    /// The largest |x_i - z_s|.
    pub primal: f64,
    /// The largest |z_s - z_s before|.
    pub dual: f64,
}

impl<P: Proximal> Node<P> {
    /// A node that starts from x = 0, u = 0.
    ///
    /// # Errors
    /// [`NetworkError::BadSetting`] for a relaxation that cannot converge.
    pub fn new(
        id: usize,
        constraints: &Constraints,
        problem: P,
        options: NodeOptions,
    ) -> Result<Self, NetworkError> {
        let relaxation = options.relaxation;
        if !(relaxation > 0.0 && relaxation < 2.0) {
            let range = "above 0 and below 2";
            return Err(NetworkError::BadSetting { name: "relaxation", value: relaxation, range });
        }
        let zeros = || vec![0.0; problem.dimension()];
        let link = |&hub: &usize| Link {
            hub,
            t: zeros(),
            sequence: options.first_sequence,
            z: zeros(),
            heard: None,
            acknowledged: None,
            fresh: false,
            shift: 0.0,
            pull: zeros(),
        };
        let members = constraints.members(id);
        let hub = (!members.is_empty()).then(|| Hub {
            states: members.iter().map(|&member| (member, None)).collect(),
            z: zeros(),
            sequence: options.first_sequence,
            acknowledged: Vec::new(),
        });
        Ok(Self {
            id,
            links: constraints.hubs_of(id).iter().map(link).collect(),
            hub,
            x: zeros(),
            moves: 0,
            residuals: Residuals::default(),
            news: News::default(),
            problem,
            options,
        })
    }

    /// The node's number.
    pub fn id(&self) -> usize {
        self.id
    }

    /// x_i, the node's estimate of the common value.
    pub fn estimate(&self) -> &[f64] {
        &self.x
    }

    /// Number of times that x_i has been computed.
    pub fn moves(&self) -> u64 {
        self.moves
    }

    /// Distance of the node from agreement at its last move.
    pub fn residuals(&self) -> Residuals {
        self.residuals
    }

    /// Starts again from an estimate, with u = 0.
    pub fn start_from(&mut self, x: &[f64]) {
        self.x.copy_from_slice(x);
        for link in &mut self.links {
            link.t.copy_from_slice(x);
            link.sequence += 1;
        }
    }

    /// Multiplies u of each link, as the growth of W from epoch to epoch requires: u W stays constant.
    pub fn rescale_duals(&mut self, factor: f64) {
        for link in &mut self.links {
            link.t.iter_mut().zip(&self.x).for_each(|(t, x)| *t = x + factor * (*t - x));
            link.sequence += 1;
        }
    }

    /// Takes a message of another node.
    pub fn receive(&mut self, message: &NodeMessage) -> Received {
        let sender = message.sender as usize;
        match &message.body {
            Body::State { t } => self.receive_state(sender, message.sequence, t),
            Body::Consensus { z, acknowledged } => {
                self.receive_consensus(sender, message.sequence, z, acknowledged)
            }
            Body::PartialSum { .. } => Received::Foreign,
        }
    }

    fn receive_state(&mut self, sender: usize, sequence: u64, t: &[f64]) -> Received {
        let slot = self.hub.as_mut().and_then(|hub| hub.states.get_mut(&sender));
        let Some(slot) = slot.filter(|_| sender != self.id && fits(t, &self.x)) else {
            return Received::Foreign;
        };
        if slot.as_ref().is_some_and(|(last, _)| *last >= sequence) {
            return Received::Old;
        }
        *slot = Some((sequence, t.to_vec()));
        Received::Taken
    }

    fn receive_consensus(
        &mut self,
        sender: usize,
        sequence: u64,
        z: &[f64],
        acknowledged: &[(u32, u64)],
    ) -> Received {
        let own = self.id;
        let link = self.links.iter_mut().find(|link| link.hub == sender && sender != own);
        let Some(link) = link.filter(|link| fits(z, &link.z)) else { return Received::Foreign };
        if link.heard.is_some_and(|last| last >= sequence) {
            return Received::Old;
        }
        let mine = acknowledged.iter().find(|(member, _)| *member as usize == own);
        link.take(sequence, z, mine.map(|&(_, sequence)| sequence));
        Received::Taken
    }

    /// One step with what has been received: as a hub, then as a member. Returns whether x_i was computed anew.
    pub fn step(&mut self) -> bool {
        self.centre();
        self.advance()
    }

    /// The hub's part: z_s, once every member has been heard.
    fn centre(&mut self) {
        let Some(hub) = &mut self.hub else { return };
        let own = self.links.iter_mut().find(|link| link.hub == self.id);
        let Some(own) = own else { return };
        hub.states.insert(self.id, Some((own.sequence, own.t.clone())));
        let acknowledged: Option<Vec<(u32, u64)>> = hub
            .states
            .iter()
            .map(|(&member, state)| state.as_ref().map(|(sequence, _)| (member as u32, *sequence)))
            .collect();
        let Some(acknowledged) = acknowledged else { return };
        let in_step =
            || hub.acknowledged.iter().zip(&acknowledged).all(|(before, now)| before.1 < now.1);
        let news = hub.acknowledged.is_empty() || acknowledged != hub.acknowledged;
        if !news || (self.options.rule == Rule::Synchronous && !in_step()) {
            return;
        }
        hub.z.fill(0.0);
        let weight = 1.0 / hub.states.len() as f64;
        for (_, t) in hub.states.values().flatten() {
            hub.z.iter_mut().zip(t).for_each(|(z, t)| *z += weight * t);
        }
        hub.sequence += 1;
        hub.acknowledged = acknowledged;
        own.take(hub.sequence, &hub.z, Some(own.sequence));
    }

    /// The member's part: x_i and the links that may move.
    fn advance(&mut self) -> bool {
        let rule = self.options.rule;
        let may_move = |link: &Link| match rule {
            Rule::Synchronous | Rule::Acknowledged => link.answered(),
            Rule::Fresh => link.fresh,
            Rule::Always => link.heard.is_some(),
        };
        let movable = self.links.iter().filter(|link| may_move(link)).count();
        if movable == 0 || (rule == Rule::Synchronous && movable < self.links.len()) {
            return false;
        }
        for link in self.links.iter_mut().filter(|link| may_move(link)) {
            let values = link.pull.iter_mut().zip(&link.z).zip(&link.t);
            values.for_each(|((pull, z), t)| *pull = 2.0 * z - t);
        }
        let mut pull = vec![0.0; self.x.len()];
        let weight = 1.0 / self.links.len() as f64;
        for link in &self.links {
            pull.iter_mut().zip(&link.pull).for_each(|(sum, one)| *sum += weight * one);
        }
        self.problem.minimise(&pull, self.links.len(), &mut self.x);
        self.residuals = Residuals::default();
        for link in self.links.iter_mut() {
            self.residuals.primal = self.residuals.primal.max(farthest(&self.x, &link.z));
            self.residuals.dual = self.residuals.dual.max(link.shift);
            if may_move(link) {
                let values = link.t.iter_mut().zip(&self.x).zip(&link.z);
                values.for_each(|((t, x), z)| *t += self.options.relaxation * (x - z));
                link.sequence += 1;
                link.fresh = false;
            }
        }
        self.moves += 1;
        true
    }

    /// The node's messages, each with the neighbour that it is for: valid until the next step; repetitions do no
    /// harm.
    pub fn messages(&self) -> Vec<(usize, NodeMessage)> {
        let message = |sequence, body| NodeMessage {
            sender: self.id as u32,
            sequence,
            body,
            news: self.news,
        };
        let others = self.links.iter().filter(|link| link.hub != self.id);
        let states = others
            .map(|link| (link.hub, message(link.sequence, Body::State { t: link.t.clone() })));
        let hub = self.hub.iter().filter(|hub| !hub.acknowledged.is_empty());
        let consensus = hub.flat_map(|hub| {
            let (acknowledged, z) = (hub.acknowledged.clone(), hub.z.clone());
            let consensus = message(hub.sequence, Body::Consensus { acknowledged, z });
            let members = hub.states.keys().filter(|&&member| member != self.id);
            members.map(move |&member| (member, consensus.clone()))
        });
        states.chain(consensus).collect()
    }
}

impl Link {
    fn take(&mut self, sequence: u64, z: &[f64], acknowledged: Option<u64>) {
        self.heard = Some(sequence);
        self.acknowledged = acknowledged;
        self.fresh = true;
        self.shift = farthest(z, &self.z);
        self.z.copy_from_slice(z);
    }

    /// Whether z holds the last t.
    fn answered(&self) -> bool {
        self.acknowledged == Some(self.sequence)
    }
}

/// Of the right length, and finite.
fn fits(values: &[f64], like: &[f64]) -> bool {
    values.len() == like.len() && values.iter().all(|v| v.is_finite())
}

/// The largest difference of two vectors' elements.
fn farthest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
