//! The paper's scenarios, against the figures of an independent reference implementation.

use crate::common::{Failed, Tested, data};
use crate::sky::{scaled_down, weighted};
use nalgebra::Vector3;
use sdr_rx::gnss::constants::EARTH_RADIUS;
use sdr_rx::gnss::coordinates::{Geodetic, azimuth_elevation};
use sdr_rx::position::solver::aw_dgn_bt::{Damping, iterate};
use sdr_rx::position::solver::point_solution::Iteration;
use sdr_rx::position::{Place, Row, RowKind, Satellite, Solver};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

#[derive(Deserialize)]
struct Turin {
    altitudes_m: Vec<f64>,
    truth_ecef_m: [f64; 3],
    cases: Vec<TurinCase>,
}

#[derive(Deserialize)]
struct TurinCase {
    observable: String,
    satellites: Vec<usize>,
    sigma: f64,
    expected: BTreeMap<String, Expected>,
    native_sat_pos_m: Vec<Vec<[f64; 3]>>,
    native_sat_vel_mps: Vec<Vec<[f64; 3]>>,
    traces: Vec<Trace>,
}

#[derive(Deserialize)]
struct Expected {
    ok: usize,
    altitudes_all_ok: usize,
    mean_iterations_ok: f64,
}

#[derive(Deserialize)]
struct Trace {
    solver: String,
    sat_pos_m: Vec<[f64; 3]>,
    sat_vel_mps: Vec<[f64; 3]>,
    y: Vec<f64>,
    status: String,
    steps: Vec<TraceStep>,
}

#[derive(Deserialize)]
struct TraceStep {
    mu: f64,
    step_norm: f64,
    phi_before: f64,
    position_m: [f64; 3],
    clock: f64,
}

#[derive(Deserialize)]
struct Sites {
    cases: Vec<SiteCase>,
    native_sat_pos_m: Vec<Vec<[f64; 3]>>,
    native_sat_vel_mps: Vec<Vec<[f64; 3]>>,
}

#[derive(Deserialize)]
struct SiteCase {
    lat_lon_h: [f64; 3],
    observable: String,
    expected: BTreeMap<String, Expected>,
}

fn load<T: serde::de::DeserializeOwned>(folder: &Path, name: &str) -> Result<T, Failed> {
    let text = std::fs::read_to_string(folder.join("vectors").join(name))?;
    Ok(serde_json::from_str(&text)?)
}

/// By the reference's name: `ADGN mu0=0.08` and the like.
fn solver(name: &str) -> Result<Solver, Failed> {
    let ours = match name {
        "VP centroid" => "vp-once".to_owned(),
        _ => name.to_lowercase().replace(" mu0=", ":"),
    };
    Ok(ours.parse::<Solver>()?)
}

fn satellites(positions: &[[f64; 3]], velocities: &[[f64; 3]]) -> Vec<Satellite> {
    let pair = |(p, v): (&[f64; 3], &[f64; 3])| Satellite {
        position_m: Vector3::from(*p),
        velocity_mps: Vector3::from(*v),
    };
    positions.iter().zip(velocities).map(pair).collect()
}

/// One epoch of a scenario: identities and native states of the satellites in view.
type Epoch = Vec<(usize, Satellite)>;

/// Number of runs within 1 m of the least-squares optimum, and their mean iterations.
struct Tally {
    runs: usize,
    ok: usize,
    altitudes_all_ok: usize,
    mean_iterations: f64,
}

/// The reference's name of an observable.
fn kind(observable: &str) -> RowKind {
    if observable == "doppler" { RowKind::RangeRate } else { RowKind::Range }
}

