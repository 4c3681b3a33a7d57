//! From the Earth's centre to the region of the receiver, by a bare solver on satellite states.
//!
//! Pseudoranges `P` are of the satellite at the time of transmission `t_r - P/c - dt_s`, which no error of
//! the receiver's clock touches, and lack only atmosphere and Earth rotation: some 50 m. Dopplers are of the
//! satellite 75 ms before reception; the light time left out, +-8 ms, is 10 m of 4 km/s in position.

use super::adjustment::{Adjustment, BIAS, DRIFT, Unknowns};
use super::error::PositioningError;
use super::options::Observable;
use super::sight::Sighting;
use super::solver::Solver;
use super::solver::model::{Doppler, Pseudorange, Satellite};
use super::solver::observations::{Both, Observed, Sigma};
use super::solver::outcome::{Failure, State, Step};
use sdr_rx_gnss::SatelliteState;
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;

/// Time of flight of a signal, s.
const FLIGHT_S: f64 = 0.075;
/// What the bare model of a pseudorange leaves out, m: Earth rotation, atmosphere.
const BARE_RANGE_SIGMA_M: f64 = 50.0;
/// What the bare model of a range rate leaves out, m/s: Earth rotation and the dilation of time.
const BARE_RATE_SIGMA_MPS: f64 = 0.05;

/// Observations of one kind, as the bare solvers take them.
#[derive(Default)]
struct Column {
    satellites: Vec<Satellite>,
    values: Vec<f64>,
    sigmas: Vec<f64>,
}

impl Column {
    fn push(&mut self, state: &SatelliteState, value: f64, sigma: f64) {
        let (position_m, velocity_mps) = (state.position_m, state.velocity_mps);
        self.satellites.push(Satellite { position_m, velocity_mps });
        self.values.push(value);
        self.sigmas.push(sigma);
    }

    fn observed<M: super::solver::model::ObservationModel>(
        &self,
        weighted: bool,
    ) -> Observed<'_, M> {
        let observed = Observed::new(&self.satellites, &self.values);
        if weighted { observed.with_sigma(Sigma::Each(&self.sigmas)) } else { observed }
    }
}

/// Where a bare solver leads.
pub(super) struct ColdStart {
    pub state: Unknowns,
    /// Linearisations spent.
    pub iterations: usize,
    /// The solver that did it.
    pub solver: Solver,
    /// Other places that fit as well.
    pub alternatives: Vec<Unknowns>,
}

/// By the solver that the options name. `trace` sees each accepted step.
pub(super) fn cold_start(
    adjustment: &Adjustment,
    set: &[Sighting],
    trace: &mut dyn FnMut(&Step),
) -> Result<ColdStart, PositioningError> {
    let (mut ranges, mut rates) = (Column::default(), Column::default());
    let time = adjustment.receive_time;
    for s in set {
        if let Some(range_m) = s.range_m {
            let sent = time - range_m / SPEED_OF_LIGHT;
            let clock_s = s.orbit.state(sent).clock_bias_s;
            let state = s.orbit.state(sent - clock_s);
            let sigma = s.observation.range_sigma_m.hypot(BARE_RANGE_SIGMA_M);
            ranges.push(&state, range_m + SPEED_OF_LIGHT * state.clock_bias_s, sigma);
        }
        if let Some((rate, sigma)) = s.range_rate() {
            let state = s.orbit.state(time - FLIGHT_S);
            let rate = rate + SPEED_OF_LIGHT * state.clock_drift_sps;
            rates.push(&state, rate, sigma.hypot(BARE_RATE_SIGMA_MPS));
        }
    }
    let solver = adjustment.options.solver;
    // The paper's solvers are unweighted; only deviations let the others prove their result.
    let weighted = matches!(solver, Solver::Best | Solver::Bancroft | Solver::Vp | Solver::VpOnce);
    let solution = match adjustment.options.observable {
        Observable::Pseudorange => {
            solver.solve_by(&ranges.observed::<Pseudorange>(weighted), trace)
        }
        Observable::Doppler => solver.solve_by(&rates.observed::<Doppler>(weighted), trace),
        Observable::Both if rates.values.is_empty() => {
            solver.solve_by(&ranges.observed::<Pseudorange>(weighted), trace)
        }
        Observable::Both => {
            let both = Both { pseudoranges: ranges.observed(true), dopplers: rates.observed(true) };
            solver.solve_by(&both, trace)
        }
    };
    let (solver, solution) = match solution {
        Ok(solved) => solved,
        // Whether satellites contradict each other is for the full model to say.
        Err(Failure::Inconsistent { state, iterations, .. }) => {
            let solver = if solver == Solver::Best { Solver::Vp } else { solver };
            let state = unknowns(&state);
            return Ok(ColdStart { state, iterations, solver, alternatives: Vec::new() });
        }
        Err(cause) => return Err(PositioningError::Diverged { satellites: set.len(), cause }),
    };
    Ok(ColdStart {
        state: unknowns(&solution.state),
        iterations: solution.iterations,
        solver,
        alternatives: solution.alternatives.iter().map(unknowns).collect(),
    })
}

/// A place with its clock terms, 0 where there is none.
fn unknowns(state: &State) -> Unknowns {
    let place = state.position_m;
    let mut unknowns = Unknowns::new(place.x, place.y, place.z, 0.0, 0.0);
    unknowns[BIAS] = state.bias_m.unwrap_or(0.0);
    unknowns[DRIFT] = state.drift_mps.unwrap_or(0.0);
    unknowns
}
