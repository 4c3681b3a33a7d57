//! From the Earth's centre to the region of the receiver, by a bare solver on satellite states.
//!
//! Pseudoranges `P` are of the satellite at the time of transmission `t_r - P/c - dt_s`, which no error of
//! the receiver's clock touches, and lack only atmosphere and Earth rotation: some 50 m. Dopplers are of the
//! satellite 75 ms before reception; the light time left out, +-8 ms, is 10 m of 4 km/s in position.

use super::adjustment::{Adjustment, point};
use super::sighting::{Sighting, clock_of};
use crate::error::PositioningError;
use crate::fix::{FailedStart, FailedStartCause, FixStart};
use crate::options::Observable;
use crate::place::Place;
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
    /// How it came there.
    pub start: FixStart,
    /// Other places that fit as well.
    pub alternatives: Vec<Point<3>>,
}

/// By `solver`, or by [`Solver::Best`] where that fails and may be taken over from. `trace` sees each accepted step.
pub(crate) fn cold_start(
    adjustment: &Adjustment,
    set: &[Sighting],
    solver: Solver,
    trace: &mut dyn FnMut(&Iteration),
) -> Result<ColdStart, PositioningError> {
    let diverged = |cause| PositioningError::Diverged { satellites: set.len(), cause };
    let rows = rows(adjustment, set);
    let cause = match lead(&rows, set, solver, trace) {
        Ok(mut cold) => {
            if rows.len() <= 4 && !proves(solver) {
                // Without redundancy there may be a second place, which only these look for.
                let other = lead(&rows, set, Solver::Best, trace).ok();
                let places = |other: ColdStart| other.alternatives.into_iter().chain([other.state]);
                cold.alternatives = other.into_iter().flat_map(places).collect();
            }
            return Ok(cold);
        }
        Err(cause)
            if solver == Solver::Best
                || cause.is_of_the_input()
                || !adjustment.options.takes_over =>
        {
            return Err(diverged(cause));
        }
        Err(cause) => cause,
    };
    let mut cold = lead(&rows, set, Solver::Best, trace).map_err(diverged)?;
    cold.start.iterations += cause.iterations();
    cold.start.failed =
        Some(FailedStart { solver: solver.name(), cause: FailedStartCause::NoPlace(cause) });
    Ok(cold)
}

/// Whether a solver weighs its observations and looks for other places that explain them.
fn proves(solver: Solver) -> bool {
    matches!(solver, Solver::Best | Solver::Bancroft | Solver::Vp | Solver::VpOnce)
}

/// The observations as rows of the bare model.
fn rows(adjustment: &Adjustment, set: &[Sighting]) -> Vec<Row> {
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
    rows.append(&mut rates);
    rows
}

/// By one solver.
fn lead(
    rows: &[Row],
    set: &[Sighting],
    solver: Solver,
    trace: &mut dyn FnMut(&Iteration),
) -> Result<ColdStart, Failure> {
    let mixed = rows.iter().any(|row| row.kind != rows[0].kind);
    // The paper's solvers are unweighted; only standard deviations let the others prove their result.
    let unweighted = (!mixed && !proves(solver))
        .then(|| rows.iter().map(|row| Row { sigma: None, ..*row }).collect::<Vec<Row>>());
    let cold = |solver: Solver, state: &Place, iterations, alternatives: &[Place]| ColdStart {
        state: point(state, set),
        start: FixStart { solver: solver.name(), iterations, failed: None },
        alternatives: alternatives.iter().map(|place| point(place, set)).collect(),
    };
    match solver.solve_by(unweighted.as_deref().unwrap_or(rows), trace) {
        Ok((solver, s)) => Ok(cold(solver, &s.state, s.iterations, &s.alternatives)),
        // Whether satellites contradict each other is for the full model to say.
        Err(Failure::Inconsistent { state, iterations, .. }) => {
            let solver = if solver == Solver::Best { Solver::Vp } else { solver };
            Ok(cold(solver, &state, iterations, &[]))
        }
        Err(cause) => Err(cause),
    }
}
