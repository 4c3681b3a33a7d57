//! Position by variable projection: clocks eliminated, curved steps, and restarts until the residuals
//! prove the place.
//!
//! The clock terms enter linearly, so that for each place `r` the best ones are known: centring the
//! rows (taking out their weighted mean) leaves a problem in `r` alone (Golub and Pereyra 1973).
//!
//! ```text
//! r <- psi * unit(sum of the satellites' unit vectors)
//! repeat: e <- centre(y - h),  A <- centre(dh/dr)
//!         D <- A+ e,  a <- -A+ centre(h''(D, D)) / 2;  a <- 0 unless |2 a| < 0.75 |D|
//!         mu <- 1;  loop: rn <- r + mu D + mu^2 a;  if |rn| > wall: rn <- wall * unit(rn)
//!                         accept if Phi(rn) <= (1 + tau) Phi(r) + floor, else mu <- mu/2
//! until mu |D| < eps (the step before its projection), or it promises less than rounding
//! ```
//!
//! `a` is the geodesic acceleration of Transtrum and Sethna (2012). Where Gauss-Newton's iterate would
//! press against the altitude wall and jam, the projection keeps the tangential part of the step.
//!
//! What converges is believed when it lies between 100 km below and 50 km above the mean radius, and
//! its cost is below 25 times the redundancy (5 deviations); below 2.5 deviations at once, between the
//! two after four more starts. Starts, until one is believed: the centroid; the centroid after two
//! Gauss-Newton steps on the sphere; the cheapest place on the rings; the centroid without wall, which may
//! lead to a place in orbit if redundant observations prove it; then six places on each of three rings
//! around the centroid, at 0.2, 0.6 and 0.07 rad. With no redundancy every place fits: the sphere comes
//! first, and all starts are used to look for other solutions, which are reported.

use super::failure::Failure;
use super::plausibility::{SAME_M, WALL_M, above_the_ground, believed_costs, near_the_surface};
use super::point_solution::{Ambiguity, Damped, Iteration, PointSolution};
use crate::least_squares::{Buffer, LeastSquares};
use crate::place::Place;
use crate::point::Point;
use crate::problem::{Problem, Row, Satellite, Seen};
use nalgebra::{Matrix3, Matrix3x2, Vector3};
use sdr_rx_gnss::constants::EARTH_RADIUS;

const EPS: f64 = 1e-5;
const TAU: f64 = 1e-8;
const ETA: f64 = 1e-6;
const K_MAX: usize = 100;
/// Above this many metres the second-order term is worth its cost: below, it is under a micrometre.
const CURVED_M: f64 = 1.0;
/// Iterates at the wall, one after the other, that mean a jam.
const MAX_PROJECTED: usize = 8;
/// A cost above the lowest by less than this (three deviations) is as good.
const AS_GOOD: f64 = 9.0;
/// Starts still to try after one that is believed, but not at once.
const MORE_STARTS: usize = 4;
/// Starts around the centroid: this many on each ring, at these angles from it, rad.
const RING: usize = 6;
const RINGS: [f64; 3] = [0.2, 0.6, 0.07];

/// Most other places that a solution carries.
const MAX_ALTERNATIVES: usize = 3;

/// Solves from below the satellites' centroid, with `restarts` until the residuals prove the place, or
/// without. `trace` sees each accepted step.
///
/// # Errors
/// [`Failure::Inconsistent`] if the best place does not explain the observations to their standard
/// deviations, [`Failure::Implausible`] if it is not near the Earth's surface and nothing proves it, or how
/// the last start failed.
pub fn variable_projection(
    rows: &[Row],
    restarts: bool,
    trace: impl FnMut(&Iteration),
) -> Result<PointSolution, Failure> {
    let problem = Problem::new(rows)?;
    let redundancy = problem.redundancy();
    let [early, believed] = believed_costs(&problem);
    let mut search = Search {
        centroid: centroid(rows.iter().map(|row| &row.satellite)),
        problem: &problem,
        trace,
        views: Default::default(),
        iterations: 0,
        starts: 0,
    };
    let mut minima: Vec<Minimum> = Vec::new();
    let mut failure = None;
    let mut left = usize::MAX;
    for start in starts(redundancy, restarts) {
        match search.start(start) {
            Ok(minimum) if minimum.plausible(start, redundancy) => {
                let cost = minimum.cost;
                add(&mut minima, minimum, redundancy > 0);
                if redundancy > 0 && cost < early {
                    break;
                }
                if redundancy > 0 && cost < believed {
                    left = left.min(MORE_STARTS + 1);
                }
            }
            Ok(Minimum { state, iterations, .. }) => {
                failure.get_or_insert(Failure::Implausible { state, iterations });
            }
            Err(cause) => {
                failure.get_or_insert(cause);
            }
        }
        left -= 1;
        if left == 0 {
            break;
        }
    }
    let Some(Minimum { state, cost, covariance, mut iterations, restarts: spent }) =
        minima.first().cloned()
    else {
        // At least one start was made, and none led to a place.
        return Err(failure.unwrap_or(Failure::Coplanar));
    };
    if redundancy > 0 {
        iterations = search.iterations;
    }
    if cost >= believed {
        return Err(Failure::Inconsistent { state, cost, limit: believed, iterations });
    }
    if let Some(mirrored) = problem.mirrored(&state.position_m).filter(|_| restarts) {
        let start = Start::Place(mirrored);
        if let Some(second) = search.start(start).ok().filter(|m| m.plausible(start, redundancy)) {
            add(&mut minima, second, false);
        }
    }
    let fits = |other: &Minimum| other.cost < believed.min(cost + AS_GOOD);
    let alternatives: Vec<Place> =
        minima.drain(..).skip(1).filter(fits).map(|m| m.state).take(MAX_ALTERNATIVES).collect();
    let ambiguity = if !alternatives.is_empty() {
        Ambiguity::Several
    } else if redundancy == 0 || !problem.sigma_known {
        Ambiguity::Unverified
    } else {
        Ambiguity::None
    };
    Ok(PointSolution {
        state,
        cost,
        covariance,
        iterations,
        search_iterations: search.iterations - iterations,
        restarts: spent,
        alternatives,
        ambiguity,
    })
}

