//! Figure 8: 2.5 h of epochs, filtered by a centre and by the nodes.

use super::way::{Epoch, total};
use nalgebra::DVector;
use rayon::prelude::*;
use sdr_rx::gnss::random::SplitMix64;
use sdr_rx::network::admm::{NodeLeastSquares, Weight};
use sdr_rx::network::filter::InformationFilter;
use sdr_rx::network::info;
use sdr_rx::network::scene::{INTERVAL_S, SATELLITES, StationScene};
use sdr_rx::network::sim::{self, Participant};
use sdr_rx::network::{Datum, NetworkError, NetworkSolution, Normals};
use sdr_rx::report::{Curve, LinePlot};

/// rho of the paper's iterations for one epoch of data.
const RHO: f64 = 0.5;
const RELAXATION: f64 = 1.6;
/// rho of the average.
const INFO_RHO: f64 = 3.0;

/// How the nodes keep up with the centre: iterations an epoch, each from the last state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Keeping {
    /// The paper's iterations, rho growing with the data, u shrinking with it.
    Admm(usize),
    /// The same with rho as at the first epoch.
    Constant(usize),
    /// Averages of the accumulated normal equations.
    Info(usize),
}

impl Keeping {
    /// All that are compared.
    pub const ALL: [Self; 5] =
        [Self::Admm(10), Self::Admm(20), Self::Constant(10), Self::Info(5), Self::Info(10)];

    fn name(self) -> String {
        match self {
            Self::Admm(k) => format!("admm {k} its an epoch, rho growing"),
            Self::Constant(k) => format!("admm {k} its an epoch, rho constant"),
            Self::Info(k) => format!("info {k} its an epoch"),
        }
    }
}

/// Results of the filters.
#[derive(Clone, Debug)]
pub struct Filtered {
    /// At each epoch, the largest |error| / (3 sigma) of the centre's filter.
    pub errors: Vec<f64>,
    /// Fraction of all errors beyond 3 sigma; 0.0027 of normal ones.
    pub outside: f64,
    /// The largest sigma of the first and of the last epoch, m.
    pub sigma: [f64; 2],
    /// For each of [`Keeping::ALL`] and each epoch: the largest |x_i - x| / (3 sigma) of any node from the centre.
    pub behind: Vec<Vec<f64>>,
    /// Figure 8.
    pub plots: Vec<LinePlot>,
}

impl Filtered {
    /// What is kept of one way of keeping up.
    pub fn of(&self, keeping: Keeping) -> &[f64] {
        let at = Keeping::ALL.iter().position(|other| *other == keeping);
        at.map_or(&[], |at| &self.behind[at])
    }
}

/// The epoch, from 1, from which on all values are below 1.
pub fn below_one_from(values: &[f64]) -> Option<usize> {
    let above = values.iter().rposition(|v| v.is_nan() || *v >= 1.0);
    let first = above.map_or(0, |k| k + 1) + 1;
    (first <= values.len()).then_some(first)
}

