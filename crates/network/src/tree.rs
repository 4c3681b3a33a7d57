//! The exact sum over a tree: a check of the other solvers, and the fewest messages where the graph does not change.
//!
//! On each link of a spanning tree a node sends its neighbour the sum over its own side: its own numbers and the
//! sums of its other neighbours. After as many exchanges as the diameter of the tree, every node has the exact sum
//! of all. Messages are absolute, so that loss only delays. But the tree fails with any node.

use super::Graph;
use super::consensus::{Received, Residuals};
use super::message::{Body, News, NodeMessage};
use super::sim::Participant;

/// A node of a tree.
#[derive(Clone, Debug)]
pub struct TreeNode {
    id: usize,
    own: Vec<f64>,
    branches: Vec<Branch>,
    sequence: u64,
    total: Vec<f64>,
    /// The largest change of the total at the last step; infinite until every branch has sent its sum.
    shift: f64,
    news: News,
}

/// The sum over a neighbour's side.
#[derive(Clone, Debug)]
struct Branch {
    neighbour: usize,
    heard: Option<u64>,
    sum: Vec<f64>,
}

impl TreeNode {
    /// A node of a tree (see [`Graph::spanning_tree`]) with numbers of its own; `first_sequence` as in
    /// [`NodeOptions`](super::consensus::NodeOptions).
    pub fn new(id: usize, tree: &Graph, own: Vec<f64>, first_sequence: u64) -> Self {
        let branch =
            |&neighbour: &usize| Branch { neighbour, heard: None, sum: vec![0.0; own.len()] };
        let branches = tree.neighbours(id).iter().map(branch).collect();
        Self {
            id,
            branches,
            sequence: first_sequence,
            total: own.clone(),
            own,
            shift: f64::INFINITY,
            news: News::default(),
        }
    }

    /// Whether every branch has sent its sum.
    pub fn complete(&self) -> bool {
        self.branches.iter().all(|branch| branch.heard.is_some())
    }

    /// Sets new numbers of its own.
    pub fn set_own(&mut self, own: Vec<f64>) {
        self.own = own;
    }
}

impl Participant for TreeNode {
    fn receive(&mut self, message: &NodeMessage) -> Received {
        let Body::PartialSum { sum } = &message.body else { return Received::Foreign };
        let sender = message.sender as usize;
        let branch = self.branches.iter_mut().find(|branch| branch.neighbour == sender);
        let fits = sum.len() == self.own.len() && sum.iter().all(|v| v.is_finite());
        let Some(branch) = branch.filter(|_| fits) else { return Received::Foreign };
        if branch.heard.is_some_and(|last| last >= message.sequence) {
            return Received::Old;
        }
        branch.heard = Some(message.sequence);
        branch.sum.copy_from_slice(sum);
        Received::Taken
    }

    fn step(&mut self) -> bool {
        let mut total = self.own.clone();
        for branch in &self.branches {
            total.iter_mut().zip(&branch.sum).for_each(|(total, sum)| *total += sum);
        }
        self.sequence += 1;
        let shifts = total.iter().zip(&self.total).map(|(a, b)| (a - b).abs());
        self.shift = if self.complete() { shifts.fold(0.0, f64::max) } else { f64::INFINITY };
        self.total = total;
        true
    }

    fn messages(&self) -> Vec<(usize, NodeMessage)> {
        let to = |branch: &Branch| {
            let others = self.branches.iter().filter(|other| other.neighbour != branch.neighbour);
            let sum = others.fold(self.own.clone(), |mut sum, other| {
                sum.iter_mut().zip(&other.sum).for_each(|(sum, v)| *sum += v);
                sum
            });
            let body = Body::PartialSum { sum };
            let (sender, sequence) = (self.id as u32, self.sequence);
            (branch.neighbour, NodeMessage { sender, sequence, body, news: self.news })
        };
        self.branches.iter().map(to).collect()
    }

    fn estimate(&self) -> &[f64] {
        &self.total
    }

    fn residuals(&self) -> Residuals {
        Residuals { primal: 0.0, dual: self.shift }
    }

    fn set_news(&mut self, news: News) {
        self.news = news;
    }
}
