//! JANE: number and angles of sources, false alarms, standard deviations.

use crate::common::{Failed, Tested};
use nalgebra::Vector3;
use num_complex::Complex64;
use sdr_rx::array::{
    CMat, Jane, JaneOptions, Manifold, Point, Source, SparseOptions, degree_grid, paper_dictionary,
    row_noise, row_rule, solve,
};
use sdr_rx::gnss::antenna::AntennaArray;
use sdr_rx::gnss::random::SplitMix64;
use sdr_rx_lab::Scene;
use sdr_rx_lab::detection::detect;

fn line(elements: usize) -> Manifold {
    Manifold::new(AntennaArray::half_wavelength(elements))
}

/// Angles in rising order, deg.
fn angles(sources: &[Source]) -> Vec<f64> {
    let mut angles: Vec<f64> = sources.iter().map(|s| s.point[0].asin().to_degrees()).collect();
    angles.sort_by(f64::total_cmp);
    angles
}

#[test]
fn jane_finds_the_reference_angles_with_and_without_a_start() -> Tested {
    let jane = Jane::new(&line(50), JaneOptions::default())?;
    // Of an independent implementation of the same maximum; two implementations of the likelihood's details
    // agree to a small part of the standard deviation, 0.0007 and 0.025 deg.
    let cases = [
        (Scene::default(), [28.0009, 29.9985, 40.0006, 52.0005], 0.002),
        (Scene { amplitude: 1.0, ..Scene::default() }, [28.042, 29.946, 40.023, 52.024], 0.01),
    ];
    for (scene, expected, tolerance) in cases {
        let y = scene.draw(1).y;
        let (grid, responses) = (degree_grid(25, 55), paper_dictionary(50));
        let estimate = solve(&responses, &y, &SparseOptions::default())?;
        let residual = &y - &responses * &estimate;
        let groups = row_rule(&estimate, &grid, row_noise(&residual));
        let start: Vec<Point> = groups.iter().map(|g| g.point).collect();
        for start in [&start[..], &[]] {
            let found = angles(&jane.decide(&y, start)?.sources);
            let near = |(a, b): (&f64, &f64)| (a - b).abs() < tolerance;
            let right = found.len() == 4 && found.iter().zip(&expected).all(near);
            assert!(right, "from {} candidates: {found:?}", start.len());
        }
    }
    Ok(())
}

#[test]
fn jane_finds_four_sources_down_to_minus_25_db_at_the_bound() -> Tested {
    // The root mean square of 100 errors has a standard deviation of 7 %; the maximum likelihood lies at the
    // bound from -5 dB up, and 30 % above it at -20 dB, where the signals are poorly estimated.
    for (snr, limit) in [(-25.0, f64::INFINITY), (-20.0, 1.5), (-5.0, 1.15), (20.0, 1.15)] {
        let outcome = detect(&Scene::default().with_snr(snr), 25, 1)?;
        assert!(outcome.right >= 0.95, "{snr} dB: {outcome:?}");
        assert!(outcome.error_deg <= limit * outcome.bound_deg, "{snr} dB: {outcome:?}");
        // Its standard deviation is that of its errors, to four standard deviations of the latter.
        let ratio = outcome.error_deg / outcome.sigma_deg;
        assert!((ratio - 1.0).abs() < 0.28, "{snr} dB: {outcome:?}");
    }
    Ok(())
}

#[test]
fn jane_finds_sources_with_few_elements() -> Tested {
    let paper = detect(&Scene { elements: 16, ..Scene::default() }, 25, 1)?;
    assert!(paper.right == 1.0 && paper.error_deg <= 0.016, "{paper:?}");
    let eight = Scene { elements: 8, angles_deg: vec![-35.0, 3.0, 45.0], ..Scene::default() };
    let eight = detect(&eight.with_snr(0.0), 40, 1)?;
    let four = Scene { elements: 4, angles_deg: vec![-25.0, 30.0], ..Scene::default() };
    let four = detect(&four.with_snr(0.0), 40, 1)?;
    // The distribution of the noise is estimated from 800 and 400 samples, half of the information in which is used
    // up by the signals.
    assert!(eight.right == 1.0 && eight.error_deg <= 1.5 * eight.bound_deg, "{eight:?}");
    assert!(four.right == 1.0 && four.error_deg <= 1.8 * four.bound_deg, "{four:?}");
    Ok(())
}

