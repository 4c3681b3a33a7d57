//! Signals by their code periods: simulated C/A codes in (0.1, 1, 50) noise, after the locally optimum map.

use crate::common::{Failed, Tested};
use crate::scene::{RATE_HZ, Scene, Truth};
use rayon::prelude::*;
use sdr_rx::array::code_periods::{CodePeriodLook, CodePeriodOptions, search_code_periods};
use sdr_rx::capture::{Block, StreamInfo};
use sdr_rx::front_end::{ImpulseSuppressor, Suppression};

#[test]
fn code_periods_of_noise_alone_give_nothing_in_60_runs() -> Tested {
    noise_alone(60)
}

#[test]
#[ignore = "long"]
fn code_periods_of_noise_alone_give_nothing_in_500_runs() -> Tested {
    noise_alone(500)
}

/// The samples after the locally optimum map.
pub fn mapped(mut block: Block) -> Block {
    let info = StreamInfo {
        rate_hz: RATE_HZ,
        if_hz: 0.0,
        channels: block.channels(),
        real: false,
        samples: None,
        start_time: None,
        format: String::new(),
        array: None,
    };
    ImpulseSuppressor::new(Suppression::Optimal, &info).process(&mut block);
    block
}

/// The search of a scene.
pub fn look(scene: &Scene) -> (CodePeriodLook, Vec<Truth>) {
    let (block, truth) = scene.make();
    let block = mapped(block);
    let channels: Vec<_> = (0..block.channels()).map(|m| block.channel(m)).collect();
    let options = CodePeriodOptions::new(scene.elements, scene.ms);
    let look = search_code_periods(&channels, RATE_HZ, 0, &options).expect("a search");
    (look, truth)
}

/// Satellites found at their code phase and Doppler, and false ones.
fn score(look: &CodePeriodLook, truth: &[Truth]) -> (usize, usize) {
    let right = look.found.iter().filter(|f| {
        truth.iter().any(|t| {
            let chips = f.acquisition.code_phase_chips - t.code_phase_chips;
            let chips = (chips + 511.5).rem_euclid(1023.0) - 511.5;
            let doppler = f.acquisition.doppler_hz - t.doppler_hz;
            // A quarter of a chip is half a bin. The Doppler comes from the prompts of 20 ms and more: some
            // hertz, or that of the next likely bit pattern, half the inverse of a data bit away.
            f.acquisition.sv() == t.sv && chips.abs() < 0.25 && doppler.abs() < 30.0
        })
    });
    let right = right.count();
    (right, look.found.len() - right)
}

fn all_eight(scene: Scene, seeds: u64) -> Result<Vec<CodePeriodLook>, Failed> {
    let looks: Vec<_> =
        (0..seeds).into_par_iter().map(|seed| look(&Scene { seed, ..scene.clone() })).collect();
    for (seed, (look, truth)) in looks.iter().enumerate() {
        let (right, wrong) = score(look, truth);
        if (right, wrong) != (8, 0) {
            let found: Vec<_> = look.found.iter().map(|f| (f.acquisition, f.fraction)).collect();
            return Err(format!(
                "seed {seed}: {right} right, {wrong} wrong: {found:#.2?} of {truth:#.1?}"
            )
            .into());
        }
    }
    Ok(looks.into_iter().map(|l| l.0).collect())
}

#[test]
fn eight_elements_and_20_ms_at_42_dbhz_show_a_rank_of_8_and_8_satellites() -> Tested {
    // Satellites of one direction whose Dopplers are equal modulo 1 kHz have a common eigenvalue; these lie 0.15 and
    // more apart in sine, of which a beam is 0.25.
    for look in all_eight(Scene { scatter: 0.3, ..Scene::new(8, 20, 42.0, 0) }, 6)? {
        let rank = look.svd.division.rank;
        // A power ratio of 8 x 20 x 10^4.2 / 2.048e6 x 0.865 = 1.07 makes an eigenvalue of 2.2 against an
        // edge of 1.67 times the noise floor.
        if rank != 8 {
            return Err(format!("rank {rank}: {:?}", &look.svd.eigenvalues[..10]).into());
        }
        few_transforms(&look)?;
        for found in &look.found {
            // 42 dB-Hz less 0.63 dB by the map, and up to 0.6 dB in the bins (half a chip wide).
            let cn0 = found.acquisition.cn0_dbhz;
            if !(40.3..42.2).contains(&cn0) {
                return Err(format!("{} at {cn0} dB-Hz", found.acquisition.sv()).into());
            }
        }
    }
    Ok(())
}

#[test]
fn four_elements_and_20_ms_or_one_and_100_ms_show_all_8_satellites() -> Tested {
    for scene in [Scene::new(4, 20, 42.0, 10), Scene::new(1, 100, 42.0, 20)] {
        for look in all_eight(scene, 4)? {
            few_transforms(&look)?;
        }
    }
    Ok(())
}

/// At most a fifth of the full search's.
fn few_transforms(look: &CodePeriodLook) -> Tested {
    let (ours, full) = (look.transforms, look.full_search_transforms);
    if 5 * ours <= full { Ok(()) } else { Err(format!("{ours} transforms of {full}").into()) }
}

fn noise_alone(runs: u64) -> Tested {
    let alarms: Vec<_> = (0..runs)
        .into_par_iter()
        .map(|seed| {
            let elements = [1, 2, 4, 8][seed as usize % 4];
            let scene = Scene { satellites: 0, ..Scene::new(elements, 20, 0.0, seed) };
            let look = look(&scene).0;
            (look.svd.division.rank, look.found.len())
        })
        .filter(|&alarm| alarm != (0, 0))
        .collect();
    // 3.5e-5 a run: one in fifty tests of 500 runs may fail.
    if alarms.is_empty() { Ok(()) } else { Err(format!("{alarms:?} in {runs} runs").into()) }
}

/// Prints the mean number of satellites found and the mean rank over C/N0.
#[test]
#[ignore = "long"]
fn sensitivity_of_the_code_periods() -> Tested {
    for (elements, ms) in [(8, 20), (4, 20), (1, 100), (1, 20), (16, 20)] {
        for cn0 in [42.0, 50.0, 35.0, 37.0, 39.0] {
            let runs = 6;
            let start = std::time::Instant::now();
            let results: Vec<_> = (0..runs)
                .map(|seed| {
                    let (look, truth) = look(&Scene::new(elements, ms, cn0, seed));
                    let (right, wrong) = score(&look, &truth);
                    (
                        right,
                        wrong,
                        look.svd.division.rank,
                        look.transforms,
                        look.full_search_transforms,
                    )
                })
                .collect();
            let mean = |f: fn(&(usize, usize, usize, usize, usize)) -> usize| {
                results.iter().map(|r| f(r) as f64).sum::<f64>() / f64::from(runs as u32)
            };
            println!(
                "M {elements:2} {ms:3} ms {cn0} dB-Hz: found {:.2} false {:.2} rank {:.2} transforms {:.0} of {:.0}  {:.2} s each",
                mean(|r| r.0),
                mean(|r| r.1),
                mean(|r| r.2),
                mean(|r| r.3),
                mean(|r| r.4),
                start.elapsed().as_secs_f64() / runs as f64
            );
        }
    }
    Ok(())
}