fn tally(
    observable: &str,
    epochs: &[Epoch],
    truth: &Vector3<f64>,
    altitudes_m: &[f64],
    sigma: f64,
    solver: Solver,
) -> Tally {
    let kind = kind(observable);
    let mut tally = Tally { runs: 0, ok: 0, altitudes_all_ok: 0, mean_iterations: 0.0 };
    let mut iterations = 0;
    for (index, altitude) in altitudes_m.iter().enumerate() {
        let mut all = true;
        for (number, epoch) in epochs.iter().enumerate() {
            let noise = |id: usize| {
                let angle =
                    1.0 + 12.9898 * id as f64 + 78.233 * number as f64 + 37.719 * index as f64;
                sigma * 2f64.sqrt() * angle.sin()
            };
            // The paper's iterations are unweighted: their tolerances are in metres.
            let row = |(id, satellite): &(usize, Satellite)| {
                let satellite = scaled_down(satellite, truth, EARTH_RADIUS + altitude);
                Row::new(kind, satellite, kind.see(&satellite, truth).value + noise(*id))
            };
            let plain: Vec<Row> = epoch.iter().map(row).collect();
            let optimum = iterate(&plain, &Damping::ADGN_BT, &Place::at(*truth), |_| ());
            let fix = match solver {
                Solver::Vp | Solver::Best => solver.solve(&weighted(&plain, sigma), |_| ()),
                _ => solver.solve(&plain, |_| ()),
            };
            tally.runs += 1;
            match (fix, optimum) {
                (Ok(fix), Ok(best))
                    if (fix.state.position_m - best.state.position_m).norm() < 1.0 =>
                {
                    tally.ok += 1;
                    iterations += fix.iterations;
                }
                _ => all = false,
            }
        }
        tally.altitudes_all_ok += usize::from(all);
    }
    tally.mean_iterations = iterations as f64 / tally.ok as f64;
    tally
}

/// Success within 0.3 % of the runs, mean iterations within 0.03; AW-DGN-BT and the variable projection succeed always. The
/// reference rounds differently, which decides runs that end on the edge of a basin.
fn compare(label: &str, name: &str, ours: &Tally, expected: &Expected) -> Tested {
    println!(
        "{label} {name}: {}/{} ok, {} altitudes, {:.3} iterations (reference {} {} {:.3})",
        ours.ok,
        ours.runs,
        ours.altitudes_all_ok,
        ours.mean_iterations,
        expected.ok,
        expected.altitudes_all_ok,
        expected.mean_iterations_ok
    );
    let tolerance = 0.003 * ours.runs as f64;
    let same_count = (ours.ok as f64 - expected.ok as f64).abs() <= tolerance;
    let complete = !matches!(name, "AW-DGN-BT" | "VP centroid")
        || (ours.ok == ours.runs && ours.altitudes_all_ok == 100);
    let same_mean = (ours.mean_iterations - expected.mean_iterations_ok).abs() <= 0.03;
    if same_count && complete && same_mean {
        Ok(())
    } else {
        Err(format!("{label} {name} differs from the reference").into())
    }
}

#[test]
fn turin_counts_agree_with_the_reference() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let data: Turin = load(folder, "position_turin.json")?;
    let truth = Vector3::from(data.truth_ecef_m);
    for case in &data.cases {
        let epochs: Vec<Epoch> = case
            .native_sat_pos_m
            .iter()
            .zip(&case.native_sat_vel_mps)
            .map(|(p, v)| case.satellites.iter().copied().zip(satellites(p, v)).collect())
            .collect();
        for (name, expected) in &case.expected {
            let (observable, sigma) = (&case.observable, case.sigma);
            let ours = tally(observable, &epochs, &truth, &data.altitudes_m, sigma, solver(name)?);
            compare(&format!("Turin {}", case.observable), name, &ours, expected)?;
        }
    }
    Ok(())
}

