//! Speed of the sparse solvers on the paper's problem: 96 snapshots, 50 elements, 31 directions, one thread.

use criterion::{Criterion, criterion_group, criterion_main};
use sdr_rx::array::sparse::l1_admm::{self, AdmmPlan, AdmmSettings};
use sdr_rx::array::sparse::lda_l11::{self, LdaL11, LdaSettings};
use sdr_rx::array::sparse::{Penalty, SparseEstimate, nmse};
use sdr_rx::array::{CMat, paper_dictionary};
use sdr_rx_lab::Scene;
use std::hint::black_box;
use std::sync::OnceLock;
use std::time::Instant;

fn problem() -> (CMat, CMat, CMat) {
    let scene = Scene { snapshots: 96, ..Scene::default() };
    let drawn = scene.draw(1);
    let truth = scene.truth_on_degrees(&drawn, 25, 31);
    (paper_dictionary(50), drawn.y, truth)
}

/// Time that this thread has computed, ms: of the processor where the system gives it (Linux), else of the clock.
fn clock_ms() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    let elapsed = START.get_or_init(Instant::now).elapsed().as_secs_f64() * 1e3;
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let ns = text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok());
    ns.map_or(elapsed, |ns| ns * 1e-6)
}

/// Best of several means, ms: systems give a thread's time in steps of 4 ms.
fn best_ms(means: usize, mut run: impl FnMut()) -> f64 {
    let mut mean = |_| {
        let (start, mut runs) = (clock_ms(), 0);
        while runs == 0 || clock_ms() - start < 200.0 {
            run();
            runs += 1;
        }
        (clock_ms() - start) / f64::from(runs)
    };
    (0..means).map(&mut mean).fold(f64::INFINITY, f64::min)
}

/// Ratios that one run must show side by side.
fn ratios(_: &mut Criterion) {
    let (a, y, truth) = problem();
    let plan = AdmmPlan::new(&a).expect("a dictionary");
    let exact = AdmmSettings { gap: 1e-6, iterations: 20_000, ..AdmmSettings::default() };
    let optimum = l1_admm::solve_exactly(&a, &y, &exact).expect("a solution");
    // A fixed number of iterations, with the gap computed once at the end.
    let count = |iterations| AdmmSettings {
        gap: 0.0,
        iterations,
        stretch: iterations,
        ..AdmmSettings::default()
    };
    let solved = |iterations| plan.solve(&y, &count(iterations)).expect("a solution");
    let needed = |enough: &dyn Fn(&SparseEstimate) -> bool| {
        (10..1000).step_by(10).find(|k| enough(&solved(*k))).expect("it converges")
    };
    let settings = LdaSettings::default();
    let lda = || lda_l11::solve(&a, &y, &settings).expect("a solution");
    let lda_nmse = nmse(&lda(), &truth);
    let lda_ms = best_ms(3, || drop(black_box(lda())));
    println!(
        "\nLDA-l1,1, 10^4 iterations: {lda_ms:.1} ms, NMSE {lda_nmse:.2e} (optimum {:.2e})",
        nmse(&optimum.x, &truth)
    );
    let to_objective = needed(&|e| e.objective <= optimum.objective * 1.0001);
    let to_nmse = needed(&|e| nmse(&e.x, &truth) <= lda_nmse);
    for (what, k) in [("objective within 1e-4", to_objective), ("NMSE of LDA-l1,1", to_nmse)] {
        let ms = best_ms(5, || drop(black_box(solved(k))));
        println!("ADMM to {what}: {k} iterations, {ms:.2} ms, {:.0} times faster", lda_ms / ms);
    }
    let default = AdmmSettings::default();
    let by_gap = plan.solve(&y, &default).expect("a solution");
    let ms = best_ms(5, || drop(black_box(plan.solve(&y, &default))));
    println!(
        "ADMM as it stops by itself: {} iterations, {ms:.2} ms, objective {:.1e} above the optimum",
        by_gap.iterations,
        by_gap.objective / optimum.objective - 1.0
    );
    let rows = AdmmSettings { penalty: Penalty::Rows, gamma: 4800f64.sqrt(), ..default };
    let estimate = plan.solve(&y, &rows).expect("a solution");
    let ms = best_ms(5, || drop(black_box(plan.solve(&y, &rows))));
    println!(
        "rows: {} iterations, {ms:.2} ms, NMSE {:.2e}",
        estimate.iterations,
        nmse(&estimate.x, &truth)
    );
}

fn iterations(c: &mut Criterion) {
    let (a, y, _) = problem();
    let plan = AdmmPlan::new(&a).expect("a dictionary");
    let mut group = c.benchmark_group("100 iterations");
    group.sample_size(10);
    let admm = AdmmSettings { gap: 0.0, iterations: 100, stretch: 100, ..AdmmSettings::default() };
    let lda = LdaSettings { iterations: 100, ..LdaSettings::default() };
    group.bench_function("ADMM", |b| b.iter(|| plan.solve(&y, &admm)));
    group.bench_function("ADMM, plain, double precision", |b| {
        b.iter(|| l1_admm::solve_exactly(&a, &y, &admm))
    });
    group.bench_function("LDA-l1,1", |b| b.iter(|| lda_l11::solve(&a, &y, &lda)));
    group.bench_function("LDA-l1,1, plain, double precision", |b| {
        b.iter(|| {
            let mut plain = LdaL11::new(&a, &y, &lda).expect("a problem");
            (0..100).for_each(|_| plain.step());
            plain.x().clone()
        });
    });
    group.finish();
}

criterion_group!(benches, ratios, iterations);
criterion_main!(benches);
