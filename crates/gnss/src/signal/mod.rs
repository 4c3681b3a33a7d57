//! Signals by their interface specifications: data, and no behaviour beyond arithmetic.
//!
//! A signal is one `static` in one file, registered in [`ALL`]; a [`Transmission`] is a satellite and one of
//! its signals. All properties of a signal are here: no other module contains a chip rate, a code
//! length, a carrier or the length of a symbol.

mod beidou_b1c;
mod beidou_b1i;
mod ca_code;
#[cfg(test)]
mod code_vectors;
mod galileo_e1;
mod glonass_l1of;
mod gps_l1_ca;
mod gps_l1c;
mod modulation;
mod overlay;
mod packed_code;
mod qzss_l1_ca;
mod sbas_l1;
mod weil_code;

pub use beidou_b1c::{BEIDOU_B1C_DATA, BEIDOU_B1C_PILOT};
pub use beidou_b1i::BEIDOU_B1I;
pub use galileo_e1::{GALILEO_E1B, GALILEO_E1C};
pub use glonass_l1of::GLONASS_L1OF;
pub use gps_l1_ca::GPS_L1_CA;
pub use gps_l1c::{GPS_L1C_D, GPS_L1C_P};
pub use modulation::Modulation;
pub use overlay::Overlay;
pub use qzss_l1_ca::QZSS_L1_CA;
pub use sbas_l1::SBAS_L1;

use crate::constants::SPEED_OF_LIGHT;
use crate::message::MessageDecoder;
use crate::{Constellation, Sv};
use std::cmp::Ordering;
use std::hash::{Hash, Hasher};

/// Centre of the band L1 (E1, B1C), Hz: 154 times 10.23 MHz (IS-GPS-200N 3.3.1.1).
pub const L1_CENTRE_HZ: f64 = 1_575.42e6;
/// Wavelength at the centre of L1, m.
pub const L1_WAVELENGTH: f64 = SPEED_OF_LIGHT / L1_CENTRE_HZ;

/// All signals that are known; the first of a constellation is the default of its satellites: where data and pilot are
/// sent together and both are received, the pilot, on which code and carrier are tracked.
pub static ALL: [&Signal; 11] = [
    &GPS_L1_CA,
    &QZSS_L1_CA,
    &SBAS_L1,
    &GALILEO_E1C,
    &GALILEO_E1B,
    &BEIDOU_B1I,
    &BEIDOU_B1C_DATA,
    &BEIDOU_B1C_PILOT,
    &GLONASS_L1OF,
    &GPS_L1C_D,
    &GPS_L1C_P,
];

/// A signal, the same of all satellites that send it but for the code. Signals are distinguished by their names.
pub struct Signal {
    /// Name, unlike that of any other signal.
    pub name: &'static str,
    /// Band and attribute of its RINEX observation codes: `1C` of C1C, L1C, D1C, S1C (RINEX 3.04 table A2).
    pub rinex: &'static str,
    /// The system that sends it.
    pub constellation: Constellation,
    /// Carrier.
    pub carrier: Carrier,
    /// Chips a second.
    pub chip_rate_hz: f64,
    /// Chips in a period of the primary code.
    pub chips: usize,
    /// One period of the primary code of the satellite of this number as chips +1 (logical 0) and -1 (logical
    /// 1); none of a number that does not send the signal.
    pub code: fn(u8) -> Option<Box<[i8]>>,
    /// Subcarrier of the chips.
    pub modulation: Modulation,
    /// Secondary code.
    pub overlay: Overlay,
    /// Data symbols of the satellite of this number; none of a pilot.
    pub symbols: fn(u8) -> Option<Symbols>,
    /// The other component, where data and pilot are sent together.
    pub partner: Option<&'static Signal>,
    /// Fraction of the power of both components that is in this one.
    pub power_fraction: f64,
    /// Carrier phase of this component ahead of that of the data component, cycles: 0.5 is a minus sign.
    pub phase_cycles: f64,
}