#[test]
fn noise_alone_has_the_given_false_alarm_probability() -> Tested {
    // A probability of one in fifty, to be tested by 2000 runs: binomial, mean 40, standard deviation 6.3. The
    // estimation of the noise's distribution makes alarms rarer rather than more frequent.
    for (elements, share) in [(4, 0.1), (8, 0.0), (16, 0.3)] {
        let jane = Jane::new(
            &line(elements),
            JaneOptions { false_alarm: 0.02, ..JaneOptions::default() },
        )?;
        let mut scene =
            Scene { elements, snapshots: 50, angles_deg: Vec::new(), ..Scene::default() };
        scene.noise.probability = share;
        let runs = 700;
        let alarm =
            |seed: u64| jane.decide(&scene.draw(seed).y, &[]).map(|d| !d.sources.is_empty());
        let mut alarms = 0;
        for seed in 0..runs {
            alarms += usize::from(alarm(seed)?);
        }
        // Mean 14, standard deviation 3.7: four of them more.
        assert!(alarms <= 29, "{elements} elements, {share}: {alarms} of {runs}");
    }
    Ok(())
}

/// Four by four elements, half a wavelength apart, and unit noise with a tenth of impulses.
#[test]
fn jane_finds_directions_of_a_plane_within_their_standard_deviations() -> Tested {
    let half = sdr_rx::gnss::signal::L1_WAVELENGTH / 2.0;
    let at = |k: usize| Vector3::new((k % 4) as f64 * half, (k / 4) as f64 * half, 0.0);
    let manifold = Manifold::new(AntennaArray::new((0..16).map(at).collect()));
    let jane = Jane::new(&manifold, JaneOptions::default())?;
    let truth = [[0.1, 0.2], [-0.5, 0.3], [0.4, -0.6]];
    let responses: Vec<_> = truth.iter().map(|p| manifold.response(*p)).collect();
    let (mut chi_square, runs) = (0.0, 20);
    for seed in 0..runs {
        let noise = Scene { elements: 16, angles_deg: Vec::new(), ..Scene::default() }.draw(seed).y;
        let mut rng = SplitMix64::new(1000 + seed);
        let signals = CMat::from_fn(3, 100, |_, _| rng.complex_normal() * 0.7);
        let y = CMat::from_fn(16, 100, |m, n| {
            let sum: Complex64 = (0..3).map(|q| responses[q][m] * signals[(q, n)]).sum();
            sum + noise[(m, n)]
        });
        let sources = jane.decide(&y, &[])?.sources;
        assert_eq!(sources.len(), 3, "run {seed}: {sources:?}");
        for p in truth {
            let apart = |s: &Source| (s.point[0] - p[0]).hypot(s.point[1] - p[1]);
            let nearest = sources.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
            let source = nearest.ok_or("a source")?;
            for axis in [0, 1] {
                chi_square += ((source.point[axis] - p[axis]) / source.sigma[axis]).powi(2);
            }
        }
    }
    // Chi-square of 120 degrees of freedom, standard deviation 15.5: four of them, and 10 % for the estimation of the
    // noise's distribution from 1600 samples.
    assert!((58.0..195.0).contains(&chi_square), "{chi_square}");
    Ok(())
}

