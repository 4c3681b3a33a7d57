//! Figure 5: LDA-l1,1 and the methods that the paper compares it with, error against iterations.

use super::{LdaL11Effort, Problem, mean};
use crate::baselines::{cvx_l11, cvx_l21, dg_l21, efrs, lrma_svt};
use crate::claim::Claim;
use crate::{Findings, Scene};
use rayon::prelude::*;
use sdr_rx::array::CMat;
use sdr_rx::array::sparse::l1_admm::{AdmmPlan, AdmmSettings};
use sdr_rx::array::sparse::lda_l11::{self, LdaSettings};
use sdr_rx::array::sparse::{Penalty, SparseError, nmse};
use sdr_rx::report::{Curve, LinePlot};
use std::sync::atomic::{AtomicUsize, Ordering};

const GAMMA: f64 = 5.0;
/// Iterations after which errors are taken.
const MARKS: [usize; 13] = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000];

/// A method: its name, the most iterations that make sense, and X after so many.
struct Method {
    name: &'static str,
    most: usize,
    solve: fn(&Problem, usize) -> Result<CMat, SparseError>,
}

const METHODS: [Method; 8] = [
    Method {
        name: "LDA-l1,1",
        most: 10_000,
        solve: |p, iterations| {
            lda_l11::solve(&p.a, &p.y, &LdaSettings { iterations, ..LdaSettings::default() })
        },
    },
    Method { name: "CVX-l1,1", most: 1, solve: |p, _| cvx_l11(&p.a, &p.y, GAMMA) },
    Method { name: "CVX-l2,1", most: 1, solve: |p, _| cvx_l21(&p.a, &p.y, GAMMA) },
    Method { name: "EFRS", most: 200, solve: |p, k| efrs(&p.a, &p.y, GAMMA, k) },
    Method { name: "LRMA-SVT", most: 100, solve: |p, k| lrma_svt(&p.a, &p.y, 600.0, k) },
    Method { name: "DG-l2,1", most: 2000, solve: |p, k| dg_l21(&p.a, &p.y, GAMMA, 0.1, k) },
    Method { name: "ADMM l1,1", most: 500, solve: |p, k| admm(p, k, GAMMA, Penalty::L11) },
    Method {
        name: "ADMM rows",
        most: 500,
        solve: |p, k| {
            let gamma = ((p.y.nrows() * p.y.ncols()) as f64).sqrt();
            admm(p, k, gamma, Penalty::Rows)
        },
    },
];

fn admm(p: &Problem, iterations: usize, gamma: f64, penalty: Penalty) -> Result<CMat, SparseError> {
    let settings = AdmmSettings { gamma, penalty, gap: 0.0, iterations, ..AdmmSettings::default() };
    Ok(AdmmPlan::new(&p.a)?.solve(&p.y, &settings)?.x)
}

/// Errors of X and of A X of one method after each mark, and the objective of l2,1 at the last.
struct Errors {
    name: &'static str,
    x: Vec<(f64, f64)>,
    ax: Vec<(f64, f64)>,
    l21: f64,
}

/// gamma times the sum of the norms of the rows of X plus that of the rows of Y - A X.
fn l21(p: &Problem, x: &CMat) -> f64 {
    let rows = |matrix: &CMat| matrix.row_iter().map(|row| row.norm_l2()).sum::<f64>();
    GAMMA * rows(x) + rows(&(&p.y - &p.a * x))
}

impl Errors {
    fn last(&self) -> [f64; 2] {
        [&self.x, &self.ax].map(|curve| curve.last().map_or(f64::NAN, |p| p.1))
    }
}

