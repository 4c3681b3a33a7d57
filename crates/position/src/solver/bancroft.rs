//! Bancroft's algebraic solution of pseudoranges, both roots, and its refinement by Gauss-Newton.
//!
//! S. Bancroft, "An Algebraic Solution of the GPS Equations", IEEE Trans. AES-21 (1985) 56-59. With the
//! Lorentz product `<a, b> = a1 b1 + a2 b2 + a3 b3 - a4 b4`, satellites `a_i = (s_i, P_i)`, the unknown
//! `y = (r, b)` and `2 L = <y, y>`, each pseudorange says `<a_i, y> = <a_i, a_i>/2 + L`. Least squares on
//! the rows gives `y = p + L q`, and `<y, y> = 2 L` a quadratic in `L`, with a place for each root:
//!
//! `<q, q> L^2 + 2 (<p, q> - 1) L + <p, p> = 0`
//!
//! Of more than four pseudoranges the roots are not the least-squares solution, but near it: the root
//! with the smaller cost is refined by Gauss-Newton with backtracking, which takes two linearisations.
//! With four both roots are exact; both are given where both lie near the Earth's surface.

use super::aw_dgn_bt::{Damping, from};
use super::failure::Failure;
use super::plausibility::{SAME_M, believed_costs, near_the_surface};
use super::point_solution::{Ambiguity, Iteration, PointSolution};
use crate::least_squares::{LeastSquares, LinearRow};
use crate::place::Place;
use crate::problem::{Problem, Row, RowKind};
use nalgebra::Vector4;

/// Both roots, that with the smaller sum of squared residuals first; the second is absent where the
/// quadratic is linear.
///
/// # Errors
/// [`Failure::PseudorangesOnly`], [`Failure::OneClockOnly`], too few observations, and geometries that the
/// algebra cannot take: satellites in one plane with the Earth's centre, or no real root.
pub fn bancroft(rows: &[Row]) -> Result<(Place, Option<Place>), Failure> {
    roots(&checked(rows)?)
}

fn checked(rows: &[Row]) -> Result<Problem<'_>, Failure> {
    if rows.iter().any(|row| row.kind == RowKind::RangeRate) {
        return Err(Failure::PseudorangesOnly { solver: "bancroft" });
    }
    if rows.iter().any(|row| row.clock != rows[0].clock) {
        return Err(Failure::OneClockOnly { solver: "bancroft" });
    }
    Problem::new(rows)
}

/// Bancroft's better root refined to the least-squares solution. `trace` sees the steps of the
/// refinement.
///
/// # Errors
/// Those of [`bancroft`]; [`Failure::Inconsistent`] if the standard deviations are known and the place does
/// not explain the pseudoranges; [`Failure::Implausible`] if four of them lead away from the Earth.
pub fn bancroft_gn(rows: &[Row], trace: impl FnMut(&Iteration)) -> Result<PointSolution, Failure> {
    let problem = checked(rows)?;
    let (first, second) = roots(&problem)?;
    let redundancy = problem.redundancy();
    let surface = |state: &Place| near_the_surface(&state.position_m);
    // With four, both fit: that near the Earth is meant.
    let swapped = redundancy == 0 && !surface(&first) && second.as_ref().is_some_and(surface);
    let (start, other) = match second {
        Some(second) if swapped => (second, Some(first)),
        _ => (first, second),
    };
    let mut solution = from(&problem, &Damping::ADGN_BT, &start, trace)?;
    let iterations = solution.iterations;
    if redundancy == 0 {
        if !surface(&solution.state) {
            return Err(Failure::Implausible { state: solution.state, iterations });
        }
        if let Some(other) = other.filter(surface) {
            solution.alternatives.push(other);
            solution.ambiguity = Ambiguity::Several;
        }
        return Ok(solution);
    }
    let ([_, limit], cost) = (believed_costs(&problem), solution.cost);
    if cost >= limit {
        return Err(Failure::Inconsistent { state: solution.state, cost, limit, iterations });
    }
    if problem.sigma_known {
        solution.ambiguity = Ambiguity::None;
    }
    // Of satellites in one plane the other root is the mirror image, and explains all as well.
    if let Some(other) = other.filter(surface)
        && let Ok(second) = from(&problem, &Damping::ADGN_BT, &other, |_| ())
    {
        solution.search_iterations = second.iterations;
        let apart = (second.state.position_m - solution.state.position_m).norm();
        if apart > SAME_M && second.cost < limit && surface(&second.state) {
            solution.alternatives.push(second.state);
            solution.ambiguity = Ambiguity::Several;
        }
    }
    Ok(solution)
}

fn roots(problem: &Problem) -> Result<(Place, Option<Place>), Failure> {
    let failed = || problem.diagnose(&problem.point(&Place::centre()), 0);
    let (p, q) = projections(problem).ok_or_else(failed)?;
    let product = |a: &Vector4<f64>, b: &Vector4<f64>| a.xyz().dot(&b.xyz()) - a.w * b.w;
    // Roots of a L^2 + 2 b L + c, in the form that loses no digits; noise can make a double root complex.
    let (a, b, c) = (product(&q, &q), product(&p, &q) - 1.0, product(&p, &p));
    let h = -(b + (b * b - a * c).max(0.0).sqrt().copysign(b));
    let mut system = LeastSquares::default();
    let mut place = |l: f64| {
        let y = p + l * q;
        let at = problem.point_by(y.xyz(), y.w);
        problem.look(&at, &mut system, |_| ());
        let cost = system.cost();
        cost.is_finite().then(|| (cost, problem.state(&at)))
    };
    match (place(c / h), place(h / a)) {
        (Some(x), Some(y)) if y.0 < x.0 => Ok((y.1, Some(x.1))),
        (Some(x), y) => Ok((x.1, y.map(|y| y.1))),
        (None, Some(y)) => Ok((y.1, None)),
        (None, None) => Err(failed()),
    }
}

/// `p` and `q` of the module's head: least squares, weighted, for `<a_i, a_i>/2` and for 1.
fn projections(problem: &Problem) -> Option<(Vector4<f64>, Vector4<f64>)> {
    let mut system = LeastSquares::<4, 6>::default();
    system.set(problem.rows.iter().zip(&problem.weights).map(|(row, weight)| {
        let (s, range) = (row.satellite.position_m, row.value);
        let half = (s.norm_squared() - range * range) / 2.0;
        let row = [s.x, s.y, s.z, -range, half, 1.0].map(|v| v * weight);
        LinearRow { row, weight: *weight, term: None }
    }));
    system.factor(0)?;
    Some((system.minimiser(4), system.minimiser(5)))
}