/// Carrier of a signal.
#[derive(Clone, Copy, Debug)]
pub enum Carrier {
    /// The same of all satellites, Hz.
    Fixed(f64),
    /// By frequency channel.
    Fdma {
        /// Carrier of channel 0, Hz.
        centre_hz: f64,
        /// From channel to channel, Hz.
        step_hz: f64,
        /// Channel of the satellite of this number, where it is known.
        channel: fn(u8) -> Option<i8>,
    },
}

/// Data symbols of a signal.
#[derive(Clone, Copy, Debug)]
pub struct Symbols {
    /// Code periods in a symbol.
    pub periods: usize,
    /// A new decoder of the message, if it is one that is known here.
    pub decoder: Option<fn() -> Box<dyn MessageDecoder>>,
}

impl Signal {
    /// Whether samples at this rate see the chips of a code period change at few different places between them: `p`
    /// samples are `q` chips, `p` is below 40, and what they differ by adds up to less than half of that grid. Delays
    /// within a step of the grid then look alike to a replica of signs.
    pub fn is_commensurate(&self, rate_hz: f64) -> bool {
        const STEPS: u32 = 40;
        let samples_per_chip = rate_hz / self.chip_rate_hz;
        (1..=STEPS).map(f64::from).any(|q| {
            let p = (q * samples_per_chip).round();
            let swept = (samples_per_chip - p / q).abs() * self.chips as f64;
            p > 0.0 && p < f64::from(STEPS) && swept < 0.5 / q
        })
    }

    /// Period of the primary code, s.
    pub const fn period_s(&self) -> f64 {
        self.chips as f64 / self.chip_rate_hz
    }

    /// Correlation intervals in a code period, of equal length: one of codes up to 1 ms, else as many as the period has
    /// milliseconds, so that the carrier may be off by as much whatever the code.
    pub fn intervals(&self) -> usize {
        (self.period_s() * 1e3).round().max(1.0) as usize
    }

    /// Carrier of a satellite, Hz; of one whose frequency channel is not known that of channel 0.
    pub fn carrier_hz(&self, sv: Sv) -> f64 {
        match self.carrier {
            Carrier::Fixed(hz) => hz,
            Carrier::Fdma { centre_hz, step_hz, channel } => {
                centre_hz + f64::from(channel(sv.number()).unwrap_or(0)) * step_hz
            }
        }
    }

    /// Carrier of a satellite on this frequency channel, Hz; none where it has channels and this one is not known.
    pub fn carrier_on_channel_hz(&self, channel: Option<i8>) -> Option<f64> {
        match self.carrier {
            Carrier::Fixed(hz) => Some(hz),
            Carrier::Fdma { centre_hz, step_hz, .. } => {
                channel.map(|channel| centre_hz + f64::from(channel) * step_hz)
            }
        }
    }

    /// Wavelength of the carrier of a satellite, m.
    pub fn wavelength_m(&self, sv: Sv) -> f64 {
        SPEED_OF_LIGHT / self.carrier_hz(sv)
    }

    /// Carrier cycles of a satellite in one chip.
    pub fn cycles_per_chip(&self, sv: Sv) -> f64 {
        self.carrier_hz(sv) / self.chip_rate_hz
    }

    /// Code periods over which nothing but noise changes the sign: a symbol, or one period of a pilot.
    pub fn periods_per_symbol(&self, sv: Sv) -> usize {
        (self.symbols)(sv.number()).map_or(1, |symbols| symbols.periods)
    }
}

/// Its name: data and pilot refer to each other.
impl std::fmt::Debug for Signal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Signal({})", self.name)
    }
}

impl PartialEq for Signal {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Signal {}

impl PartialOrd for Signal {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Signal {
    fn cmp(&self, other: &Self) -> Ordering {
        self.name.cmp(other.name)
    }
}

impl Hash for Signal {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.name.hash(state);
    }
}

/// A signal of a satellite: what is acquired, tracked and observed. In the order of satellites, then of the
/// names of signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Transmission {
    /// The satellite.
    pub sv: Sv,
    /// The signal.
    pub signal: &'static Signal,
}