/// Where a start begins.
#[derive(Clone, Copy)]
enum Start {
    Centroid,
    Sphere,
    CheapestOfRings,
    CentroidWithoutWall,
    Ring(usize),
    /// A given place, within the wall.
    Place(Vector3<f64>),
}

/// The starts in their order.
fn starts(redundancy: usize, restarts: bool) -> impl Iterator<Item = Start> {
    let first =
        [Start::Centroid, Start::Sphere, Start::CheapestOfRings, Start::CentroidWithoutWall];
    let rings = (0..RINGS.len() * RING).map(Start::Ring);
    first.into_iter().chain(rings).filter(move |start| match start {
        Start::Centroid => redundancy > 0 || !restarts,
        _ => restarts,
    })
}

/// A converged start.
#[derive(Clone)]
struct Minimum {
    state: Place,
    cost: f64,
    covariance: Matrix3<f64>,
    /// Linearisations up to it.
    iterations: usize,
    /// Starts before its own.
    restarts: usize,
}

impl Minimum {
    /// Whether a place can be believed by its height: without wall, only the residuals bound it above.
    fn plausible(&self, start: Start, redundancy: usize) -> bool {
        match start {
            Start::CentroidWithoutWall if redundancy > 0 => {
                above_the_ground(&self.state.position_m)
            }
            _ => near_the_surface(&self.state.position_m),
        }
    }
}

/// Adds a minimum to the different ones, of which the first is the solution: the first found, or the cheapest.
fn add(minima: &mut Vec<Minimum>, minimum: Minimum, by_cost: bool) {
    let apart = |m: &Minimum| (m.state.position_m - minimum.state.position_m).norm();
    if let Some(same) = minima.iter_mut().find(|m| apart(m) <= SAME_M) {
        if minimum.cost < same.cost {
            (same.state, same.cost) = (minimum.state, minimum.cost);
        }
    } else if minima.len() <= MAX_ALTERNATIVES {
        minima.push(minimum);
    }
    if by_cost {
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    }
}

struct Search<'a, F> {
    problem: &'a Problem<'a>,
    trace: F,
    centroid: Vector3<f64>,
    /// Of the place reached, and of the next: predictions, and rows whose residuals are centred.
    views: [(Buffer<Seen>, LeastSquares<3, 4>); 2],
    iterations: usize,
    starts: usize,
}

/// Unit vector to the mean direction of the satellites; the north pole's if they lie all around.
fn centroid<'a>(satellites: impl Iterator<Item = &'a Satellite>) -> Vector3<f64> {
    let sum: Vector3<f64> = satellites.map(|s| s.position_m / s.position_m.norm()).sum();
    sum.try_normalize(1e-6).unwrap_or(Vector3::z())
}

/// Two unit vectors orthogonal to a unit vector and to each other.
fn tangents(up: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let axis = Vector3::ith(up.iamin(), 1.0);
    let east = axis.cross(up).normalize();
    [east, up.cross(&east)]
}

