//! The generalised gradient family: the table of an independent reference, its closed forms, and the
//! covariance of averaged epochs.

use crate::common::Tested;
use nalgebra::{Matrix4, Vector3, Vector4};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use sdr_rx::position::solver::descent::DescentDirection::{Diagonal, GaussNewton, Gradient};
use sdr_rx::position::solver::descent::StepRule::{
    self, Backtracking, BarzilaiBorwein, Constant, Geometric,
};
use sdr_rx::position::solver::descent::{Descent, DescentDirection};
use sdr_rx::position::solver::failure::Failure;
use sdr_rx::position::solver::point_solution::Damped;
use sdr_rx::position::{Place, Row, RowKind, Satellite};

/// Unit of the course's coordinates, m.
const R: f64 = 6371e3;
/// Clock bias of the course, m.
const BIAS: f64 = 2.354_788_068e-3 * R;

/// The four satellites of Kreutz-Delgado's project, GDOP 22.2, condition 3036.
fn course() -> [Satellite; 4] {
    let positions =
        [[3.5852, 2.07, 0.0], [2.9274, 2.9274, 0.0], [2.6612, 0.0, 3.1712], [1.4159, 0.0, 3.8904]];
    positions
        .map(|p| Satellite { position_m: R * Vector3::from(p), velocity_mps: Vector3::zeros() })
}

fn truth() -> Vector3<f64> {
    Vector3::new(R, 0.0, 0.0)
}

fn start() -> Place {
    Place::at(R * Vector3::new(0.9331, 0.25, 0.258819))
}

fn observe() -> Vec<Row> {
    course().map(|s| Row::range(s, RowKind::Range.see(&s, &truth()).value + BIAS)).to_vec()
}

fn error(state: &Place) -> f64 {
    (state.position_m - truth()).norm().hypot(state.clock() - BIAS)
}

/// Result of the reference.
enum End {
    /// After steps and evaluations of the cost, to 1 mm.
    Converged(usize, Option<usize>),
    /// At this distance, m, printed to two digits.
    Stalled(f64),
    Diverged,
}

/// Counts within 1 (Gauss-Newton) or 2 %, as required; stalls within 5 % of two printed digits.
#[test]
fn descent_takes_the_steps_of_the_reference() -> Tested {
    let rows = observe();
    let geometric = |first, ratio| Geometric { first, ratio };
    let halving = Backtracking { first: 1.0, ratio: 0.5 };
    use End::{Converged, Diverged, Stalled};
    let cases: [(DescentDirection, StepRule, End); 17] = [
        (GaussNewton, Constant(1.0), Converged(4, None)),
        (GaussNewton, Constant(0.9), Converged(10, None)),
        (GaussNewton, Constant(0.5), Converged(32, None)),
        (GaussNewton, Constant(1.5), Converged(32, None)),
        (GaussNewton, Constant(2.1), Diverged),
        (GaussNewton, geometric(1.0, 0.5), Stalled(33e3)),
        (GaussNewton, geometric(1.0, 0.9), Stalled(0.15)),
        (GaussNewton, geometric(1.0, 0.99), Converged(7, None)),
        (GaussNewton, halving, Converged(4, None)),
        (Gradient, Constant(0.316), Converged(32_070, None)),
        (Gradient, Constant(0.1), Converged(101_068, None)),
        (Gradient, Constant(0.5), Diverged),
        (Gradient, halving, Converged(28_591, Some(73_941))),
        (Gradient, geometric(0.3, 0.9), Stalled(1900e3)),
        (Gradient, geometric(0.3, 0.99), Stalled(1500e3)),
        (Gradient, geometric(0.3, 0.999), Stalled(840e3)),
        (Diagonal, Constant(0.5), Converged(45_283, None)),
    ];
    for (direction, rule, expected) in cases {
        let mut evaluations = 0;
        let outcome = Descent::new(direction, rule).solve(&rows, &start(), |step| {
            evaluations += match step.damped {
                Damped::Cost(tries) => 1 + tries as usize,
                _ => 1,
            };
        });
        let label = format!("{direction:?} {rule:?}");
        println!(
            "{label}: {:?}, {evaluations} evaluations",
            outcome.as_ref().map(|s| s.iterations).map_err(|e| (e, e.state().map(error)))
        );
        let near = |ours: usize, theirs: usize| {
            let allowed = if direction == GaussNewton { 1.0 } else { 0.02 * theirs as f64 };
            (ours as f64 - theirs as f64).abs() <= allowed
        };
        let agrees = match (outcome, expected) {
            (Ok(ours), Converged(steps, cost)) => {
                near(ours.iterations, steps) && cost.is_none_or(|cost| near(evaluations, cost))
            }
            (Err(Failure::Stalled { state, .. }), Stalled(distance)) => {
                (error(&state) / distance - 1.0).abs() < 0.05
            }
            (Err(Failure::Diverged { .. }), Diverged) => true,
            _ => false,
        };
        if !agrees {
            return Err(format!("{label} does not end as the reference").into());
        }
    }
    // Barzilai-Borwein: far fewer steps than any constant one; the reference's variant takes 356.
    let quick = Descent::new(Gradient, BarzilaiBorwein).solve(&rows, &start(), |_| ())?;
    println!("Barzilai-Borwein: {} steps", quick.iterations);
    if quick.iterations > 1000 {
        return Err("Barzilai-Borwein is slow".into());
    }
    // In floating point no strict decrease exists at the minimum: a tolerance below rounding gives an error.
    let endless = Descent { tolerance_m: 0.0, ..Descent::new(GaussNewton, halving) };
    let end = endless.solve(&rows, &start(), |_| ());
    let too_slow = Descent { max_iterations: 100, ..Descent::new(Gradient, Constant(0.1)) };
    let slow = too_slow.solve(&rows, &start(), |_| ());
    match (end, slow) {
        (Err(Failure::NoDecrease { .. }), Err(Failure::TooSlow { iterations: 100, .. })) => Ok(()),
        other => Err(format!("not 'no decrease' and 'too slow': {other:?}").into()),
    }
}

