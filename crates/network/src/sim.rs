//! The network in one process: the same state machines, with a simulated transport.

use super::NetworkError;
use super::consensus::{Node, Proximal, Received, Residuals};
use super::message::{News, NodeMessage};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// A state machine with neighbours, to which a transport carries messages.
pub trait Participant {
    /// Takes a message of a neighbour.
    fn receive(&mut self, message: &NodeMessage) -> Received;
    /// One step with what was received; returns whether the estimate was computed anew.
    fn step(&mut self) -> bool;
    /// Its messages, each with the neighbour that it is for.
    fn messages(&self) -> Vec<(usize, NodeMessage)>;
    /// Its estimate of the common value.
    fn estimate(&self) -> &[f64];
    /// Distance from agreement at its last step.
    fn residuals(&self) -> Residuals;
    /// Sets the news that its messages pass on beside the estimation.
    fn set_news(&mut self, news: News);
}

impl<P: Proximal> Participant for Node<P> {
    fn receive(&mut self, message: &NodeMessage) -> Received {
        Node::receive(self, message)
    }

    fn step(&mut self) -> bool {
        Node::step(self)
    }

    fn messages(&self) -> Vec<(usize, NodeMessage)> {
        Node::messages(self)
    }

    fn estimate(&self) -> &[f64] {
        Node::estimate(self)
    }

    fn residuals(&self) -> Residuals {
        Node::residuals(self)
    }

    fn set_news(&mut self, news: News) {
        self.news = news;
    }
}

impl<P: Participant + ?Sized> Participant for Box<P> {
    fn receive(&mut self, message: &NodeMessage) -> Received {
        (**self).receive(message)
    }

    fn step(&mut self) -> bool {
        (**self).step()
    }

    fn messages(&self) -> Vec<(usize, NodeMessage)> {
        (**self).messages()
    }

    fn estimate(&self) -> &[f64] {
        (**self).estimate()
    }

    fn residuals(&self) -> Residuals {
        (**self).residuals()
    }

    fn set_news(&mut self, news: News) {
        (**self).set_news(news);
    }
}

/// Every node sends its messages, all arrive, every node steps.
pub fn exchange<P: Participant>(nodes: &mut [P]) {
    let sent: Vec<_> = nodes.iter().flat_map(|node| node.messages()).collect();
    for (to, message) in &sent {
        nodes[*to].receive(message);
    }
    for node in nodes {
        node.step();
    }
}

/// One iteration of figure 6 at every node of a synchronous network: states to the hubs, and their means back.
pub fn iterate<P: Participant>(nodes: &mut [P]) {
    exchange(nodes);
    exchange(nodes);
}

/// The largest difference between any node's estimate and a value; infinite when an estimate is no number.
pub fn max_difference<P: Participant>(nodes: &[P], value: &[f64]) -> f64 {
    let pairs = nodes.iter().flat_map(|node| node.estimate().iter().zip(value));
    let apart = pairs.map(|(a, b)| (a - b).abs());
    apart.map(|off| if off.is_nan() { f64::INFINITY } else { off }).fold(0.0, f64::max)
}

/// Properties of links and clocks.
#[derive(Clone, Debug, PartialEq)]
pub struct Conditions {
    /// Probability that a message is lost, from 0 to below 1.
    pub loss: f64,
    /// Ticks that a message takes, each as likely.
    pub delay: RangeInclusive<u64>,
    /// Probability that a node steps within a tick, for each node drawn from this range once.
    pub rate: RangeInclusive<f64>,
}

impl Default for Conditions {
    /// No loss, one to three ticks, nodes up to five times slower than others.
    fn default() -> Self {
        Self { loss: 0.0, delay: 1..=3, rate: 0.2..=1.0 }
    }
}

/// Nodes with clocks of their own, on links with losses and delays.
#[derive(Debug)]
pub struct Simulation<P> {
    /// The nodes.
    pub nodes: Vec<P>,
    conditions: Conditions,
    rates: Vec<f64>,
    random: ChaCha8Rng,
    now: u64,
    /// Messages by the tick of their arrival, with the receiver.
    under_way: BTreeMap<u64, Vec<(usize, NodeMessage)>>,
}

impl<P: Participant> Simulation<P> {
    /// Nodes in these conditions; a seed makes runs repeatable.
    ///
    /// # Errors
    /// [`NetworkError::BadSetting`] for a loss outside [0, 1), a delay of 0, or a rate outside (0, 1].
    pub fn new(nodes: Vec<P>, conditions: Conditions, seed: u64) -> Result<Self, NetworkError> {
        let bad = |name, value, range| Err(NetworkError::BadSetting { name, value, range });
        if !(0.0..1.0).contains(&conditions.loss) {
            return bad("loss", conditions.loss, "at least 0 and below 1");
        }
        if conditions.delay.is_empty() || *conditions.delay.start() == 0 {
            return bad("delay", *conditions.delay.start() as f64, "at least one tick");
        }
        let (slow, fast) = (*conditions.rate.start(), *conditions.rate.end());
        if !(slow > 0.0 && slow <= fast && fast <= 1.0) {
            return bad("rate", slow, "above 0 and at most 1");
        }
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let rates = nodes.iter().map(|_| random.random_range(conditions.rate.clone())).collect();
        Ok(Self { nodes, conditions, rates, random, now: 0, under_way: BTreeMap::new() })
    }

    /// Ticks so far.
    pub fn ticks(&self) -> u64 {
        self.now
    }

    /// One tick: messages that are due arrive; some nodes step and send their messages.
    pub fn tick(&mut self) {
        self.now += 1;
        for (to, message) in self.under_way.remove(&self.now).unwrap_or_default() {
            self.nodes[to].receive(&message);
        }
        for k in 0..self.nodes.len() {
            if !self.random.random_bool(self.rates[k]) {
                continue;
            }
            self.nodes[k].step();
            for letter in self.nodes[k].messages() {
                if !self.random.random_bool(self.conditions.loss) {
                    let due = self.now + self.random.random_range(self.conditions.delay.clone());
                    self.under_way.entry(due).or_default().push(letter);
                }
            }
        }
    }
}