impl<F: FnMut(&Iteration)> Search<'_, F> {
    fn start(&mut self, start: Start) -> Result<Minimum, Failure> {
        self.starts += 1;
        let wall = EARTH_RADIUS + WALL_M;
        let below_centroid = EARTH_RADIUS * self.centroid;
        match start {
            Start::Centroid => self.descend(below_centroid, wall),
            Start::CentroidWithoutWall => self.descend(below_centroid, f64::INFINITY),
            Start::Place(place) => self.descend(place, wall),
            Start::Ring(k) => self.descend(self.on_ring(k), wall),
            Start::Sphere => {
                let place = self.on_sphere(below_centroid)?;
                self.descend(place, wall)
            }
            Start::CheapestOfRings => {
                let mut cheapest = (f64::INFINITY, below_centroid);
                for k in 0..RINGS.len() * RING {
                    let place = self.on_ring(k);
                    let mut at = Point { x: place, ..self.problem.zero() };
                    let cost = self.problem.look_centred(&mut at, &mut self.views[0]);
                    if cost < cheapest.0 {
                        cheapest = (cost, place);
                    }
                }
                self.descend(cheapest.1, wall)
            }
        }
    }

    /// Place `k` of those around the centroid, on the mean sphere.
    fn on_ring(&self, k: usize) -> Vector3<f64> {
        let (angle, turn) = (RINGS[k / RING], (k % RING) as f64);
        let azimuth = turn * std::f64::consts::TAU / RING as f64;
        let [east, north] = tangents(&self.centroid);
        let aside = east * azimuth.sin() + north * azimuth.cos();
        EARTH_RADIUS * (self.centroid * angle.cos() + aside * angle.sin())
    }

    /// Two Gauss-Newton steps on the mean sphere, in the two tangential unknowns.
    fn on_sphere(&mut self, place: Vector3<f64>) -> Result<Vector3<f64>, Failure> {
        let view = &mut self.views[0];
        let mut at = Point { x: place, ..self.problem.zero() };
        for _ in 0..2 {
            self.iterations += 1;
            self.problem.look_centred(&mut at, view);
            if view.1.factor(at.clocks.len()).is_none() {
                return Err(self.problem.diagnose(&at, self.iterations));
            }
            let basis = Matrix3x2::from_columns(&tangents(&at.x.normalize()));
            let step = view.1.solve_within(&basis);
            at.x = EARTH_RADIUS * (at.x + step).normalize();
        }
        Ok(at.x)
    }

    /// The iteration of the module's head.
    fn descend(&mut self, start: Vector3<f64>, wall_m: f64) -> Result<Minimum, Failure> {
        let problem = self.problem;
        let [here, there] = &mut self.views;
        let (mut here, mut there) = (here, there);
        let mut at = Point { x: start, ..problem.zero() };
        let mut next = at.clone();
        let mut phi = problem.look_centred(&mut at, here);
        let mut at_wall = 0;
        for _ in 0..K_MAX {
            self.iterations += 1;
            let iterations = self.iterations;
            let (seen, system) = &mut *here;
            let d = system.factor(at.clocks.len()).map(|()| system.minimiser(3));
            let Some(d) = d.filter(|d| d.iter().all(|v| v.is_finite())) else {
                return Err(problem.diagnose(&at, iterations));
            };
            let (length, promise) = (d.norm(), system.promise());
            let mut a = Vector3::zeros();
            if length > CURVED_M {
                let bend = -system.solve_again(&mut problem.curvatures(seen, &d));
                if bend.norm() < 0.75 * length {
                    a = 0.5 * bend;
                }
            }
            let (mut mu, mut halvings) = (1.0, 0);
            let (projected, phi_next) = loop {
                next.x = at.x + mu * d + mu * mu * a;
                let radius = next.x.norm();
                let projected = radius > wall_m;
                if projected {
                    next.x *= wall_m / radius;
                }
                let phi_next = problem.look_centred(&mut next, there);
                if phi_next <= (1.0 + TAU) * phi + problem.floor {
                    break (projected, phi_next);
                }
                mu /= 2.0;
                halvings += 1;
                if mu < ETA {
                    let state = problem.state(&at);
                    return Err(Failure::Jammed { state, iterations, wall: projected });
                }
            };
            let moved = (next.x - at.x).norm();
            std::mem::swap(&mut here, &mut there);
            std::mem::swap(&mut at, &mut next);
            (self.trace)(&Iteration {
                start: self.starts - 1,
                mu,
                length: moved,
                objective_before: phi,
                objective_after: phi_next,
                state: problem.state(&at),
                damped: match projected {
                    true => Damped::Projected(halvings),
                    false => Damped::by(1.0, 0, halvings),
                },
            });
            phi = phi_next;
            if mu * length < EPS || promise < problem.rounding {
                if let Some(row) = problem.coincident(&at.x) {
                    return Err(Failure::Coincident { row });
                }
                return Ok(Minimum {
                    state: problem.state(&at),
                    cost: phi,
                    covariance: there.1.covariance(),
                    iterations,
                    restarts: self.starts - 1,
                });
            }
            at_wall = if projected { at_wall + 1 } else { 0 };
            if at_wall == MAX_PROJECTED || projected && moved < EPS {
                return Err(Failure::Jammed { state: problem.state(&at), iterations, wall: true });
            }
        }
        Err(Failure::TooSlow { state: problem.state(&at), iterations: self.iterations })
    }
}