/// Jacobian by place and bias at the truth.
fn normal() -> Matrix4<f64> {
    let seen = |s: &Satellite| RowKind::Range.see(s, &truth());
    let row = |s: &Satellite| RowKind::Range.gradient(s, &seen(s)).push(1.0);
    course().iter().map(row).map(|h: Vector4<f64>| h * h.transpose()).sum()
}

/// Near the minimum the slowest part of the error shrinks by `1 - alpha lmin` a step: the steps between
/// 1 km and 1 m are `ln 1000 / -ln(1 - alpha lmin)`, to one step.
#[test]
fn gradient_descent_converges_at_the_rate_of_the_condition() -> Tested {
    let rows = observe();
    let spread = normal().symmetric_eigenvalues();
    let alpha = 2.0 / (spread.min() + spread.max());
    let mut steps = 0;
    Descent::new(Gradient, Constant(alpha)).solve(&rows, &start(), |step| {
        let error = error(&step.state);
        steps += usize::from((1.0..1e3).contains(&error));
    })?;
    let expected = 1000f64.ln() / -(1.0 - alpha * spread.min()).ln();
    println!("condition {:.0}: {steps} steps from 1 km to 1 m, theory {expected:.1}", {
        spread.max() / spread.min()
    });
    // At this step length the fastest part shrinks as slowly: within 0.1 % after the first steps.
    match (steps as f64 - expected).abs() <= 1.0 + 1e-3 * expected {
        true => Ok(()),
        false => Err("the rate is not that of the condition".into()),
    }
}

/// 4000 runs with a standard deviation of 5 m, 9 epochs each: each standard deviation is known to 1/sqrt(2 * 4000)
/// = 1.1 %,
/// so that 5 % is more than four of them. The mean of the epochs gives what all rows stacked give.
#[test]
fn covariance_of_averaged_epochs_is_that_of_many_runs() -> Tested {
    const RUNS: usize = 4000;
    const EPOCHS: usize = 9;
    const SIGMA: f64 = 5.0;
    let exact = observe();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let solver = Descent { tolerance_m: 1e-5, ..Descent::new(GaussNewton, Constant(1.0)) };
    let theory =
        (normal() * (EPOCHS as f64 / SIGMA.powi(2))).try_inverse().ok_or("singular")?.diagonal();
    let mut squares = Vector3::zeros();
    for number in 0..RUNS {
        let epochs: Vec<Vec<Row>> = (0..EPOCHS)
            .map(|_| {
                let noise = |row: &Row| {
                    let z: f64 = StandardNormal.sample(&mut rng);
                    Row { value: row.value + SIGMA * z, sigma: Some(SIGMA), ..*row }
                };
                exact.iter().map(noise).collect()
            })
            .collect();
        let count = EPOCHS as f64;
        let mean = |k: usize| epochs.iter().map(|epoch| epoch[k].value).sum::<f64>() / count;
        let row = |k| Row { value: mean(k), ..exact[k] }.with_sigma(SIGMA / count.sqrt());
        let rows: Vec<Row> = (0..exact.len()).map(row).collect();
        let fix = solver.solve(&rows, &start(), |_| ())?;
        squares += (fix.state.position_m - truth()).map(|e| e * e) / RUNS as f64;
        if number == 0 {
            let stacked = solver.solve(&epochs.concat(), &start(), |_| ())?;
            // Rounding of 2.6e7 m, 4e-9 m, times the dilution of 22.
            let apart = (stacked.state.position_m - fix.state.position_m).norm();
            let same = (stacked.covariance - fix.covariance).norm() / fix.covariance.norm();
            println!("averaged against stacked: {apart:.1e} m, covariances {same:.1e}");
            if apart > 1e-7 || same > 1e-9 {
                return Err("the averaged epochs differ from the stacked ones".into());
            }
            for k in 0..3 {
                // The covariance is that at the noisy optimum, some 10 m away of 2e7 m.
                if (fix.covariance[(k, k)] / theory[k] - 1.0).abs() > 1e-4 {
                    return Err("the covariance is not sigma^2/m (H^T H)^-1".into());
                }
            }
        }
    }
    let ratios = squares.zip_map(&theory.xyz(), |s, t| (s / t).sqrt());
    println!("standard deviations of {RUNS} runs over theory: {:.3?}", ratios.as_slice());
    match ratios.iter().all(|r| (r - 1.0).abs() < 0.05) {
        true => Ok(()),
        false => Err("the covariance does not describe the errors".into()),
    }
}
