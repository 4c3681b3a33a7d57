//! Samples of whole bytes: integers and floating-point numbers.

use multiversion::multiversion;
use num_complex::Complex32;

/// How one number (a real sample, or I or Q) is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    /// Unsigned 8 bits whose zero is 127.5, as RTL-SDR receivers give.
    U8,
    /// Signed 8 bits.
    I8,
    /// Unsigned 16 bits whose zero is 32767.5.
    U16,
    /// Signed 16 bits.
    I16,
    /// Signed 24 bits (WAV).
    I24,
    /// Signed 32 bits.
    I32,
    /// IEEE 754 single precision.
    F32,
    /// IEEE 754 double precision.
    F64,
}

impl Number {
    /// Bytes of one number.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::I24 => 3,
            Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Name without the leading `c` or `r`, such as `s16`.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "s8",
            Self::U16 => "u16",
            Self::I16 => "s16",
            Self::I24 => "s24",
            Self::I32 => "s32",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }

    /// Decodes `bytes` (whole samples of one number if `real`, else I and Q) into as many samples,
    /// Q times `q_sign`, and gives the count of numbers that were NaN or infinite (they become 0).
    pub(super) fn decode(
        self,
        big_endian: bool,
        real: bool,
        q_sign: f32,
        bytes: &[u8],
        out: &mut [Complex32],
    ) -> u64 {
        let mut bad = 0;
        let mut finite = |x: f32| {
            bad += u64::from(!x.is_finite());
            if x.is_finite() { x } else { 0.0 }
        };
        match (self, big_endian) {
            (Self::U8, _) => fill(real, q_sign, bytes, out, |[b]| f32::from(b) - 127.5),
            (Self::I8, _) => fill(real, q_sign, bytes, out, |[b]| f32::from(b as i8)),
            (Self::U16, false) => {
                fill(real, q_sign, bytes, out, |b| f32::from(u16::from_le_bytes(b)) - 32_767.5);
            }
            (Self::U16, true) => {
                fill(real, q_sign, bytes, out, |b| f32::from(u16::from_be_bytes(b)) - 32_767.5);
            }
            (Self::I16, false) => {
                fill(real, q_sign, bytes, out, |b| f32::from(i16::from_le_bytes(b)))
            }
            (Self::I16, true) => {
                fill(real, q_sign, bytes, out, |b| f32::from(i16::from_be_bytes(b)))
            }
            (Self::I24, _) => fill(real, q_sign, bytes, out, |[a, b, c]| {
                let [a, c] = if big_endian { [c, a] } else { [a, c] };
                (i32::from_le_bytes([0, a, b, c]) >> 8) as f32
            }),
            (Self::I32, false) => fill(real, q_sign, bytes, out, |b| i32::from_le_bytes(b) as f32),
            (Self::I32, true) => fill(real, q_sign, bytes, out, |b| i32::from_be_bytes(b) as f32),
            (Self::F32, false) => fill(real, q_sign, bytes, out, |b| finite(f32::from_le_bytes(b))),
            (Self::F32, true) => fill(real, q_sign, bytes, out, |b| finite(f32::from_be_bytes(b))),
            (Self::F64, false) => {
                fill(real, q_sign, bytes, out, |b| finite(f64::from_le_bytes(b) as f32))
            }
            (Self::F64, true) => {
                fill(real, q_sign, bytes, out, |b| finite(f64::from_be_bytes(b) as f32))
            }
        }
        bad
    }
}

/// Fills `out` from numbers of `N` bytes each. Of 8 bits, 2 bytes are read and 8 written per complex sample.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn fill<const N: usize, F: FnMut([u8; N]) -> f32>(
    real: bool,
    q_sign: f32,
    bytes: &[u8],
    out: &mut [Complex32],
    mut value: F,
) {
    let numbers = bytes.as_chunks::<N>().0;
    if real {
        for (sample, &x) in out.iter_mut().zip(numbers) {
            *sample = Complex32::new(value(x), 0.0);
        }
    } else {
        for (sample, &[i, q]) in out.iter_mut().zip(numbers.as_chunks::<2>().0) {
            *sample = Complex32::new(value(i), q_sign * value(q));
        }
    }
}