/// A sample covariance of satellites at `cn0_dbhz` seen by a line, impulses mapped away; the sources' sines.
fn satellites(
    manifold: &Manifold,
    count: usize,
    samples: usize,
    cn0_dbhz: f64,
    seed: u64,
) -> (CMat, Vec<f64>) {
    let elements = manifold.elements();
    let mut rng = SplitMix64::new(seed);
    let sines = loop {
        let mut draw = || (120.0 * rng.uniform() - 60.0).to_radians().sin();
        let mut sines: Vec<f64> = (0..count).map(|_| draw()).collect();
        sines.sort_by(f64::total_cmp);
        if sines.windows(2).all(|pair| pair[1] - pair[0] > 2.5 / elements as f64) {
            break sines;
        }
    };
    let law = Scene::default().noise;
    let amplitude = 10f64.powf(cn0_dbhz / 20.0) / 2.048e6f64.sqrt();
    let responses: Vec<_> = sines.iter().map(|s| manifold.response([*s, 0.0])).collect();
    let mut sum = CMat::zeros(elements, elements);
    let mut y = vec![Complex64::ZERO; elements];
    for _ in 0..samples {
        let chips: Vec<f64> =
            (0..count).map(|_| if rng.uniform() < 0.5 { amplitude } else { -amplitude }).collect();
        for (m, y) in y.iter_mut().enumerate() {
            let impulse = rng.uniform() < law.probability;
            let variance = if impulse { law.impulse } else { law.background };
            let signal: Complex64 = responses.iter().zip(&chips).map(|(a, c)| a[m] * c).sum();
            let z = rng.complex_normal() * variance.sqrt() + signal;
            *y = z * law.inverse_variance(z.norm_sqr());
        }
        for (k, right) in y.iter().enumerate() {
            let column = sum.col_as_slice_mut(k);
            column.iter_mut().zip(&y).for_each(|(s, left)| *s += left * right.conj());
        }
    }
    (sum * faer::Scale(Complex64::from(1.0 / samples as f64)), sines)
}

#[test]
fn a_covariance_shows_satellites_far_below_the_noise() -> Tested {
    // Elements, satellites, samples (10 or 20 ms), runs, root mean square error of an independent
    // implementation (deg).
    for (elements, count, samples, runs, error_deg) in
        [(50, 8, 20_480, 2, 0.016), (16, 6, 40_960, 4, 0.10), (8, 4, 40_960, 8, 0.40)]
    {
        let manifold = line(elements);
        let jane = Jane::new(&manifold, JaneOptions::default())?;
        let (mut chi_square, mut square, mut angles) = (0.0, 0.0, 0.0);
        for seed in 0..runs {
            let (r, sines) = satellites(&manifold, count, samples, 45.0, seed);
            let mut sources = jane.decide_covariance(&r, samples as f64, None, &[])?.sources;
            sources.sort_by(|a, b| a.point[0].total_cmp(&b.point[0]));
            assert_eq!(sources.len(), count, "{elements} elements, run {seed}: {sources:?}");
            for (source, sine) in sources.iter().zip(sines) {
                chi_square += ((source.point[0] - sine) / source.sigma[0]).powi(2);
                square += (source.point[0].asin() - sine.asin()).to_degrees().powi(2);
                angles += 1.0;
            }
        }
        // Four standard deviations of a chi-square over its degrees of freedom, and half as much in its root.
        let spread = 4.0 * (2.0f64 / angles).sqrt();
        let ratio = chi_square / angles;
        assert!((1.0 - spread..1.0 + spread).contains(&ratio), "{elements} elements: {ratio}");
        let rms = f64::sqrt(square / angles);
        assert!(rms < error_deg * (1.0 + spread / 2.0), "{elements} elements: {rms} deg");
    }
    Ok(())
}

#[test]
fn a_known_error_of_the_elements_makes_no_sources() -> Tested {
    // One source 35 dB over the noise of an element; gains and phases wrong by 5 % and 0.05 rad: errors of
    // power 0.005 make apparent further sources 12 dB over the noise, unless they are modelled.
    let manifold = line(8);
    let mut rng = SplitMix64::new(5);
    let wrong: Vec<f64> = (0..16).map(|_| 0.05 * 2f64.sqrt() * rng.complex_normal().re).collect();
    let response = manifold.response([0.3, 0.0]);
    let noise = Scene { elements: 8, angles_deg: Vec::new(), ..Scene::default() }.draw(3).y;
    let signals: Vec<_> = (0..100).map(|_| rng.complex_normal() * 56.0).collect();
    let y = CMat::from_fn(8, 100, |m, n| {
        let gain = Complex64::from_polar(1.0 + wrong[m], wrong[m + 8]);
        response[m] * gain * signals[n] + noise[(m, n)]
    });
    let found = |mismatch: f64| -> Result<usize, Failed> {
        let jane = Jane::new(&manifold, JaneOptions { mismatch, ..JaneOptions::default() })?;
        Ok(jane.decide(&y, &[])?.sources.len())
    };
    assert!(found(0.0)? > 1);
    assert_eq!(found(0.005)?, 1);
    Ok(())
}
