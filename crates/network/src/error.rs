//! Errors of a network.

/// Why a network cannot work.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NetworkError {
    /// An invalid link.
    #[error(
        "a link between nodes {0} and {1} of a network of {2}: a link joins two different nodes, numbered from 0"
    )]
    BadLink(usize, usize, usize),
    /// The graph is not connected.
    #[error(
        "the network falls into {parts} parts, one of them {part:?}: no solution can be common to all; add a link between the parts"
    )]
    Disconnected {
        /// How many parts.
        parts: usize,
        /// The smallest of them.
        part: Vec<usize>,
    },
    /// A set of constraint nodes that does not bind all nodes together.
    #[error(
        "the constraint nodes {hubs:?} leave {left}: choose them so that each link has one at an end"
    )]
    UnboundNodes {
        /// The constraint nodes.
        hubs: Vec<usize>,
        /// What they leave out.
        left: String,
    },
    /// Matrices or vectors whose sizes disagree.
    #[error("{what} has {found} where the network has {expected}")]
    WrongSize {
        /// What has the size.
        what: String,
        /// What was given.
        found: usize,
        /// What is right.
        expected: usize,
    },
    /// Not enough was observed.
    #[error(
        "the network's observations do not determine its {0} parameters: a parameter is seen by nobody, or the datum is not fixed"
    )]
    Singular(usize),
    /// Quality control with a solver that cannot have it.
    #[error(
        "the solver admm gives no covariance, without which observations cannot be tested: take info or tree"
    )]
    NoCovariance,
    /// A setting out of its range.
    #[error("{name} is {value}, must be {range}")]
    BadSetting {
        /// Its name.
        name: &'static str,
        /// What was given.
        value: f64,
        /// What is right.
        range: &'static str,
    },
}
