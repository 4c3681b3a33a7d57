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

use super::aw_dgn_bt::{Damping, iterate};
use super::belief::{SAME_M, believed_costs, near_the_surface};
use super::gram_schmidt::orthogonalise;
use super::observations::Observations;
use super::outcome::{Ambiguity, Failure, Solution, State, Step};
use super::system::{MAX_ROWS, System, unseen};
use nalgebra::Vector4;

/// Both roots, that with the smaller sum of squared residuals first; the second is absent where the
/// quadratic is linear. Allocates nothing.
///
/// # Errors
/// [`Failure::PseudorangesOnly`], a wrong number of observations, and geometries that the algebra
/// cannot take: satellites in one plane with the Earth's centre, or no real root.
pub fn bancroft<O: Observations>(observations: &O) -> Result<(State, Option<State>), Failure> {
    match observations.rows().iter().sum() {
        0..=16 => roots::<O, 16>(observations),
        17..=64 => roots::<O, 64>(observations),
        _ => roots::<O, MAX_ROWS>(observations),
    }
}

/// Bancroft's better root refined to the least-squares solution. `trace` sees the steps of the
/// refinement.
///
/// # Errors
/// Those of [`bancroft`]; [`Failure::Inconsistent`] if the deviations are known and the place does not
/// explain the pseudoranges; [`Failure::Implausible`] if four of them lead away from the Earth.
pub fn bancroft_gn<O: Observations>(
    observations: &O,
    trace: impl FnMut(&Step),
) -> Result<Solution, Failure> {
    let (first, second) = bancroft(observations)?;
    let redundancy = observations.rows()[0] - 4;
    let surface = |state: &State| near_the_surface(&state.position_m);
    // With four, both fit: that near the Earth is meant.
    let swapped = redundancy == 0 && !surface(&first) && second.as_ref().is_some_and(surface);
    let (start, other) = match second {
        Some(second) if swapped => (second, Some(first)),
        _ => (first, second),
    };
    let mut solution = iterate(observations, &Damping::ADGN_BT, &start, trace)?;
    let (state, iterations) = (solution.state, solution.iterations);
    if redundancy == 0 {
        if !surface(&state) {
            return Err(Failure::Implausible { state, iterations });
        }
        if let Some(other) = other.filter(surface) {
            solution.alternatives.push(other);
            solution.ambiguity = Ambiguity::Several;
        }
        return Ok(solution);
    }
    let [_, limit] = believed_costs(observations, redundancy);
    if solution.cost >= limit {
        return Err(Failure::Inconsistent { state, cost: solution.cost, limit, iterations });
    }
    if observations.sigma_known() {
        solution.ambiguity = Ambiguity::None;
    }
    // Of satellites in one plane the other root is the mirror image, and explains all as well.
    if let Some(other) = other.filter(surface)
        && let Ok(second) = iterate(observations, &Damping::ADGN_BT, &other, |_| ())
    {
        solution.search_iterations = second.iterations;
        let elsewhere = (second.state.position_m - state.position_m).norm() > SAME_M;
        if elsewhere && second.cost < limit && surface(&second.state) {
            solution.alternatives.push(second.state);
            solution.ambiguity = Ambiguity::Several;
        }
    }
    Ok(solution)
}

fn roots<O: Observations, const N: usize>(
    observations: &O,
) -> Result<(State, Option<State>), Failure> {
    if observations.rows()[1] > 0 {
        return Err(Failure::PseudorangesOnly { solver: "bancroft" });
    }
    let system = System::<O, N>::new(observations)?;
    let failed = || system.diagnose(State::CENTRE, 0);
    let (p, q) = projections::<O, N>(observations).ok_or_else(failed)?;
    let product = |a: &Vector4<f64>, b: &Vector4<f64>| a.xyz().dot(&b.xyz()) - a.w * b.w;
    // Roots of a L^2 + 2 b L + c, in the form that loses no digits; noise can make a double root complex.
    let (a, b, c) = (product(&q, &q), product(&p, &q) - 1.0, product(&p, &p));
    let h = -(b + (b * b - a * c).max(0.0).sqrt().copysign(b));
    let place = |l: f64| {
        let y = p + l * q;
        let (mut seen, mut right) = (unseen::<N>(), [0.0; N]);
        system.see(&y.xyz(), &mut seen);
        let clocks = [y.w - system.offsets[0], 0.0];
        let cost = system.residuals(&seen, &clocks, &mut right);
        cost.is_finite().then(|| (cost, system.state(y.xyz(), clocks)))
    };
    match (place(c / h), place(h / a)) {
        (Some(x), Some(y)) if y.0 < x.0 => Ok((y.1, Some(x.1))),
        (Some(x), y) => Ok((x.1, y.map(|y| y.1))),
        (None, Some(y)) => Ok((y.1, None)),
        (None, None) => Err(failed()),
    }
}

/// `p` and `q` of the module's head: least squares, weighted, for `<a_i, a_i>/2` and for 1.
fn projections<O: Observations, const N: usize>(
    observations: &O,
) -> Option<(Vector4<f64>, Vector4<f64>)> {
    let n = observations.rows()[0];
    let mut rows = [[0.0; 6]; N];
    let mut squares = [0.0; 4];
    for (k, row) in rows[..n].iter_mut().enumerate() {
        let (s, range) = (observations.satellite(k).position_m, observations.observed(k));
        let weight = 1.0 / observations.sigma(k);
        let half = (s.norm_squared() - range * range) / 2.0;
        *row = [s.x, s.y, s.z, -range, half, 1.0].map(|v| v * weight);
        squares.iter_mut().zip(&*row).for_each(|(square, v)| *square += v * v);
    }
    let triangle = orthogonalise(&mut rows[..n], &squares)?;
    let solve = |column| Vector4::from(triangle.solve(triangle.right(column)));
    Some((solve(4), solve(5)))
}
