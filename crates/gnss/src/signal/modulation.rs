//! Subcarriers: what is multiplied on the chips of a code.

/// Subcarrier of a signal. A subcarrier changes its sign at the start of each chip as sgn(sin) does: the first half
/// period is positive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Modulation {
    /// None: binary phase-shift keying by the code alone.
    Bpsk,
    /// sin-BOC of a subcarrier of `ratio` times the chip rate.
    Boc {
        /// Subcarrier over chip rate.
        ratio: u8,
    },
    /// CBOC(6, 1, 1/11) of Galileo E1: BOC(1,1) of 10/11 of the power and BOC(6,1) of 1/11, added in the data
    /// component and subtracted in the pilot (Galileo OS SIS ICD 2.3.3).
    Cboc {
        /// Whether it is that of the pilot.
        pilot: bool,
    },
    /// TMBOC(6, 1, 4/33) of the pilot of GPS L1C: BOC(6,1) in 4 chips of 33, else BOC(1,1) (IS-GPS-800G).
    Tmboc,
    /// QMBOC(6, 1, 4/33) of the pilot of BeiDou B1C: BOC(1,1) of 29/33 of the power, and in quadrature to it BOC(6,1),
    /// which is left out here (BDS-SIS-ICD-B1C-1.0 4.2).
    Qmboc,
}

/// Chips of each 33 that are BOC(6,1) in TMBOC (IS-GPS-800G).
const TMBOC_FAST_CHIPS: [usize; 4] = [0, 4, 6, 29];

impl Modulation {
    /// Equal pieces of a chip within which the amplitude is constant.
    pub const fn pieces(self) -> usize {
        match self {
            Self::Bpsk => 1,
            Self::Boc { ratio } => 2 * ratio as usize,
            Self::Qmboc => 2,
            Self::Cboc { .. } | Self::Tmboc => 12,
        }
    }

    /// Amplitude in one of the [`pieces`](Self::pieces) of the chip of this number in the code, to be multiplied by
    /// the chip. Its mean square is 1 (29/33 of QMBOC).
    pub fn amplitude(self, chip: usize, piece: usize) -> f64 {
        let boc = |periods: usize| {
            let halves = piece * 2 * periods / self.pieces();
            if halves.is_multiple_of(2) { 1.0 } else { -1.0 }
        };
        match self {
            Self::Bpsk => 1.0,
            Self::Boc { ratio } => boc(ratio.into()),
            Self::Cboc { pilot } => {
                let fast = if pilot { -boc(6) } else { boc(6) };
                (10f64.sqrt() * boc(1) + fast) / 11f64.sqrt()
            }
            Self::Tmboc if TMBOC_FAST_CHIPS.contains(&(chip % 33)) => boc(6),
            Self::Tmboc => boc(1),
            Self::Qmboc => (29f64 / 33.0).sqrt() * boc(1),
        }
    }

    /// What a receiver whose band does not hold the lobes of BOC(6,1), at 6 to 7 MHz either side, correlates with:
    /// the subcarrier without them.
    pub const fn narrowband(self) -> Self {
        match self {
            Self::Bpsk | Self::Boc { .. } => self,
            Self::Cboc { .. } | Self::Tmboc | Self::Qmboc => Self::Boc { ratio: 1 },
        }
    }

    /// Power of the signal in the [`narrowband`](Self::narrowband) subcarrier, as a part of all.
    pub fn narrowband_power(self) -> f64 {
        match self {
            Self::Bpsk | Self::Boc { .. } => 1.0,
            Self::Cboc { .. } => 10.0 / 11.0,
            Self::Tmboc | Self::Qmboc => 29.0 / 33.0,
        }
    }

    /// Decrease of the autocorrelation by a chip of delay, near its peak, of the [`narrowband`](Self::narrowband)
    /// subcarrier: 1 of BPSK, 3 of BOC(1,1).
    pub fn slope(self) -> f64 {
        match self.narrowband() {
            Self::Boc { ratio } => 4.0 * f64::from(ratio) - 1.0,
            _ => 1.0,
        }
    }

    /// One code period as a receiver correlates with it, in equal pieces of chips: how many there are in a chip, and
    /// their signs.
    pub fn replica(self, code: &[i8]) -> (usize, Vec<i8>) {
        let subcarrier = self.narrowband();
        let pieces = subcarrier.pieces();
        let sign = |(chip, value): (usize, &i8)| {
            let (chip, value) = (chip, *value);
            (0..pieces).map(
                move |piece| if subcarrier.amplitude(chip, piece) < 0.0 { -value } else { value },
            )
        };
        (pieces, code.iter().enumerate().flat_map(sign).collect())
    }