/// Filters these many epochs of a scene.
///
/// # Errors
/// [`NetworkError::Singular`] when a satellite is in view of no station at the first.
pub fn filter(scene: &StationScene, epochs: usize, seed: u64) -> Result<Filtered, NetworkError> {
    let datum = Datum::Observed;
    let mut rng = SplitMix64::new(seed);
    let normals: Vec<Vec<Normals>> = (0..epochs)
        .map(|k| scene.models(k, datum, &mut rng).iter().map(|model| model.normals()).collect())
        .collect();
    let mut filter = InformationFilter::new(SATELLITES, 1.0)?;
    let centre: Vec<NetworkSolution> = normals
        .iter()
        .map(|epoch| {
            filter.update(&total(epoch));
            filter.normals().solve(datum)
        })
        .collect::<Result<_, _>>()?;
    let truth = scene.truth(datum);
    let first = Epoch::new(scene, 0, datum, seed)?;
    let behind: Vec<Vec<f64>> = Keeping::ALL
        .into_par_iter()
        .map(|keeping| keep_up(keeping, &first, &normals, &centre))
        .collect::<Result<_, _>>()?;

    let time = |k: usize| k as f64 * INTERVAL_S / 3600.0;
    let curve = |name: String, value: &dyn Fn(usize) -> f64| Curve {
        name,
        points: (0..epochs).map(|k| (time(k), value(k))).collect(),
    };
    let sigma = |k: usize| centre[k].sigma().amax();
    let mut curves: Vec<Curve> = (0..SATELLITES)
        .map(|j| curve(format!("satellite {}", j + 1), &|k| centre[k].x[j] - truth[j]))
        .collect();
    curves.push(curve("3 sigma".into(), &|k| 3.0 * sigma(k)));
    curves.push(curve("-3 sigma".into(), &|k| -3.0 * sigma(k)));
    let errors = LinePlot {
        name: "fig8_errors".into(),
        title: "Satellite code biases, filtered by a centre".into(),
        axes: ["time (h)".into(), "error (m)".into()],
        log: [false, false],
        curves,
    };
    let behind_plot = LinePlot {
        name: "fig8_distributed".into(),
        title: "The same filtered by 110 nodes: farthest node from the centre".into(),
        axes: ["time (h)".into(), "difference (3 sigma)".into()],
        log: [false, true],
        curves: Keeping::ALL
            .iter()
            .zip(&behind)
            .map(|(keeping, values)| curve(keeping.name(), &|k| values[k]))
            .collect(),
    };
    let error = |solution: &NetworkSolution| over_three_sigma(&truth, solution);
    let beyond = |solution: &NetworkSolution| {
        let error = (&truth - &solution.x).component_div(&solution.sigma());
        error.iter().filter(|e| e.abs() > 3.0).count()
    };
    let outside = centre.iter().map(beyond).sum::<usize>() as f64 / (epochs * SATELLITES) as f64;
    Ok(Filtered {
        errors: centre.iter().map(error).collect(),
        outside,
        sigma: [sigma(0), sigma(epochs - 1)],
        behind,
        plots: vec![errors, behind_plot],
    })
}

/// The largest |x_j - x of the centre| / (3 sigma_j).
fn over_three_sigma(x: &DVector<f64>, centre: &NetworkSolution) -> f64 {
    (x - &centre.x).component_div(&(centre.sigma() * 3.0)).amax()
}

fn keep_up(
    keeping: Keeping,
    first: &Epoch,
    normals: &[Vec<Normals>],
    centre: &[NetworkSolution],
) -> Result<Vec<f64>, NetworkError> {
    let nodes = first.normals.len();
    let constraints = |id: usize| first.constraints.hubs_of(id).len();
    let mut own = (0..nodes)
        .map(|_| InformationFilter::new(SATELLITES, 1.0))
        .collect::<Result<Vec<_>, _>>()?;
    let mut averages = first.info(INFO_RHO, RELAXATION)?;
    let mut solutions = first.admm(&Weight::Scalar(RHO), RELAXATION)?;
    let mut behind = Vec::with_capacity(normals.len());
    for (epoch, centre) in normals.iter().zip(centre) {
        for id in 0..nodes {
            own[id].update(&epoch[id]);
            match keeping {
                Keeping::Info(_) => own[id].renew_average(&mut averages[id]),
                Keeping::Admm(_) => {
                    own[id].renew_least_squares(&mut solutions[id], RHO, constraints(id))?;
                }
                Keeping::Constant(_) => {
                    let (all, weight) = (own[id].normals().clone(), Weight::Scalar(RHO));
                    solutions[id].problem = NodeLeastSquares::new(all, &weight, constraints(id))?;
                }
            }
        }
        behind.push(match keeping {
            Keeping::Info(k) => {
                (0..k).for_each(|_| sim::iterate(&mut averages));
                farthest(&averages, centre, |node| {
                    let mean = info::unpack(node.estimate(), SATELLITES).ok()?;
                    Some(mean.solve(Datum::Observed).ok()?.x)
                })
            }
            Keeping::Admm(k) | Keeping::Constant(k) => {
                (0..k).for_each(|_| sim::iterate(&mut solutions));
                farthest(&solutions, centre, |node| Some(DVector::from_row_slice(node.estimate())))
            }
        });
    }
    Ok(behind)
}

fn farthest<P: Participant>(
    nodes: &[P],
    centre: &NetworkSolution,
    read: impl Fn(&P) -> Option<DVector<f64>>,
) -> f64 {
    let off = |node| read(node).map_or(f64::INFINITY, |x| over_three_sigma(&x, centre));
    nodes.iter().map(off).fold(0.0, f64::max)
}
