//! Wrong observations: an error that names the cause, or both positions; never a silent fix, never a panic.

use crate::common::Tested;
use crate::sky::{Skies, Walker, weighted};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sdr_rx::gnss::constants::EARTH_RADIUS;
use sdr_rx::position::solver::SOLVER_NAMES;
use sdr_rx::position::solver::bancroft::bancroft;
use sdr_rx::position::solver::failure::Failure;
use sdr_rx::position::solver::point_solution::{
    Ambiguity, Damped, Iteration, PointSolution, trace_csv,
};
use sdr_rx::position::{Place, Row, RowKind, Satellite, Solver};

/// Every solver by name, with sensible numbers.
fn solvers() -> Vec<Solver> {
    SOLVER_NAMES
        .split(", ")
        .map(|name| name.replace("MU0", "0.08").replace("ALPHA", "0.1").replace("BETA", "0.99"))
        .map(|name| name.parse().expect("a name of the list"))
        .collect()
}

fn ensure(holds: bool, what: impl Fn() -> String) -> Tested {
    if holds { Ok(()) } else { Err(what().into()) }
}

/// Six satellites of the paper's constellation over a random place.
fn sky() -> (Vec<Satellite>, Vector3<f64>, Vec<Row>, Vec<Row>) {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let skies = Skies::new(&Walker::GALILEO_LIKE, 1, &mut rng);
    let draw = skies.draw(&mut rng, 0.0..=0.0, 6);
    let ranges = draw.observe(RowKind::Range, &mut rng, 4e4, 1.0);
    let rates = draw.observe(RowKind::RangeRate, &mut rng, 200.0, 0.1);
    (draw.satellites, draw.truth, ranges, rates)
}

#[test]
fn impossible_observations_are_refused_by_every_solver() -> Tested {
    let (_, truth, ranges, rates) = sky();
    for solver in solvers() {
        let refused = |rows: &[Row], expected: Failure| {
            let outcome = solver.solve(rows, |_| ());
            ensure(outcome.as_ref() == Err(&expected), || format!("{solver}: {outcome:?}"))
        };
        let metre = weighted(&ranges, 1.0);
        refused(&metre[..3], Failure::Observations { rows: 3, needed: 4 })?;
        for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut broken = metre.clone();
            broken[2].value = wrong;
            refused(&broken, Failure::NotFinite { row: 2, what: "value" })?;
            let mut lost = metre.clone();
            lost[4].satellite.position_m.y = wrong;
            refused(&lost, Failure::NotFinite { row: 4, what: "satellite position" })?;
        }
        for sigma in [0.0, -1.0, f64::NAN] {
            let row = 0;
            refused(&weighted(&ranges, sigma), Failure::NotFinite { row, what: "deviation" })?;
        }
        // All at one point: nothing can come of it, and no solver may say otherwise.
        let heaped = solver.solve(&[metre[0]; 6], |_| ());
        ensure(heaped.is_err(), || format!("{solver}: {heaped:?}"))?;
        // A clock without number, and a clock for each observation.
        let clocks = |first: usize| -> Vec<Row> {
            (first..).zip(&metre).map(|(clock, row)| Row { clock, ..*row }).collect()
        };
        if solver == Solver::Bancroft {
            refused(&clocks(0), Failure::OneClockOnly { solver: "bancroft" })?;
        } else {
            refused(&[ranges.clone(), rates.clone()].concat(), Failure::NoDeviation)?;
            refused(&clocks(1), Failure::Clock { row: 5 })?;
            refused(&clocks(0), Failure::Observations { rows: 6, needed: 9 })?;
        }
    }
    let refused = Solver::Bancroft.solve(&rates, |_| ());
    ensure(refused == Err(Failure::PseudorangesOnly { solver: "bancroft" }), || {
        format!("{refused:?}")
    })?;
    // A satellite where the receiver is: as if its position were that of the antenna.
    let mut here = weighted(&ranges, 1.0);
    here[3].satellite.position_m = truth;
    here[3].value = 4e4;
    for solver in [Solver::Best, Solver::Vp, Solver::AwDgnBt, Solver::Bancroft] {
        let fix = solver.solve(&here, |_| ());
        println!("{solver}, a satellite at the receiver: {fix:?}");
        ensure(fix.is_err(), || format!("{solver}: {fix:?}"))?;
    }
    // One at the Earth's centre, as a missing orbit of zeros.
    let mut zero = ranges.clone();
    zero[1].satellite.position_m = Vector3::zeros();
    let centre = Solver::AwDgnBt.solve(&zero, |_| ());
    ensure(centre == Err(Failure::Coincident { row: 1 }), || format!("{centre:?}"))
}

