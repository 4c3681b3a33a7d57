//! Cases in which AW-DGN-BT does not converge to the optimum, compared with variable projection with restarts: few
//! satellites, low orbits at their true speed, receivers above the ground.

use super::geometry::{Shell, observe, scaled_down};
use super::scale_down::{name, sigma};
use super::tally::{Tally, judge};
use nalgebra::Vector3;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use sdr_rx::gnss::constants::EARTH_RADIUS;
use sdr_rx::gnss::coordinates::Geodetic;
use sdr_rx::position::{RowKind, Satellite, Solver};
use sdr_rx::report::HeatMap;

/// The solvers that are compared.
const SOLVERS: [Solver; 2] = [Solver::AwDgnBt, Solver::Vp];
const NAMES: [&str; 2] = ["AW-DGN-BT", "VP, restarts"];
/// Satellites seen.
const COUNTS: [usize; 4] = [4, 5, 6, 8];
/// Heights of orbits brought down along the line of sight, km.
const SCALED_KM: [f64; 10] =
    [160.0, 300.0, 550.0, 1000.0, 1500.0, 2200.0, 4000.0, 8000.0, 14_000.0, 20_200.0];
/// Heights of shells with true speeds, km.
const SHELLS_KM: [f64; 9] = [340.0, 450.0, 550.0, 800.0, 1200.0, 2000.0, 4000.0, 8000.0, 20_200.0];
/// Heights of the receiver, km.
const USERS_KM: [f64; 12] =
    [0.0, 10.0, 20.0, 30.0, 40.0, 45.0, 50.0, 60.0, 100.0, 300.0, 500.0, 1000.0];
/// Elevation mask, rad.
const MASK: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// A random receiver and the satellites in view of it.
struct Draw {
    receiver_m: Vector3<f64>,
    satellites: Vec<Satellite>,
}

impl Draw {
    /// `count` satellites (all, if 0) of `shell` in view of a receiver at `height_m` anywhere between 55 deg
    /// south and north, at any time of a day; tries again where fewer are in view.
    fn new(rng: &mut ChaCha8Rng, shell: &Shell, count: usize, height_m: f64) -> Self {
        loop {
            let latitude = rng.random_range(-55f64.to_radians().sin()..55f64.to_radians().sin());
            let position = Geodetic {
                latitude: latitude.asin(),
                longitude: rng.random_range(-180f64..180.0).to_radians(),
                height: height_m,
            };
            let receiver_m = position.to_ecef();
            let in_view = shell.in_view(rng.random_range(0.0..86_400.0), &receiver_m, MASK);
            let all: Vec<Satellite> = in_view.into_iter().map(|(_, s)| s).collect();
            let wanted = if count == 0 { all.len() } else { count };
            if wanted >= 4 && all.len() >= wanted {
                return Self { receiver_m, satellites: all.sample(rng, wanted).copied().collect() };
            }
        }
    }

    fn judge(&self, rng: &mut ChaCha8Rng, kind: RowKind) -> Vec<Tally> {
        let errors: Vec<f64> = self.satellites.iter().map(|_| rng.sample(StandardNormal)).collect();
        let (satellites, sigma) = (self.satellites.iter().copied(), sigma(kind));
        let rows = observe(kind, satellites, &self.receiver_m, sigma, |k| errors[k]);
        judge(&SOLVERS, &rows, &self.receiver_m, sigma)
    }
}

/// Outcomes of both solvers over `runs` draws, each from a stream of random numbers of its own.
fn tally(
    runs: u64,
    draw: impl Fn(&mut ChaCha8Rng) -> Draw + Sync,
    observable: RowKind,
) -> [Tally; 2] {
    let one = |run: u64| {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        rng.set_stream(run);
        let tallies = draw(&mut rng).judge(&mut rng, observable);
        [tallies[0], tallies[1]]
    };
    let sum = |mut a: [Tally; 2], b: [Tally; 2]| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    (0..runs).into_par_iter().map(one).reduce(<[Tally; 2]>::default, sum)
}

/// Both solvers' outcomes under one label at each column.
struct Row {
    label: String,
    tallies: Vec<[Tally; 2]>,
}

