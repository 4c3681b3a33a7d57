//! Signals for the array tests, made without the scenario generator: C/A codes from a linear array of half
//! a wavelength, in noise of background variance 1.

use num_complex::{Complex32, Complex64};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use sdr_rx::capture::Block;
use sdr_rx::gnss::Sv;
use sdr_rx::gnss::signal;
use std::f64::consts::{PI, TAU};

/// Sampling rate, Hz.
pub const RATE_HZ: f64 = 2.048e6;

/// Satellites, noise and jammer.
#[derive(Clone)]
pub struct Scene {
    pub elements: usize,
    pub ms: usize,
    pub satellites: usize,
    /// Against the background alone, dB-Hz.
    pub cn0_dbhz: f64,
    /// Probability of an impulse, and its variance.
    pub impulses: (f64, f32),
    /// Satellites lie within 60 degrees of broadside: each in its own of as many equal parts of sin(theta), in
    /// the middle fraction `scatter` of it (0 to 1); infinite: anywhere.
    pub scatter: f64,
    /// Sine of the direction, power over the background at each element in dB, and whether a carrier
    /// (else white noise).
    pub jammer: Option<(f64, f64, bool)>,
    pub seed: u64,
}

/// A simulated satellite.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    pub sv: Sv,
    pub doppler_hz: f64,
    pub code_phase_chips: f64,
    pub sine: f64,
    pub symbol_edge: i64,
    pub bits: u64,
}

impl Truth {
    /// Code (with data) at sample `n`, and its carrier.
    pub fn at(&self, chips: &[i8], n: usize) -> (f64, f64) {
        let t = n as f64 / RATE_HZ;
        let phase =
            self.code_phase_chips + t * signal::of(self.sv).clock(self.doppler_hz).chip_rate_hz;
        let bit = ((phase / 1023.0).floor() as i64 + self.symbol_edge) / 20;
        let sign = if self.bits >> (bit & 63) & 1 == 0 { 1.0 } else { -1.0 };
        (sign * f64::from(chips[phase as usize % 1023]), TAU * self.doppler_hz * t)
    }
}

/// exp(j pi m s) of each element.
pub fn response(elements: usize, sine: f64) -> Vec<Complex64> {
    (0..elements).map(|m| Complex64::cis(PI * sine * m as f64)).collect()
}

impl Scene {
    /// Eight satellites in (0.1, 1, 50) noise.
    pub fn new(elements: usize, ms: usize, cn0_dbhz: f64, seed: u64) -> Self {
        let impulses = (0.1, 50.0);
        Self {
            elements,
            ms,
            satellites: 8,
            cn0_dbhz,
            impulses,
            scatter: f64::INFINITY,
            jammer: None,
            seed,
        }
    }

    fn rng(&self, stream: u64) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(stream);
        rng
    }

    fn truth(&self) -> Vec<Truth> {
        let mut rng = self.rng(0);
        let mut found: Vec<Truth> = Vec::new();
        while found.len() < self.satellites {
            let new = Truth {
                sv: Sv::from_prn(rng.random_range(1..=32)).expect("a GPS satellite"),
                doppler_hz: rng.random_range(-5000.0..5000.0),
                code_phase_chips: rng.random_range(0.0..1023.0),
                sine: match self.scatter.is_finite() {
                    true => {
                        let part = 2.0 * (PI / 3.0).sin() / self.satellites as f64;
                        let offset = rng.random_range(-0.5..0.5) * self.scatter;
                        (found.len() as f64 + 0.5 + offset) * part - (PI / 3.0).sin()
                    }
                    false => rng.random_range(-PI / 3.0..PI / 3.0).sin(),
                },
                symbol_edge: rng.random_range(0..20),
                bits: rng.random(),
            };
            if found.iter().all(|t| t.sv != new.sv) {
                found.push(new);
            }
        }
        found
    }

    /// The samples of all elements.
    pub fn make(&self) -> (Block, Vec<Truth>) {
        let len = (self.ms as f64 * RATE_HZ * 1e-3) as usize;
        let truth = self.truth();
        let mut rng = self.rng(1);
        let mut block = Block::zeros(self.elements, len);
        let mut normal = |variance: f32| {
            let scale = (variance / 2.0).sqrt();
            let mut part = || scale * rng.sample::<f32, _>(StandardNormal);
            Complex32::new(part(), part())
        };
        let mut chance = self.rng(2);
        for channel in block.channels_mut() {
            for x in channel {
                let hit = chance.random::<f64>() < self.impulses.0;
                *x = normal(if hit { self.impulses.1 } else { 1.0 });
            }
        }
        let mut add = |wave: &[Complex32], sine: f64| {
            for (m, a) in response(self.elements, sine).into_iter().enumerate() {
                let a = Complex32::new(a.re as f32, a.im as f32);
                block.channel_mut(m).iter_mut().zip(wave).for_each(|(x, w)| *x += a * w);
            }
        };
        let amplitude = (10f64.powf(self.cn0_dbhz / 10.0) / RATE_HZ).sqrt();
        for t in &truth {
            let chips = signal::of(t.sv).code();
            let wave: Vec<Complex32> = (0..len)
                .map(|n| {
                    let (code, phase) = t.at(&chips, n);
                    let z = Complex64::cis(phase) * (amplitude * code);
                    Complex32::new(z.re as f32, z.im as f32)
                })
                .collect();
            add(&wave, t.sine);
        }
        if let Some((sine, db, carrier)) = self.jammer {
            let power = 10f32.powf(db as f32 / 10.0);
            let wave: Vec<Complex32> = (0..len)
                .map(|n| {
                    let turn = (0.123 * n as f64).fract();
                    let z = Complex64::cis(TAU * turn) * f64::from(power.sqrt());
                    if carrier { Complex32::new(z.re as f32, z.im as f32) } else { normal(power) }
                })
                .collect();
            add(&wave, sine);
        }
        (block, truth)
    }
}