/// Satellites of one orbital plane: a position beside it has a mirror image on the Earth, and at a position
/// within it the direction across is not observed. Noise of 1 m, the test's positions 2000 km apart.
#[test]
fn satellites_in_one_plane_give_both_positions_or_none() -> Tested {
    let along = |angle: f64| Satellite {
        position_m: 26.6e6 * Vector3::new(angle.cos(), angle.sin(), 0.0),
        velocity_mps: 3.9e3 * Vector3::new(-angle.sin(), angle.cos(), 0.0),
    };
    let satellites: Vec<Satellite> = [-0.9, -0.5, -0.1, 0.3, 0.8].map(along).to_vec();
    let beside = EARTH_RADIUS * Vector3::new(0.97, 0.2, (1.0 - 0.97f64.powi(2) - 0.04).sqrt());
    let mirrored = beside.component_mul(&Vector3::new(1.0, 1.0, -1.0));
    let both = |solver: Solver, fix: Result<_, Failure>| -> Tested {
        let fix: PointSolution = fix?;
        let near = |place: &Vector3<f64>| {
            let at = |s: &Place| (s.position_m - place).norm() < 1e3;
            at(&fix.state) || fix.alternatives.iter().any(at)
        };
        ensure(fix.ambiguity == Ambiguity::Several && near(&beside) && near(&mirrored), || {
            format!("{solver}: {fix:?}")
        })
    };
    let observed = |kind: RowKind| -> Vec<Row> {
        let row = |s: &Satellite| Row::new(kind, *s, kind.see(s, &beside).value + 50.0);
        satellites.iter().map(row).collect()
    };
    let (pseudoranges, dopplers) = (observed(RowKind::Range), observed(RowKind::RangeRate));
    for solver in [Solver::Best, Solver::Vp] {
        both(solver, solver.solve(&weighted(&pseudoranges, 1.0), |_| ()))?;
        // Within the plane the gradients have no part across it, and starts beside it may jam.
        match solver.solve(&weighted(&dopplers, 1e-3), |_| ()) {
            Err(Failure::Coplanar) => {}
            other => both(solver, other)?,
        }
    }
    let from_centre = Solver::AwDgnBt.solve(&pseudoranges, |_| ());
    ensure(from_centre == Err(Failure::Coplanar), || format!("{from_centre:?}"))
}

/// With redundant observations a fault shows in the residuals, and the best position is given with it.
#[test]
fn one_faulty_satellite_is_said() -> Tested {
    let (_, _, mut pseudoranges, mut dopplers) = sky();
    pseudoranges[1].value += 5e3;
    dopplers[2].value += 50.0;
    let said = |fix: Result<_, Failure>| {
        ensure(
            matches!(fix, Err(Failure::Inconsistent { cost, limit, .. }) if cost > limit),
            || format!("{fix:?}"),
        )
    };
    for solver in [Solver::Best, Solver::Vp] {
        said(solver.solve(&weighted(&pseudoranges, 1.0), |_| ()))?;
        said(solver.solve(&weighted(&dopplers, 0.1), |_| ()))?;
        let unknown = solver.solve(&pseudoranges, |_| ())?;
        ensure(unknown.ambiguity == Ambiguity::Unverified, || format!("{unknown:?}"))?;
    }
    Ok(())
}

/// A bias of a second, 3e8 m, costs digits of the ranges (6e-8 m), and a drift of 330 ppm none: the position
/// changes by less than a micrometre times the dilution, of 3 here; Dopplers are a thousand times weaker.
#[test]
fn a_clock_of_a_second_does_not_move_the_place() -> Tested {
    let (_, _, ranges, rates) = sky();
    let moved = |rows: &[Row], by: f64| -> Vec<Row> {
        rows.iter().map(|row| Row { value: row.value + by, ..*row }).collect()
    };
    for name in ["aw-dgn-bt", "vp", "vp-once", "best"] {
        let solver: Solver = name.parse()?;
        let at = |rows: &[Row]| Ok::<_, Failure>(solver.solve(rows, |_| ())?.state.position_m);
        let shift = (at(&ranges)? - at(&moved(&ranges, 299_792_458.0))?).norm();
        let slow = (at(&rates)? - at(&moved(&rates, 1e5))?).norm();
        println!("{name}: {shift:.1e} m for a second, {slow:.1e} m for 330 ppm");
        // The required bound, and 1.5e-11 m/s over a gradient of 1e-4 /s.
        ensure(shift < 1e-6 && slow < 1e-5, || format!("{name}: {shift:.1e} {slow:.1e}"))?;
    }
    Ok(())
}

