//! Code discriminator.

use num_complex::Complex64;

/// Normalised early minus late envelope, chips: the delay of the signal against the replica, exact for an
/// autocorrelation that falls by `slope` a chip (1 of BPSK, 3 of BOC(1,1)) and |result| < `distance`, for early and late
/// `distance` chips from prompt (Kaplan & Hegarty, 3rd ed., table 8.5, of a triangle).
pub fn lateness_chips(early: Complex64, late: Complex64, distance: f64, slope: f64) -> f64 {
    let (early, late) = (early.norm(), late.norm());
    let sum = early + late;
    // Early 1 - s (d + x), late 1 - s (d - x) for a signal x chips later than prompt.
    if sum > 0.0 { (1.0 / slope - distance) * (late - early) / sum } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_discriminator_is_exact_on_ideal_correlations() {
        for (slope, distance) in [(1.0, 0.25), (3.0, 1.0 / 6.0)] {
            for x in (-9..=9).map(|k| f64::from(k) * 0.015) {
                let tap = |shift: f64| Complex64::from(1.0 - slope * (shift * distance - x).abs());
                let found = lateness_chips(tap(-1.0), tap(1.0), distance, slope);
                assert!((found - x).abs() < 1e-12, "{found} {x}");
            }
        }
    }
}
