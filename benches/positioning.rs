//! Time of one solve without prior knowledge, by each solver, compared with AW-DGN-BT by nalgebra's
//! dynamic matrices and QR. RTKLIB's solver cannot be timed alone (its Debian package has only
//! programs that read files), so it is not here.
//!
//! Counted work of an AW-DGN-BT solve with m satellites: 7 linearisations and about 8 evaluations of the
//! cost, each of m square roots and divisions; 7 systems of m rows, 32 m multiplications each. The variable
//! projection takes 4 linearisations, 3 of them with second derivatives. No allocation.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::{DMatrix, DVector, Vector3, Vector4};
use sdr_rx::position::{Row, RowKind, Satellite, Solver};
use std::hint::black_box;

/// Bound on the radius, m.
const WALL: f64 = 6.421e6;

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
fn epochs(kind: RowKind) -> Vec<Vec<Row>> {
    let truth = Vector3::new(4_472_425.9, 601_429.2, 4_492_704.2);
    let in_view = |s: &Satellite| {
        (s.position_m - truth).normalize().dot(&truth.normalize()) > 5f64.to_radians().sin()
    };
    (0..60)
        .map(|k| {
            let view = walker(600.0 * f64::from(k)).into_iter().filter(in_view);
            let row = |s: Satellite| Row::new(kind, s, kind.see(&s, &truth).value + 100.0);
            view.map(|s| row(s).with_sigma(1.0)).collect()
        })
        .collect()
}

/// AW-DGN-BT as one writes it down, with dynamic matrices.
fn plain(rows: &[Row]) -> Option<Vector4<f64>> {
    let n = rows.len();
    let see = |row: &Row, x: &Vector4<f64>| row.kind.see(&row.satellite, &x.xyz());
    let residuals =
        |x: &Vector4<f64>| DVector::from_fn(n, |i, _| rows[i].value - see(&rows[i], x).value - x.w);
    let mut x = Vector4::zeros();
    for _ in 0..100 {
        let e = residuals(&x);
        let mut jacobian = DMatrix::from_element(n, 4, 1.0);
        for (i, row) in rows.iter().enumerate() {
            let gradient = row.kind.gradient(&row.satellite, &see(row, &x));
            jacobian.fixed_view_mut::<1, 3>(i, 0).tr_copy_from(&gradient);
        }
        let qr = jacobian.qr();
        let dx = qr.r().solve_upper_triangular(&(qr.q().transpose() * &e))?;
        let dx = Vector4::new(dx[0], dx[1], dx[2], dx[3]);
        let mut mu = 1.0;
        let allowed = |x: &Vector4<f64>| {
            x.xyz().norm() < WALL
                && residuals(x).norm_squared() <= (1.0 + 1e-8) * e.norm_squared() + 1e-13
        };
        while !allowed(&(x + mu * dx)) {
            mu /= 2.0;
            if mu < 1e-6 {
                return None;
            }
        }
        x += mu * dx;
        if mu * dx.norm() < 1e-5 {
            return Some(x);
        }
    }
    None
}

fn solve(c: &mut Criterion, kind: RowKind, name: &str, solvers: &[Solver]) {
    let epochs = epochs(kind);
    for solver in solvers {
        let mut next = epochs.iter().cycle();
        c.bench_function(&format!("{solver}/{name}"), |b| {
            b.iter_batched(
                || next.next().expect("a cycle"),
                |rows| black_box(solver.solve(rows, |_| ())),
                BatchSize::SmallInput,
            );
        });
    }
    let mut next = epochs.iter().cycle();
    c.bench_function(&format!("aw-dgn-bt, nalgebra's plain way/{name}"), |b| {
        b.iter_batched(
            || next.next().expect("a cycle"),
            |rows| black_box(plain(rows)),
            BatchSize::SmallInput,
        );
    });
}

fn all(c: &mut Criterion) {
    let [aw, vp, bancroft] = [Solver::AwDgnBt, Solver::Vp, Solver::Bancroft];
    solve(c, RowKind::Range, "pseudorange", &[aw, vp, bancroft, Solver::Best]);
    solve(c, RowKind::RangeRate, "doppler", &[aw, vp, Solver::Best]);
}

criterion_group!(benches, all);
criterion_main!(benches);