#[test]
fn aw_dgn_bt_always_converges_at_the_three_sites() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let data: Sites = load(folder, "position_sites.json")?;
    let turin: Turin = load(folder, "position_turin.json")?;
    for case in &data.cases {
        let [latitude, longitude, height] = case.lat_lon_h;
        let truth = Geodetic::from_degrees(latitude, longitude, height).to_ecef();
        let in_view =
            |s: &Satellite| azimuth_elevation(&truth, &s.position_m).1 >= 5f64.to_radians();
        let epochs: Vec<Epoch> = data
            .native_sat_pos_m
            .iter()
            .zip(&data.native_sat_vel_mps)
            .map(|(p, v)| {
                satellites(p, v).into_iter().enumerate().filter(|(_, s)| in_view(s)).collect()
            })
            .collect();
        let sigma =
            turin.cases.iter().find(|c| c.observable == case.observable).ok_or("no sigma")?.sigma;
        for (name, expected) in &case.expected {
            let (observable, altitudes) = (&case.observable, &turin.altitudes_m);
            let ours = tally(observable, &epochs, &truth, altitudes, sigma, solver(name)?);
            compare(&format!("{:.0} {}", latitude, case.observable), name, &ours, expected)?;
        }
        for solver in ["vp", "best"] {
            let (observable, altitudes) = (&case.observable, &turin.altitudes_m);
            let ours = tally(observable, &epochs, &truth, altitudes, sigma, solver.parse()?);
            println!("{latitude:.0} {observable} {solver}: {:.3} iterations", ours.mean_iterations);
            let few = observable == "doppler" || solver == "vp" || ours.mean_iterations <= 2.3;
            if ours.ok < ours.runs || !few {
                let ok = ours.ok;
                return Err(format!("{solver} {observable}: {ok} of {}", ours.runs).into());
            }
        }
    }
    Ok(())
}

/// Relative agreement to 1e-6, but for values at the level of rounding: 1e-6 m (or m/s) in the state
/// and the step, and 1e-13 (the limit of the descent test) in the cost.
#[test]
fn traces_agree_step_by_step_with_the_reference() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let data: Turin = load(folder, "position_turin.json")?;
    let near = |a: f64, b: f64, floor: f64| (a - b).abs() <= 1e-6 * b.abs() + floor;
    for case in &data.cases {
        for reference in &case.traces {
            let label = format!("{} {}", case.observable, reference.solver);
            let solver = solver(&reference.solver)?;
            let satellites = satellites(&reference.sat_pos_m, &reference.sat_vel_mps);
            let mut steps: Vec<Iteration> = Vec::new();
            let kind = kind(&case.observable);
            let row = |(s, y): (&Satellite, &f64)| Row::new(kind, *s, *y);
            let rows: Vec<Row> = satellites.iter().zip(&reference.y).map(row).collect();
            let converged = solver.solve(&rows, |s| steps.push(s.clone())).is_ok();
            if converged != (reference.status == "converged") {
                return Err(format!("{label}: the reference ended as {}", reference.status).into());
            }
            // A run that diverges loses all digits once the lines of sight are parallel.
            let compared = if converged { reference.steps.len() } else { 4 };
            if converged && steps.len() != compared {
                return Err(format!("{label}: {} steps, not {compared}", steps.len()).into());
            }
            for (k, (ours, theirs)) in steps.iter().zip(&reference.steps).take(compared).enumerate()
            {
                let position = Vector3::from(theirs.position_m);
                // Ranges of 2.6e7 m are known to 2^-28 m, and the objective is a sum of their squares.
                let rounding = 2.0 * theirs.phi_before.sqrt() * 2f64.powi(-28) + 1e-13;
                let agree = ours.mu == theirs.mu
                    && near(ours.length, theirs.step_norm, 1e-6)
                    && near(ours.objective_before, theirs.phi_before, rounding)
                    && (ours.state.position_m - position).norm() <= 1e-6 * position.norm()
                    && near(ours.state.clock(), theirs.clock, 1e-6);
                if !agree {
                    return Err(format!(
                        "{label}, step {}: {ours:?}, not {position:?} {} {} {}",
                        k + 1,
                        theirs.mu,
                        theirs.clock,
                        theirs.phi_before
                    )
                    .into());
                }
            }
        }
    }
    Ok(())
}
