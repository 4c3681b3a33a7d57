//! Dictionaries of arrays with mirror symmetry, in real numbers.
//!
//! Where elements m and M-1-m lie opposite each other about a centre (lines, rectangles), the responses referred to
//! that centre are conjugate in mirrored rows. So A = Q B D with Q unitary (`lanes::unfold`: two additions a
//! row), B real, and D diagonal, of phases (Lee 1980; Haardt and Nossek 1995). |D X| = |X|, so that sparse
//! problems in A and X are such problems in B and D X, at half the cost.

use crate::array::CMat;
use nalgebra::DMatrix;
use num_complex::Complex64;
use std::f64::consts::SQRT_2;

/// Maximum deviation of responses from conjugate, relative to the largest: negligible in single precision.
const TOLERANCE: f64 = 1e-7;

/// B and the diagonal of D of a dictionary A (elements x directions); `None` where it has no such form.
pub fn real_form(a: &CMat) -> Option<(DMatrix<f64>, Vec<Complex64>)> {
    let (elements, directions) = (a.nrows(), a.ncols());
    let last = elements.checked_sub(1)?;
    let phase = |l: usize| {
        let square = a[(0, l)] * a[(last, l)];
        (square / square.norm()).sqrt()
    };
    let phases: Vec<Complex64> = (0..directions).map(phase).collect();
    let centred = |m: usize, l: usize| a[(m, l)] * phases[l].conj();
    let largest = a.norm_max();
    let is_conjugate = |m: usize, l: usize| {
        (centred(last - m, l) - centred(m, l).conj()).norm() < TOLERANCE * largest
    };
    let is_mirrored = (0..directions).all(|l| (0..=last / 2).all(|m| is_conjugate(m, l)));
    let real = |m: usize, l: usize| match m.cmp(&(last - m)) {
        std::cmp::Ordering::Less => SQRT_2 * centred(m, l).re,
        std::cmp::Ordering::Equal => centred(m, l).re,
        std::cmp::Ordering::Greater => SQRT_2 * centred(last - m, l).im,
    };
    let b = is_mirrored.then(|| DMatrix::from_fn(elements, directions, real))?;
    Some((b, phases))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::{Manifold, dictionary, paper_dictionary};
    use crate::gnss::antenna::ArrayDescription;

    #[test]
    fn lines_and_rectangles_have_the_real_form_and_circles_do_not() {
        let of = |array: &str| {
            let manifold = Manifold::new(ArrayDescription::parse(array).unwrap().in_enu());
            dictionary(&manifold, &manifold.grid(12))
        };
        for a in [paper_dictionary(50), of("ula:7"), of("ura:3x2")] {
            let (b, phases) = real_form(&a).unwrap();
            let (last, half) = (a.nrows() - 1, 0.5f64.sqrt());
            for (l, phase) in phases.iter().enumerate() {
                for m in 0..=last {
                    // Row m of Q B.
                    let folded = match m.cmp(&(last - m)) {
                        std::cmp::Ordering::Less => {
                            Complex64::new(b[(m, l)], b[(last - m, l)]) * half
                        }
                        std::cmp::Ordering::Equal => b[(m, l)].into(),
                        std::cmp::Ordering::Greater => {
                            Complex64::new(b[(last - m, l)], -b[(m, l)]) * half
                        }
                    };
                    assert!((folded * phase - a[(m, l)]).norm() < TOLERANCE);
                }
            }
        }
        assert!(real_form(&of("uca:5:0.5")).is_none());
    }
}