/// The figure, for X and for A X, and its claims.
pub fn run(effort: LdaL11Effort, progress: &(dyn Fn(f64) + Sync)) -> Result<Findings, SparseError> {
    let scene = Scene::default();
    let problems: Vec<Problem> =
        (1..=effort.seeds).map(|seed| Problem::new(&scene, seed)).collect();
    let marks = |method: &Method| MARKS.iter().filter(|k| **k <= method.most).count();
    let total = METHODS.iter().map(marks).sum::<usize>() * problems.len();
    let done = AtomicUsize::new(0);
    let advance = || progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / total as f64);
    // The conic programs are the longest: each method's marks are tasks of their own.
    let errors = |method: &Method| -> Result<Errors, SparseError> {
        let at = |iterations: usize| {
            let pairs = problems.par_iter().map(|p| {
                let x = (method.solve)(p, iterations)?;
                advance();
                Ok([nmse(&x, &p.truth), nmse(&(&p.a * &x), &(&p.a * &p.truth)), l21(p, &x)])
            });
            let all = pairs.collect::<Result<Vec<[f64; 3]>, SparseError>>()?;
            let of = |which: usize| mean(&all.iter().map(|e| e[which]).collect::<Vec<_>>());
            Ok((iterations as f64, [of(0), of(1), of(2)]))
        };
        let marks: Vec<usize> = MARKS.into_iter().filter(|k| *k <= method.most).collect();
        let points = marks.par_iter().map(|k| at(*k)).collect::<Result<Vec<_>, SparseError>>()?;
        let mut curves =
            [0, 1].map(|which| points.iter().map(|(k, e)| (*k, e[which])).collect::<Vec<_>>());
        if method.most == 1 {
            // Without iterations: a constant level.
            curves.iter_mut().for_each(|c| c.push((10_000.0, c[0].1)));
        }
        let [x, ax] = curves;
        let l21 = points.last().map_or(f64::NAN, |p| p.1[2]);
        Ok(Errors { name: method.name, x, ax, l21 })
    };
    let errors = METHODS.par_iter().map(errors).collect::<Result<Vec<_>, _>>()?;
    let plot = |name: &str, what: &str, curve: fn(&Errors) -> &Vec<(f64, f64)>| LinePlot {
        name: name.into(),
        title: format!("Fig. 5: error of {what} after so many iterations"),
        axes: ["iterations".into(), format!("NMSE of {what}")],
        log: [true, true],
        curves: errors
            .iter()
            .map(|e| Curve { name: e.name.into(), points: curve(e).clone() })
            .collect(),
    };
    let plots = vec![plot("fig5_x", "X", |e| &e.x), plot("fig5_ax", "A X", |e| &e.ax)];
    Ok(Findings { plots, claims: claims(&errors), ..Findings::default() })
}

fn claims(errors: &[Errors]) -> Vec<Claim> {
    let of =
        |name: &str| errors.iter().find(|e| e.name == name).map_or([f64::NAN; 2], Errors::last);
    let [lda, l11, l21, efrs, svt, dg, admm, rows] = [
        "LDA-l1,1",
        "CVX-l1,1",
        "CVX-l2,1",
        "EFRS",
        "LRMA-SVT",
        "DG-l2,1",
        "ADMM l1,1",
        "ADMM rows",
    ]
    .map(of);
    let objective = |name: &str| errors.iter().find(|e| e.name == name).map_or(f64::NAN, |e| e.l21);
    let (efrs_objective, l21_objective) = (objective("EFRS"), objective("CVX-l2,1"));
    let claim = |claim: &str, paper: &str, ours: [f64; 2], sign: &str, holds: bool| Claim {
        place: "Fig. 5",
        claim: claim.into(),
        paper: paper.into(),
        ours: format!("{:.1e} {sign} {:.1e}", ours[0], ours[1]),
        holds,
    };
    let near = |a: f64, b: f64, relative: f64| (a / b - 1.0).abs() < relative;
    vec![
        claim("NMSE of LDA-l1,1", "1.4e-3", [lda[0], 1.4e-3], "for", near(lda[0], 1.4e-3, 0.3)),
        claim(
            "LDA-l1,1 ends where CVX-l1,1 does (X)",
            "equal",
            [lda[0], l11[0]],
            "and",
            near(lda[0], l11[0], 0.3),
        ),
        claim("l1,1 is better than l2,1 (X)", "<", [l11[0], l21[0]], "<", l11[0] < l21[0]),
        claim("l1,1 is better than l2,1 (A X)", "<", [l11[1], l21[1]], "<", l11[1] < l21[1]),
        claim(
            "EFRS is as good as LRMA-SVT (X)",
            "=",
            [efrs[0], svt[0]],
            "=",
            near(efrs[0], svt[0], 0.3),
        ),
        Claim {
            ours: format!("objectives {:.2} and {:.2}", efrs_objective, l21_objective),
            ..claim(
                "EFRS is another optimum than CVX-l2,1",
                "differ",
                [efrs[0], l21[0]],
                "and",
                !near(efrs_objective, l21_objective, 1e-4),
            )
        },
        claim(
            "DG-l2,1 is far behind after 2000 iterations",
            ">",
            [dg[0], l21[0]],
            ">",
            dg[0] > 10.0 * l21[0],
        ),
        Claim {
            place: "ours",
            ..claim(
                "ADMM reaches CVX-l1,1 (X)",
                "",
                [admm[0], l11[0]],
                "=",
                near(admm[0], l11[0], 0.05),
            )
        },
        Claim {
            place: "ours",
            ..claim(
                "rows beat every method of the paper (X)",
                "",
                [rows[0], l21[0]],
                "<",
                rows[0] < l21[0],
            )
        },
    ]
}