    /// Delays, chips, of the side peaks of the autocorrelation to which a loop may lock: one either side of each, in
    /// steps of half a period of the subcarrier.
    pub fn side_peaks_chips(self) -> impl Iterator<Item = f64> {
        let ratio = match self.narrowband() {
            Self::Boc { ratio } => ratio,
            _ => 0,
        };
        (1..2 * u32::from(ratio)).map(move |k| f64::from(k) / (2.0 * f64::from(ratio)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Modulation; 7] = [
        Modulation::Bpsk,
        Modulation::Boc { ratio: 1 },
        Modulation::Boc { ratio: 6 },
        Modulation::Cboc { pilot: false },
        Modulation::Cboc { pilot: true },
        Modulation::Tmboc,
        Modulation::Qmboc,
    ];

    /// Correlation of `a` with `b` moved by so many twelfths of a chip, averaged over the 33 chips of TMBOC and random
    /// codes: chips of different number do not correlate.
    fn correlation(a: Modulation, b: Modulation, shift: usize) -> f64 {
        let at = |m: Modulation, chip, twelfth: usize| m.amplitude(chip, twelfth * m.pieces() / 12);
        let chip = |c| (shift..12).map(move |k| at(a, c, k) * at(b, c, k - shift));
        (0..33).flat_map(chip).sum::<f64>() / (33.0 * 12.0)
    }

    #[test]
    fn powers_are_those_of_the_interface_specifications() {
        for modulation in ALL {
            let expected = if modulation == Modulation::Qmboc { 29.0 / 33.0 } else { 1.0 };
            assert!((correlation(modulation, modulation, 0) - expected).abs() < 1e-12);
        }
        let power = |m, replica| correlation(m, replica, 0).powi(2);
        let [slow, fast] = [1, 6].map(|ratio| Modulation::Boc { ratio });
        for pilot in [false, true] {
            let cboc = Modulation::Cboc { pilot };
            assert!((power(cboc, slow) - 10.0 / 11.0).abs() < 1e-12);
            assert!((power(cboc, fast) - 1.0 / 11.0).abs() < 1e-12);
            assert_eq!(cboc.narrowband(), slow);
        }
        // A replica of BOC(1,1) loses 20 lg(29/33), 1.12 dB, of TMBOC, and 0.56 dB of QMBOC, whose power is 1.
        assert!((correlation(Modulation::Tmboc, slow, 0) - 29.0 / 33.0).abs() < 1e-12);
        assert!((10.0 * power(Modulation::Qmboc, slow).log10() + 0.561).abs() < 1e-3);
    }

    /// BOC(1,1): 1 at 0, zero at a third of a chip, -0.5 at half a chip (Betz 2001).
    #[test]
    fn the_autocorrelation_of_boc_has_a_side_peak_at_half_a_chip() {
        let boc = Modulation::Boc { ratio: 1 };
        for (shift, value) in [(0, 1.0), (4, 0.0), (6, -0.5), (9, -0.25)] {
            assert!((correlation(boc, boc, shift) - value).abs() < 1e-12, "{shift}");
        }
        assert_eq!(boc.side_peaks_chips().collect::<Vec<_>>(), [0.5]);
        assert_eq!(Modulation::Cboc { pilot: true }.side_peaks_chips().collect::<Vec<_>>(), [0.5]);
        assert_eq!(Modulation::Bpsk.side_peaks_chips().count(), 0);
        assert_eq!(Modulation::Bpsk.slope(), 1.0);
        assert!((1.0 - boc.slope() / 12.0 - correlation(boc, boc, 1)).abs() < 1e-12);
        assert_eq!(boc.replica(&[1, -1]), (2, vec![1, -1, -1, 1]));
    }

    /// Signs within one chip, as OS SIS ICD 2.3.3 draws them: a + b, a - b, ... over the first half.
    #[test]
    fn cboc_begins_with_the_sum_in_the_data_and_the_difference_in_the_pilot() {
        let [sum, difference] = [
            11f64.sqrt().recip() + (10f64 / 11.0).sqrt(),
            (10f64 / 11.0).sqrt() - 11f64.sqrt().recip(),
        ];
        for piece in 0..12 {
            let sign = if piece < 6 { 1.0 } else { -1.0 };
            let [even, odd] = if piece < 6 { [sum, difference] } else { [difference, sum] };
            let [data, pilot] = if piece % 2 == 0 { [even, odd] } else { [odd, even] };
            let amplitude = |pilot| Modulation::Cboc { pilot }.amplitude(0, piece);
            assert!((amplitude(false) - sign * data).abs() < 1e-12, "{piece}");
            assert!((amplitude(true) - sign * pilot).abs() < 1e-12, "{piece}");
        }
    }
}
