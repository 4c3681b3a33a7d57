//! CVX-l1,1 and CVX-l2,1: the convex problems as second-order cone programs, solved by an interior-point
//! method (Clarabel instead of CVX).
//!
//! min gamma sum t_l + sum s_m with |row l of X| <= t_l and |row m of Y - A X| <= s_m: each row of X and of the
//! residual, its real and imaginary parts in one vector, lies in one second-order cone. Of a single snapshot
//! a row is one entry, so that l1,1 is this program for each snapshot by itself.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT::SecondOrderConeT,
};
use num_complex::Complex64;
use sdr_rx::array::CMat;
use sdr_rx::array::sparse::{SparseError, check, positive};

/// X that minimises gamma sum |X| + sum |Y - A X|, all moduli. Some 20 ms per snapshot of 50 x 31.
///
/// # Errors
/// When shapes do not fit, gamma is not above 0, or the program is not solved.
pub fn cvx_l11(a: &CMat, y: &CMat, gamma: f64) -> Result<CMat, SparseError> {
    check(a, y)?;
    let columns = (0..y.ncols()).map(|n| cvx_l21(a, &y.subcols(n, 1).to_owned(), gamma));
    let columns = columns.collect::<Result<Vec<_>, _>>()?;
    Ok(CMat::from_fn(a.ncols(), y.ncols(), |l, n| columns[n][(l, 0)]))
}

/// X that minimises gamma times the sum of the norms of the rows of X plus that of the rows of Y - A X.
///
/// # Errors
/// As [`cvx_l11`].
pub fn cvx_l21(a: &CMat, y: &CMat, gamma: f64) -> Result<CMat, SparseError> {
    check(a, y)?;
    positive("gamma", gamma)?;
    let (m, l, n) = (a.nrows(), a.ncols(), y.ncols());
    // Variables: parts of X, snapshot by snapshot (Re, Im of each row in turn); then t; then s.
    let part = |row: usize, column: usize, imaginary: usize| 2 * (column * l + row) + imaginary;
    let bounds = 2 * l * n;
    let variables = bounds + l + m;
    let cost: Vec<f64> = (0..variables)
        .map(|v| f64::from(v >= bounds) * if v < bounds + l { gamma } else { 1.0 })
        .collect();
    // Clarabel's form: b - G v in the product of cones.
    let (mut rows, mut columns, mut values, mut b) = (vec![], vec![], vec![], vec![]);
    let mut entry = |row: usize, column: usize, value: f64| {
        rows.push(row);
        columns.push(column);
        values.push(value);
    };
    for group in 0..l + m {
        entry(b.len(), bounds + group, -1.0);
        b.push(0.0);
        for snapshot in 0..n {
            for imaginary in 0..2 {
                if group < l {
                    entry(b.len(), part(group, snapshot, imaginary), -1.0);
                    b.push(0.0);
                    continue;
                }
                let at = |z: Complex64| [z.re, z.im][imaginary];
                for row in 0..l {
                    let z = a[(group - l, row)];
                    entry(b.len(), part(row, snapshot, 0), at(z));
                    entry(b.len(), part(row, snapshot, 1), at(z * Complex64::I));
                }
                b.push(at(y[(group - l, snapshot)]));
            }
        }
    }
    let constraints = CscMatrix::new_from_triplets(b.len(), variables, rows, columns, values);
    let quadratic = CscMatrix::zeros((variables, variables));
    let cones = vec![SecondOrderConeT(1 + 2 * n); l + m];
    let settings = DefaultSettings { verbose: false, max_threads: 1, ..DefaultSettings::default() };
    let failed = SparseError::NoConvergence { doing: "second-order cone program" };
    let Ok(mut solver) = DefaultSolver::new(&quadratic, &cost, &constraints, &b, &cones, settings)
    else {
        return Err(failed);
    };
    solver.solve();
    match solver.solution.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => {}
        _ => return Err(failed),
    }
    let x = &solver.solution.x;
    Ok(CMat::from_fn(l, n, |row, column| {
        Complex64::new(x[part(row, column, 0)], x[part(row, column, 1)])
    }))
}
