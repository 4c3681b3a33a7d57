//! When everybody may stop, found out without a centre.
//!
//! Each node counts for how long it has been quiet *everywhere within reach of its hearing*:
//! calm <- 1 + the least that its neighbours told if it is quiet itself, else 0. A count of k means that each
//! node within k - 1 hops was quiet, so that a count above the diameter means everybody was. A node is quiet
//! when it has been near agreement for some rounds; what is near, its [`Monitor`](super::monitor::Monitor) says:
//! a tenth of a standard deviation. Of a neighbour that has died, the last word stands.

use std::collections::BTreeMap;

/// Rounds that a node must be near agreement.
const ROUNDS: u32 = 3;
/// A node's count.
#[derive(Clone, Debug, PartialEq)]
pub struct Stopping {
    /// What each neighbour told last.
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
        let least = self.heard.values().copied().min().unwrap_or(self.calm);
        self.calm = if self.rounds >= ROUNDS { least.saturating_add(1) } else { 0 };
    }

    /// Begins anew, as after a change of what was observed.
    pub fn restart(&mut self) {
        (self.rounds, self.calm) = (0, 0);
    }

    /// The count, to be told to the neighbours.
    pub fn calm(&self) -> u32 {
        self.calm
    }

    /// Whether everybody has been quiet for `times` the time that news takes through the network.
    pub fn everywhere(&self, times: u32) -> bool {
        self.calm > self.diameter.saturating_mul(times)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_stops_before_everybody_is_quiet_and_all_stop_soon_after() {
        // A path of 12 nodes, of which the last is quiet from round 40 on only.
        let nodes = 12;
        let neighbours = |k: usize| -> Vec<usize> {
            [k.wrapping_sub(1), k + 1].into_iter().filter(|&j| j < nodes).collect()
        };
        let mut counts: Vec<_> =
            (0..nodes).map(|k| Stopping::new(&neighbours(k), nodes - 1)).collect();
        for round in 0..200 {
            let said: Vec<u32> = counts.iter().map(Stopping::calm).collect();
            for (k, count) in counts.iter_mut().enumerate() {
                neighbours(k).iter().for_each(|&j| count.hear(j, said[j]));
                count.observe(k < nodes - 1 || round >= 40);
            }
            if round < 40 + ROUNDS {
                assert!(counts.iter().all(|count| !count.everywhere(1)), "round {round}");
            }
            // The quiet of the last node takes 11 hops, and the count as many rounds more to rise.
            if round > 40 + ROUNDS + 2 * nodes as u32 {
                assert!(counts.iter().all(|count| count.everywhere(1)), "round {round}");
            }
        }
    }
}