/// Central differences: truncation is (step/range)^2, rounding 4e-9 m / step for ranges of 2e7 m and
/// 1e-12 m/s / step for rates; of second differences 4 times that over the step again.
#[test]
fn derivatives_are_those_of_the_predictions() -> Tested {
    fn check(kind: RowKind, step: f64, first: f64, second: f64) -> Tested {
        let (satellites, truth, ..) = sky();
        for satellite in &satellites {
            let seen = kind.see(satellite, &truth);
            let gradient = kind.gradient(satellite, &seen);
            let along = Vector3::new(0.48, -0.6, 0.64);
            let at = |t: f64| kind.see(satellite, &(truth + t * along)).value;
            let slope = (at(step) - at(-step)) / (2.0 * step);
            let bend = (at(step) - 2.0 * at(0.0) + at(-step)) / (step * step);
            let ours = kind.curvature(&seen, gradient.dot(&along), &along);
            ensure(
                (slope - gradient.dot(&along)).abs() < first && (bend - ours).abs() < second,
                || format!("slope {slope} not {}, bend {bend} not {ours}", gradient.dot(&along)),
            )?;
        }
        Ok(())
    }
    check(RowKind::Range, 1e4, 1e-6, 1e-13)?;
    check(RowKind::RangeRate, 1e4, 1e-10, 1e-16)
}

/// Four pseudoranges of a receiver in a high orbit: both roots explain them, and one is the truth.
#[test]
fn both_roots_are_positions_with_the_same_pseudoranges() -> Tested {
    let (satellites, _, _, _) = sky();
    let truth = 1.3 * satellites[0].position_m + Vector3::new(3e6, -2e6, 1e6);
    let range = |s: &Satellite, place: &Vector3<f64>| RowKind::Range.see(s, place).value;
    let four: Vec<Row> =
        satellites[..4].iter().map(|s| Row::range(*s, range(s, &truth) - 1e3)).collect();
    let (one, two) = bancroft(&four)?;
    let two = two.ok_or("one root only")?;
    let misfit = |s: &Place| {
        four.iter().fold(0.0f64, |worst, row| {
            // A root behind the satellites explains the squares, with the sign turned.
            let range = range(&row.satellite, &s.position_m);
            worst.max(((row.value - s.clock()).abs() - range).abs())
        })
    };
    println!("misfits {:.1e} and {:.1e} m", misfit(&one), misfit(&two));
    // Squares of 5e7 m are known to 0.25 m^2: 5e-9 m of range, times the condition of some 1e3.
    let is_truth = |s: &Place| (s.position_m - truth).norm() < 1e-2;
    ensure(misfit(&one) < 1e-3 && misfit(&two) < 1e-3 && (is_truth(&one) || is_truth(&two)), || {
        format!("{one:?} {two:?}")
    })
}

/// Of the paper's setting at 160 km: the first step is damped by the bound on the radius, the last are full.
#[test]
fn a_trace_shows_why_steps_were_damped() -> Tested {
    let (satellites, truth, ..) = sky();
    let radius = EARTH_RADIUS + 160e3;
    let low = satellites.iter().map(|s| crate::sky::scaled_down(s, &truth, radius));
    let rows: Vec<Row> = low.map(|s| Row::range(s, RowKind::Range.see(&s, &truth).value)).collect();
    let mut steps: Vec<Iteration> = Vec::new();
    let fix = Solver::AwDgnBt.solve(&rows, |step| steps.push(step.clone()))?;
    ensure(steps.len() == fix.iterations, || "a step for each linearisation".to_owned())?;
    for step in &steps {
        let (wall, cost) = match step.damped {
            Damped::No => (0, 0),
            Damped::Cost(cost) => (0, cost),
            Damped::Wall(wall) => (wall, 0),
            Damped::Both { wall, cost } => (wall, cost),
            other => return Err(format!("{other:?} in AW-DGN-BT").into()),
        };
        ensure(step.mu == 0.5f64.powi((wall + cost) as i32), || format!("{step:?}"))?;
    }
    let walled = |s: &Iteration| matches!(s.damped, Damped::Wall(_) | Damped::Both { .. });
    ensure(walled(&steps[0]) && steps[steps.len() - 1].damped == Damped::No, || {
        format!("{steps:?}")
    })?;
    let csv = trace_csv(&steps);
    let columns = |line: &str| line.split(',').count();
    let header = columns(csv.lines().next().unwrap_or_default());
    ensure(
        csv.lines().count() == 1 + steps.len() && csv.lines().all(|line| columns(line) == header),
        || csv.clone(),
    )
}
