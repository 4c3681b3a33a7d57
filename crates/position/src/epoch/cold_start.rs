//! From the Earth's centre to the region of the receiver, by a bare solver on satellite states.
//!
//! Pseudoranges `P` are of the satellite at the time of transmission `t_r - P/c - dt_s`, which no error of
//! the receiver's clock touches, and lack only atmosphere and Earth rotation: some 50 m. Dopplers are of the
//! satellite 75 ms before reception; the light time left out, +-8 ms, is 10 m of 4 km/s in position.

use super::adjustment::{Adjustment, point};
use super::sighting::{Sighting, clock_of};
use crate::error::PositioningError;
use crate::options::Observable;
use crate::point::Point;
use crate::problem::{Row, Satellite};
use crate::solver::Solver;
use crate::solver::failure::Failure;
use crate::solver::point_solution::Iteration;
use sdr_rx_gnss::SatelliteState;
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;

/// Time of flight of a signal, s.
const FLIGHT_S: f64 = 0.075;
/// What the bare model of a pseudorange leaves out, m: Earth rotation, atmosphere.
const BARE_RANGE_SIGMA_M: f64 = 50.0;
/// What the bare model of a range rate leaves out, m/s: Earth rotation and the dilation of time.
const BARE_RATE_SIGMA_MPS: f64 = 0.05;

/// Where a bare solver leads.
pub(crate) struct ColdStart {
    pub state: Point<3>,
    /// Linearisations spent.
    pub iterations: usize,
    /// The solver that did it.
    pub solver: Solver,
    /// Other places that fit as well.
    pub alternatives: Vec<Point<3>>,
}

/// By the solver that the options name. `trace` sees each accepted step.
pub(crate) fn cold_start(
    adjustment: &Adjustment,
    set: &[Sighting],
    trace: &mut dyn FnMut(&Iteration),
) -> Result<ColdStart, PositioningError> {
    let observable = adjustment.options.observable;
    let (mut rows, mut rates) = (Vec::with_capacity(2 * set.len()), Vec::new());
    let time = adjustment.receive_time;
    let satellite = |state: &SatelliteState| Satellite {
        position_m: state.position_m,
        velocity_mps: state.velocity_mps,
    };
    for s in set {
        if let Some(range_m) = s.range_m {
            let sent = time - range_m / SPEED_OF_LIGHT;
            let clock_s = s.orbit.state(sent).clock_bias_s;
            let state = s.orbit.state(sent - clock_s);
            let value = range_m + SPEED_OF_LIGHT * state.clock_bias_s;
            let sigma = s.observation.range_sigma_m.hypot(BARE_RANGE_SIGMA_M);
            let row = Row::range(satellite(&state), value).with_sigma(sigma);
            rows.push(Row { clock: clock_of(s.observation.sv()), ..row });
        }
        if let Some((rate, sigma)) =
            s.range_rate().filter(|_| observable != Observable::Pseudorange)
        {
            let state = s.orbit.state(time - FLIGHT_S);
            let value = rate + SPEED_OF_LIGHT * state.clock_drift_sps;
            let sigma = sigma.hypot(BARE_RATE_SIGMA_MPS);
            rates.push(Row::range_rate(satellite(&state), value).with_sigma(sigma));
        }
    }
    let solver = adjustment.options.solver;
    // The paper's solvers are unweighted; only standard deviations let the others prove their result.
    let proving = matches!(solver, Solver::Best | Solver::Bancroft | Solver::Vp | Solver::VpOnce);
    let mixed = !rows.is_empty() && !rates.is_empty();
    rows.append(&mut rates);
    if !proving && !mixed {
        rows.iter_mut().for_each(|row| row.sigma = None);
    }
    match solver.solve_by(&rows, trace) {
        Ok((solver, solution)) => Ok(ColdStart {
            state: point(&solution.state, set),
            iterations: solution.iterations,
            solver,
            alternatives: solution.alternatives.iter().map(|place| point(place, set)).collect(),
        }),
        // Whether satellites contradict each other is for the full model to say.
        Err(Failure::Inconsistent { state, iterations, .. }) => {
            let solver = if solver == Solver::Best { Solver::Vp } else { solver };
            let state = point(&state, set);
            Ok(ColdStart { state, iterations, solver, alternatives: Vec::new() })
        }
        Err(cause) => Err(PositioningError::Diverged { satellites: set.len(), cause }),
    }
}
