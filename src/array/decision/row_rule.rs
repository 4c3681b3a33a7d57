//! The row rule: number and angles of sources from the rows of a sparse estimate.
//!
//! The paper on JANE (IEEE TVT 72(5), 2023) takes the non-zero rows of X for the sources. An iterate has no
//! zero rows, so a row counts when the mean of its moduli exceeds a tenth of the largest row's, and four
//! times the noise of a row. Adjacent rows are one source, at the centroid of their powers.

use crate::array::CMat;
use crate::array::geometry::Point;

/// A row counts above this fraction of the largest.
const OF_THE_LARGEST: f64 = 0.1;
/// And above so many times the noise of a row.
const OF_THE_NOISE: f64 = 4.0;

/// Adjacent rows of an estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Centroid of the rows' powers.
    pub point: Point,
    /// Mean over the snapshots of the squared moduli, summed over the rows.
    pub power: f64,
    /// The rows.
    pub rows: Vec<usize>,
}

/// Noise of a row of the estimate: the standard deviation of the residual Y - A X (1.2 times its median
/// modulus, 1 / sqrt(ln 2), when it is a circular Gaussian) over the square root of the number of elements,
/// since noise averages over them.
pub fn row_noise(residual: &CMat) -> f64 {
    let mut moduli: Vec<f64> =
        residual.col_iter().flat_map(|c| c.iter()).map(|z| z.norm()).collect();
    if moduli.is_empty() {
        return 0.0;
    }
    let middle = moduli.len() / 2;
    let (_, median, _) = moduli.select_nth_unstable_by(middle, f64::total_cmp);
    *median / (std::f64::consts::LN_2 * residual.nrows() as f64).sqrt()
}

/// Sources in an estimate X, a row per point of `grid` and a column per snapshot, the strongest first.
///
/// `grid` is in rising order for a linear array (any steps), and for a plane a square grid of equal steps as
/// made by [`Manifold::grid`](crate::array::Manifold::grid), where rows at sides and corners are adjacent.
/// `noise` is [`row_noise`].
pub fn row_rule(estimate: &CMat, grid: &[Point], noise: f64) -> Vec<Group> {
    let columns = estimate.ncols().max(1) as f64;
    let mean = |l: usize| estimate.row(l).iter().map(|x| x.norm()).sum::<f64>() / columns;
    let means: Vec<f64> = (0..estimate.nrows()).map(mean).collect();
    let largest = means.iter().fold(0.0, |a: f64, b| a.max(*b));
    let threshold = (OF_THE_LARGEST * largest).max(OF_THE_NOISE * noise);
    let mut strong: Vec<usize> = (0..means.len()).filter(|&l| means[l] > threshold).collect();

    let touching = neighbourhood(grid);
    let mut groups = Vec::new();
    while let Some(first) = strong.pop() {
        let mut rows = vec![first];
        let mut at = 0;
        while at < rows.len() {
            let here = rows[at];
            let near;
            (near, strong) = strong.into_iter().partition(|&other| touching(here, other));
            rows.extend::<Vec<usize>>(near);
            at += 1;
        }
        rows.sort_unstable();
        groups.push(group(estimate, grid, rows, columns));
    }
    groups.sort_by(|a, b| b.power.total_cmp(&a.power));
    groups
}

fn group(estimate: &CMat, grid: &[Point], rows: Vec<usize>, columns: f64) -> Group {
    let (mut point, mut power) = ([0.0; 2], 0.0);
    for &row in &rows {
        let part = estimate.row(row).squared_norm_l2() / columns;
        power += part;
        point = [0, 1].map(|axis| point[axis] + part * grid[row][axis]);
    }
    Group { point: point.map(|c| c / power), power, rows }
}

/// Whether two rows are adjacent: successive ones on a line, neighbours at sides and corners in a plane.
fn neighbourhood(grid: &[Point]) -> impl Fn(usize, usize) -> bool {
    let plane = grid.iter().any(|p| p[1] != grid[0][1]);
    let gap = |a: &Point, b: &Point| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    let step = grid.windows(2).map(|pair| gap(&pair[0], &pair[1])).fold(f64::INFINITY, f64::min);
    move |a, b| if plane { gap(&grid[a], &grid[b]) < 1.5 * step } else { a.abs_diff(b) == 1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;

    fn estimate(rows: usize, filled: &[(usize, f64)]) -> CMat {
        CMat::from_fn(rows, 3, |l, n| {
            let at = filled.iter().find(|f| f.0 == l);
            at.map_or(Complex64::ZERO, |f| Complex64::from_polar(f.1, n as f64))
        })
    }

    #[test]
    fn adjacent_rows_are_one_source_at_the_centroid_of_power() {
        let grid: Vec<Point> = (0..10).map(|l| [0.1 * l as f64, 0.0]).collect();
        let x = estimate(10, &[(2, 1.0), (3, 3.0), (6, 2.0), (8, 0.25), (9, 0.35)]);
        let groups = row_rule(&x, &grid, 0.0);
        assert_eq!(groups.iter().map(|g| g.rows.len()).collect::<Vec<_>>(), [2, 1, 1]);
        // Powers 1 and 9: nine tenths of the way.
        assert!(
            (groups[0].point[0] - 0.29).abs() < 1e-12 && (groups[0].power - 10.0).abs() < 1e-12
        );
        // The row of 0.25 lies below a tenth of 3, that of 0.35 above; noise of 0.1 removes both.
        assert_eq!(groups[2].rows, [9]);
        assert_eq!(row_rule(&x, &grid, 0.1).len(), 2);
        assert_eq!(row_rule(&estimate(10, &[]), &grid, 0.0), []);
    }

    #[test]
    fn in_a_plane_rows_at_sides_and_corners_are_adjacent() {
        let grid: Vec<Point> = (0..25).map(|l| [(l / 5) as f64, (l % 5) as f64]).collect();
        // (1,1) and (2,2) are adjacent at a corner; (2,4) and (3,0) are successive rows of X far apart.
        let x = estimate(25, &[(6, 1.0), (12, 1.0), (14, 2.0), (15, 1.5)]);
        let groups = row_rule(&x, &grid, 0.0);
        assert_eq!(
            groups.iter().map(|g| g.rows.clone()).collect::<Vec<_>>(),
            [vec![14], vec![15], vec![6, 12]]
        );
        assert_eq!(groups[2].point, [1.5, 1.5]);
    }

    #[test]
    fn the_noise_of_a_row_is_that_of_the_mean_of_the_elements() {
        // The median modulus of unit noise is sqrt(ln 2).
        let median = std::f64::consts::LN_2.sqrt();
        let residual =
            CMat::from_fn(4, 5, |m, n| Complex64::from(median * (4 * n + m) as f64 / 10.0));
        assert!((row_noise(&residual) - 0.5).abs() < 1e-12);
    }
}
