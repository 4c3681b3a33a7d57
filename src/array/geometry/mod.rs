//! The array's geometry: responses to directions, dictionaries, the Cramer-Rao bound, the measured signature
//! of a satellite and the direction that fits it.

mod attitude;
mod crb;
mod dictionary;
mod manifold;
mod signature;

pub use attitude::{ArrayAttitude, element_gains};
pub use crb::cramer_rao;
pub(in crate::array) use crb::inverse;
pub use dictionary::{degree_grid, dictionary, paper_dictionary};
pub use manifold::{Bearing, Manifold, Point};
pub use signature::{Arrival, Signature, arrival};
