//! Figure 10: start of the iterations.

use super::way::{Epoch, Way};
use sdr_rx::network::admm::{NodeLeastSquares, Weight};
use sdr_rx::network::scene::StationScene;
use sdr_rx::network::{Datum, NetworkError};

/// Weight of agreement of all three ways; alpha is 1.
const RHO: f64 = 0.5;
/// Distance of the second start from the truth, m.
const OFF_M: f64 = 1.0;

/// The ways to the solution of an epoch from 0, from the truth + 1 m (both with u = 0), and from the solution of
/// the epoch before with its u.
///
/// # Errors
/// [`NetworkError::Singular`] when a satellite is in view of no station.
pub fn ways(scene: &StationScene, seed: u64, limit: usize) -> Result<[Way; 3], NetworkError> {
    let datum = Datum::Observed;
    let epoch = Epoch::new(scene, 1, datum, seed)?;
    let before = Epoch::new(scene, 0, datum, seed + 1000)?;
    let weight = Weight::Scalar(RHO);
    let mut cold = epoch.admm(&weight, 1.0)?;

    let mut near = epoch.admm(&weight, 1.0)?;
    let start = scene.truth(datum).add_scalar(OFF_M);
    near.iter_mut().for_each(|node| node.start_from(start.as_slice()));

    let mut warm = before.admm(&weight, 1.0)?;
    before.way(&mut warm, limit);
    for (id, node) in warm.iter_mut().enumerate() {
        let constraints = epoch.constraints.hubs_of(id).len();
        node.problem = NodeLeastSquares::new(epoch.normals[id].clone(), &weight, constraints)?;
    }
    Ok([&mut cold, &mut near, &mut warm].map(|nodes| epoch.way(nodes, limit)))
}