/// The default signal of a satellite.
pub fn of(sv: Sv) -> Transmission {
    let signal = ALL.into_iter().find(|signal| signal.constellation == sv.constellation());
    Transmission { sv, signal: signal.expect("each constellation has a signal") }
}

impl Transmission {
    /// One period of the code, [`Signal::chips`] chips of +1 and -1: zeros where the satellite does not send
    /// the signal.
    pub fn code(&self) -> Box<[i8]> {
        (self.signal.code)(self.sv.number()).unwrap_or_else(|| vec![0; self.signal.chips].into())
    }

    /// Carrier, Hz.
    pub fn carrier_hz(&self) -> f64 {
        self.signal.carrier_hz(self.sv)
    }

    /// Wavelength of the carrier, m.
    pub fn wavelength_m(&self) -> f64 {
        self.signal.wavelength_m(self.sv)
    }

    /// Carrier cycles in one chip.
    pub fn cycles_per_chip(&self) -> f64 {
        self.signal.cycles_per_chip(self.sv)
    }

    /// One period of the secondary code, a chip of +1 or -1 a period of the primary code, if there is one.
    pub fn overlay(&self) -> Option<Box<[i8]>> {
        self.signal.overlay.chips(self.sv.number())
    }

    /// The other component of the same satellite, where data and pilot are sent together.
    pub fn partner(&self) -> Option<Self> {
        self.signal.partner.map(|signal| Self { sv: self.sv, signal })
    }

    /// Whether it carries no data.
    pub fn is_pilot(&self) -> bool {
        (self.signal.symbols)(self.sv.number()).is_none()
    }

    /// A new decoder of its message, or of a pilot that of the data component beside it; none of a message that is not
    /// known here.
    pub fn decoder(&self) -> Option<Box<dyn MessageDecoder>> {
        let data = if self.is_pilot() { self.partner()? } else { *self };
        let decoder = (data.signal.symbols)(self.sv.number())?.decoder?;
        Some(decoder())
    }

    /// Correlation intervals and symbols as a receiver sums them.
    pub fn timing(&self) -> SymbolTiming {
        let (periods, intervals) =
            (self.signal.periods_per_symbol(self.sv), self.signal.intervals());
        SymbolTiming {
            interval_s: self.signal.period_s() / intervals as f64,
            cycle: periods * intervals,
            is_aligned: periods == 1,
        }
    }

    /// The code's clock at a Doppler of the carrier, Hz, where one oscillator drives mixer and sampler.
    pub fn clock(&self, doppler_hz: f64) -> CodeClock {
        self.clock_beside(doppler_hz, 0.0)
    }

    /// The same where the code runs faster by the fraction `code_offset` than the carrier says: that of a mixer that
    /// does not share the clock of the samples.
    pub fn clock_beside(&self, doppler_hz: f64, code_offset: f64) -> CodeClock {
        let Signal { chip_rate_hz, chips, .. } = self.signal;
        let chip_rate_hz = chip_rate_hz * (1.0 + doppler_hz / self.carrier_hz() + code_offset);
        CodeClock { chip_rate_hz, chips: *chips as f64 }
    }
}

/// How correlation intervals make up symbols.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SymbolTiming {
    /// Length of a correlation interval, s: a code period, or one of [`Signal::intervals`] parts of it.
    pub interval_s: f64,
    /// Intervals in a symbol; of a pilot, in a code period.
    pub cycle: usize,
    /// Whether each code period is a symbol (of a pilot, a chip of the secondary code), so that the code tells where
    /// symbols start.
    pub is_aligned: bool,
}

impl SymbolTiming {
    /// Intervals of a coherent sum of so many milliseconds: at least one, and at most one symbol.
    pub fn coherent_intervals(&self, coherent_ms: usize) -> usize {
        ((coherent_ms as f64 * 1e-3 / self.interval_s).round() as usize).clamp(1, self.cycle)
    }
}

