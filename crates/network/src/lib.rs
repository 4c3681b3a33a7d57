//! Networks of receivers without a centre: each node of a graph communicates with its neighbours only, and converges
//! to the least-squares solution of a centre.
//!
//! A receiver's observations become a [`LinearModel`], that its [`Normals`]; a [`Graph`] with its [`Constraints`]
//! gives the links; a [`Node`](consensus::Node) is the state machine of each node, whose messages any transport
//! may carry.

pub mod admm;
pub mod code_bias;
pub mod consensus;
pub mod constraints;
pub mod corrections;
mod error;
pub mod file;
pub mod filter;
mod graph;
pub mod info;
mod linear_model;
pub mod message;
pub mod monitor;
pub mod nonlinear;
pub mod plan;
pub mod quality;
pub mod scene;
pub mod sim;
pub mod solver;
pub mod station;
pub mod stopping;
#[cfg(test)]
mod test_scene;
pub mod tree;
pub mod wire;

pub use constraints::Constraints;
pub use error::NetworkError;
pub use graph::{Graph, NINE_NODES};
pub use linear_model::{Datum, LinearModel, NetworkSolution, Normals};