/// The map of the fraction of runs whose solution, or one of its alternatives, is the optimum.
fn map(name: &str, title: &str, x_axis: &str, x: &[f64], rows: &[Row]) -> HeatMap {
    let line = |row: &Row, solver: usize| {
        let fraction = |t: &[Tally; 2]| {
            100.0 * (t[solver].right + t[solver].named) as f64 / t[solver].runs as f64
        };
        (format!("{}: {}", row.label, NAMES[solver]), row.tallies.iter().map(fraction).collect())
    };
    let (rows, values) = rows.iter().flat_map(|row| [line(row, 0), line(row, 1)]).unzip();
    HeatMap {
        name: name.into(),
        title: title.into(),
        x_axis: x_axis.into(),
        x: x.to_vec(),
        rows,
        value: "found, %".into(),
        range: [50.0, 100.0],
        values,
    }
}

/// The failure maps, and the outcomes of low shells by their satellites seen.
pub struct Failures {
    /// The maps.
    pub maps: Vec<HeatMap>,
    /// Of the shell at 550 km, for each of 4, 5, 6 and 8 satellites, both solvers' outcomes by Doppler.
    pub starlink: Vec<(usize, [Tally; 2])>,
    /// The same for the OneWeb-like shell at 1200 km.
    pub oneweb: Vec<(usize, [Tally; 2])>,
    /// Of a receiver in orbit at 300 and 500 km: outcomes by pseudorange and Doppler together.
    pub in_orbit: [Tally; 2],
}

/// Draws `runs` cases for each cell; `progress` is given the fraction that is done.
pub fn run(runs: u64, progress: &(dyn Fn(f64) + Sync)) -> Failures {
    let km = |h: f64| EARTH_RADIUS + 1e3 * h;
    let scaled = RowKind::ALL.iter().flat_map(|&observable| {
        COUNTS.map(|count| Row {
            label: format!("{} {count} sat.", name(observable)),
            tallies: SCALED_KM
                .map(|height| {
                    let draw = |rng: &mut ChaCha8Rng| {
                        let mut draw = Draw::new(rng, &Shell::GPS, count, 0.0);
                        for satellite in &mut draw.satellites {
                            *satellite = scaled_down(satellite, &draw.receiver_m, km(height));
                        }
                        draw
                    };
                    tally(runs, draw, observable)
                })
                .to_vec(),
        })
    });
    let scaled: Vec<Row> = scaled.collect();
    progress(0.4);
    let shells = COUNTS.map(|count| Row {
        label: format!("Doppler {count} sat."),
        tallies: SHELLS_KM
            .map(|height| {
                let shell = Shell { radius_m: km(height), ..Shell::STARLINK };
                tally(runs, |rng| Draw::new(rng, &shell, count, 0.0), RowKind::RangeRate)
            })
            .to_vec(),
    });
    progress(0.7);
    let at_user = |height: f64, observable| {
        tally(runs, |rng| Draw::new(rng, &Shell::GPS, 0, 1e3 * height), observable)
    };
    let users = RowKind::ALL.map(|observable| Row {
        label: name(observable).into(),
        tallies: USERS_KM.map(|height| at_user(height, observable)).to_vec(),
    });
    progress(0.9);
    let low = |shell: Shell| {
        COUNTS
            .map(|n| (n, tally(runs, |rng| Draw::new(rng, &shell, n, 0.0), RowKind::RangeRate)))
            .to_vec()
    };
    let mut in_orbit = [Tally::default(); 2];
    for row in &users {
        for (_, tallies) in
            USERS_KM.iter().zip(&row.tallies).filter(|(h, _)| [300.0, 500.0].contains(*h))
        {
            in_orbit.iter_mut().zip(tallies).for_each(|(sum, t)| *sum += *t);
        }
    }
    let maps = vec![
        map(
            "few_satellites",
            "Random satellites brought down along the line of sight",
            "orbit height / km",
            &SCALED_KM,
            &scaled,
        ),
        map(
            "low_shells",
            "Walker 1584/72/39 at true speed, Doppler",
            "orbit height / km",
            &SHELLS_KM,
            &shells,
        ),
        map(
            "high_receivers",
            "Receivers above the ground, GPS in its own orbits",
            "height of the receiver / km",
            &USERS_KM,
            &users,
        ),
    ];
    Failures { maps, starlink: low(Shell::STARLINK), oneweb: low(Shell::ONEWEB), in_orbit }
}