/// A code as received: its rate follows the Doppler of the carrier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CodeClock {
    /// Chips a second.
    pub chip_rate_hz: f64,
    /// Chips of a period.
    pub chips: f64,
}

impl CodeClock {
    /// Length of a period in samples at `rate_hz`.
    pub fn period_samples(&self, rate_hz: f64) -> f64 {
        self.chips / self.chip_rate_hz * rate_hz
    }

    /// Seconds from where the code phase is `phase_chips` (0 to a period) to the start of the next period.
    pub fn seconds_to_start(&self, phase_chips: f64) -> f64 {
        (self.chips - phase_chips) % self.chips / self.chip_rate_hz
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_constellation_has_a_signal_and_names_are_unlike() {
        for constellation in Constellation::ALL {
            for sv in Sv::all(constellation) {
                let transmission = of(sv);
                assert_eq!(transmission.signal.constellation, constellation);
                assert!((transmission.signal.code)(sv.number()).is_some(), "{sv} has no code");
            }
        }
        for (k, signal) in ALL.iter().enumerate() {
            assert!(ALL[..k].iter().all(|s| s.name != signal.name), "{}", signal.name);
            assert!((signal.code)(0).is_none() && (signal.code)(255).is_none());
        }
        let stranger = Transmission { sv: Sv::all_gps().next().unwrap(), signal: &SBAS_L1 };
        assert!(stranger.code().iter().all(|&chip| chip == 0));
    }

    /// Definitions by the fundamental frequency of 10.23 MHz (IS-GPS-200N 3.3.1.1, 3.3.2.3).
    #[test]
    fn periods_and_cycles_of_the_l1_codes_are_exact() {
        let f0 = 10.23e6;
        assert_eq!(L1_CENTRE_HZ, 154.0 * f0);
        for signal in [&GPS_L1_CA, &QZSS_L1_CA, &SBAS_L1] {
            let sv = Sv::all(signal.constellation).next().unwrap();
            assert_eq!((signal.period_s(), signal.chip_rate_hz), (1e-3, f0 / 10.0));
            assert_eq!((signal.carrier_hz(sv), signal.cycles_per_chip(sv)), (154.0 * f0, 1540.0));
            assert_eq!(signal.wavelength_m(sv), L1_WAVELENGTH);
        }
        let cycle = |sv: &str| of(sv.parse().unwrap()).timing().cycle;
        assert_eq!((cycle("G01"), cycle("J01"), cycle("S20")), (20, 20, 2));
    }

    #[test]
    fn carriers_of_frequency_channels_are_steps_apart() {
        let channel = |number| [1, -4].get(usize::from(number)).copied();
        let carrier = Carrier::Fdma { centre_hz: 1602e6, step_hz: 562.5e3, channel };
        let signal = Signal { carrier, ..gps_l1_ca::SIGNAL };
        let sv = Sv::from_prn(1).unwrap();
        assert_eq!(signal.carrier_hz(sv), 1602e6 - 4.0 * 562.5e3);
        assert_eq!(signal.carrier_on_channel_hz(Some(6)), Some(1_605.375e6));
        assert_eq!(signal.carrier_on_channel_hz(None), None);
        assert_eq!(GPS_L1_CA.carrier_on_channel_hz(None), Some(L1_CENTRE_HZ));
    }

    #[test]
    fn a_code_runs_with_its_carrier() {
        let clock = of(Sv::from_prn(7).unwrap()).clock(1540.0);
        // One chip a second more at 1540 Hz.
        assert!((clock.chip_rate_hz - 1_023_001.0).abs() < 1e-6);
        assert!((clock.period_samples(2.0 * clock.chip_rate_hz) - 2046.0).abs() < 1e-9);
        assert_eq!(clock.seconds_to_start(0.0), 0.0);
        assert!((clock.seconds_to_start(1000.0) * clock.chip_rate_hz - 23.0).abs() < 1e-9);
    }
}
