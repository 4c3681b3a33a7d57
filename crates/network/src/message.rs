//! Messages between neighbours. Every message is absolute: it contains states, not changes, so that it may be
//! lost, repeated or overtaken without harm.

use serde::{Deserialize, Serialize};

/// A message between neighbours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeMessage {
    /// The sender.
    pub sender: u32,
    /// Counts the sender's states, also across its restarts: a message of a lower number is old.
    pub sequence: u64,
    /// Contents.
    pub body: Body,
    /// News passed on beside them.
    pub news: News,
}

/// The part of a message that the estimation needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Body {
    /// A node to a constraint node s: t_is = x_i + u_is.
    State {
        /// t_is.
        t: Vec<f64>,
    },
    /// A constraint node to its star: z_s, the mean of the last t_is.
    Consensus {
        /// The sequence number of the t_is of each member that z_s holds.
        acknowledged: Vec<(u32, u64)>,
        /// z_s.
        z: Vec<f64>,
    },
    /// A node to its neighbour on a spanning tree: the sum over all nodes on its side of the link.
    PartialSum {
        /// The sum.
        sum: Vec<f64>,
    },
}

/// What each node passes on through the whole network beside the estimation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct News {
    /// Number of exchanges for which this node and all that it received of have been near agreement: above the
    /// diameter of the graph, all nodes.
    pub calm: u32,
    /// The observation with the largest test statistic received so far.
    pub suspect: Option<Suspect>,
}

/// An observation that does not fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Suspect {
    /// |w|, its test statistic.
    pub statistic: f64,
    /// Its node.
    pub node: u32,
    /// Which of the node's observations.
    pub observation: u32,
    /// Exchanges since its node sent it; what is too old is dropped.
    pub age: u32,
}
