//! Time of one AW-DGN-BT solve from the Earth's centre, and of its linear system beside nalgebra's QR.
//!
//! Counted work of a solve with m satellites: 7 linearisations and about 8 evaluations of the cost,
//! each of m square roots; 7 systems of m rows by 4 unknowns, 20 m multiplications each. No allocation.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::{DMatrix, DVector, Vector3, Vector4};
use sdr_rx::positioning::aw_dgn_bt::aw_dgn_bt;
use sdr_rx::positioning::least_squares::LeastSquares;
use sdr_rx::positioning::model::{Doppler, ObservationModel, Pseudorange, Satellite};
use std::hint::black_box;

/// Walker 24/3/1 at 56 deg and 29 600 km (Galileo-like), Earth-fixed, `t` s after it was aligned.
fn walker(t: f64) -> Vec<Satellite> {
    const RADIUS: f64 = 29.6e6;
    const EARTH_RATE: f64 = 7.292_115e-5;
    let rate = (3.986_004_418e14 / RADIUS.powi(3)).sqrt();
    let (sin_i, cos_i) = 56f64.to_radians().sin_cos();
    (0..24)
        .map(|k| {
            let (plane, slot) = (f64::from(k / 8), f64::from(k % 8));
            let (sin_u, cos_u) = ((45.0 * slot + 15.0 * plane).to_radians() + rate * t).sin_cos();
            let (sin_o, cos_o) = ((120.0 * plane).to_radians() - EARTH_RATE * t).sin_cos();
            let turn = |x: f64, y: f64| {
                let (y, z) = (y * cos_i, y * sin_i);
                Vector3::new(x * cos_o - y * sin_o, x * sin_o + y * cos_o, z)
            };
            let position_m = turn(RADIUS * cos_u, RADIUS * sin_u);
            let inertial = turn(-RADIUS * rate * sin_u, RADIUS * rate * cos_u);
            let earth = Vector3::new(0.0, 0.0, EARTH_RATE);
            Satellite { position_m, velocity_mps: inertial - earth.cross(&position_m) }
        })
        .collect()
}

/// Satellites above 5 deg of elevation at Turin every 10 minutes of 10 hours, with exact observations.
fn epochs<M: ObservationModel>() -> Vec<(Vec<Satellite>, Vec<f64>)> {
    let truth = Vector3::new(4_472_425.9, 601_429.2, 4_492_704.2);
    let in_view = |s: &Satellite| {
        (s.position_m - truth).normalize().dot(&truth.normalize()) > 5f64.to_radians().sin()
    };
    (0..60)
        .map(|k| {
            let view: Vec<Satellite> =
                walker(600.0 * f64::from(k)).into_iter().filter(in_view).collect();
            let observed = view.iter().map(|s| M::predict(s, &truth) + 100.0).collect();
            (view, observed)
        })
        .collect()
}

fn solve<M: ObservationModel>(c: &mut Criterion, name: &str) {
    let epochs = epochs::<M>();
    let mut next = epochs.iter().cycle();
    c.bench_function(&format!("aw-dgn-bt/{name}"), |b| {
        b.iter_batched(
            || next.next().expect("a cycle"),
            |(satellites, observed)| black_box(aw_dgn_bt::<M>(satellites, observed)),
            BatchSize::SmallInput,
        );
    });
}

fn linear_system(c: &mut Criterion) {
    let rows: Vec<(Vector4<f64>, f64)> = epochs::<Pseudorange>()[0]
        .0
        .iter()
        .map(|s| ((-s.position_m.normalize()).push(1.0), s.position_m.x))
        .collect();
    let mut system = LeastSquares::<4>::default();
    c.bench_function("linear system/ours", |b| {
        b.iter(|| {
            black_box(&rows).iter().for_each(|(row, right)| system.push(row, *right));
            system.solve().map(|s| s.x)
        });
    });
    c.bench_function("linear system/nalgebra QR", |b| {
        b.iter(|| {
            let rows = black_box(&rows);
            let j = DMatrix::from_fn(rows.len(), 4, |i, k| rows[i].0[k]);
            let e = DVector::from_fn(rows.len(), |i, _| rows[i].1);
            let qr = j.qr();
            qr.r().solve_upper_triangular(&(qr.q().transpose() * e))
        });
    });
}

fn all(c: &mut Criterion) {
    solve::<Pseudorange>(c, "pseudorange");
    solve::<Doppler>(c, "doppler");
    linear_system(c);
}

criterion_group!(benches, all);
criterion_main!(benches);
