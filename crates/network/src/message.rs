//! What nodes tell their neighbours. Every message is absolute: it says what is, not what changed, so that it
//! may be lost, repeated or overtaken without harm.

use serde::{Deserialize, Serialize};

/// A message between neighbours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeMessage {
    /// Who sends.
    pub sender: u32,
    /// Counts the sender's states, also across its restarts: a message of a lower number is old.
    pub sequence: u64,
    /// What it says.
    pub body: Body,
    /// What is passed on besides.
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
    /// A node to its neighbour on a spanning tree: the sum of all that lies on its side of the link.
    PartialSum {
        /// The sum.
        sum: Vec<f64>,
    },
}

/// What travels through the whole network beside the estimation, by each node passing on what it heard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct News {
    /// For how many exchanges everything has been quiet here and at all that were heard: above the diameter of
    /// the graph, everywhere.
    pub calm: u32,
    /// The least credible observation that was heard of.
    pub suspect: Option<Suspect>,
}

/// An observation that does not fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Suspect {
    /// |w|, its test statistic.
    pub statistic: f64,
    /// Whose observation it is.
    pub node: u32,
    /// Which of the node's observations.
    pub observation: u32,
    /// Exchanges since its owner said so; what is too old is forgotten.
    pub age: u32,
}
