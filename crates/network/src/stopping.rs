//! Stopping without a centre.
//!
//! Each node counts the rounds for which its neighbourhood has been settled:
//! calm <- 1 + the minimum of its neighbours' counts if it is settled itself, else 0. A count of k means that each
//! node within k - 1 hops was settled, so that a count above the diameter means that all were. A node is settled
//! when it has been near agreement for some rounds, by its [`Monitor`](super::monitor::Monitor) to a tenth of a
//! standard deviation. Of a neighbour that has died, the last count is used.

use std::collections::BTreeMap;

/// Rounds that a node must be near agreement.
const ROUNDS: u32 = 3;
/// A node's count.
#[derive(Clone, Debug, PartialEq)]
pub struct Stopping {
    /// The last count of each neighbour.
    heard: BTreeMap<usize, u32>,
    diameter: u32,
    rounds: u32,
    calm: u32,
}

impl Stopping {
    /// Of a node with these neighbours, in a network of this diameter.
    pub fn new(neighbours: &[usize], diameter: usize) -> Self {
        let heard = neighbours.iter().map(|&neighbour| (neighbour, 0)).collect();
        Self { heard, diameter: diameter as u32, rounds: 0, calm: 0 }
    }

    /// Takes a neighbour's count.
    pub fn hear(&mut self, sender: usize, calm: u32) {
        if let Some(heard) = self.heard.get_mut(&sender) {
            *heard = calm;
        }
    }

    /// A round, after which the node was near agreement or not.
    pub fn observe(&mut self, near: bool) {
        self.rounds = if near { self.rounds.saturating_add(1) } else { 0 };
        let minimum = self.heard.values().copied().min().unwrap_or(self.calm);
        self.calm = if self.rounds >= ROUNDS { minimum.saturating_add(1) } else { 0 };
    }

    /// Starts again, as after a change of the observations.
    pub fn restart(&mut self) {
        (self.rounds, self.calm) = (0, 0);
    }

    /// The count, to be sent to the neighbours.
    pub fn calm(&self) -> u32 {
        self.calm
    }

    /// Whether all nodes have been settled for `times` the time that messages take through the network.
    pub fn everywhere(&self, times: u32) -> bool {
        self.calm > self.diameter.saturating_mul(times)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_node_stops_before_all_are_settled_and_all_stop_soon_after() {
        // A path of 12 nodes, of which the last is settled from round 40 on only.
        let nodes = 12;
        let neighbours = |k: usize| -> Vec<usize> {
            [k.wrapping_sub(1), k + 1].into_iter().filter(|&j| j < nodes).collect()
        };
        let mut counts: Vec<_> =
            (0..nodes).map(|k| Stopping::new(&neighbours(k), nodes - 1)).collect();
        for round in 0..200 {
            let sent: Vec<u32> = counts.iter().map(Stopping::calm).collect();
            for (k, count) in counts.iter_mut().enumerate() {
                neighbours(k).iter().for_each(|&j| count.hear(j, sent[j]));
                count.observe(k < nodes - 1 || round >= 40);
            }
            if round < 40 + ROUNDS {
                assert!(counts.iter().all(|count| !count.everywhere(1)), "round {round}");
            }
            // The count of the last node takes 11 hops, and the count as many rounds more to rise.
            if round > 40 + ROUNDS + 2 * nodes as u32 {
                assert!(counts.iter().all(|count| count.everywhere(1)), "round {round}");
            }
        }
    }
}
