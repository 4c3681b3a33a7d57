//! Vector registers of several instruction sets under one name, and the choice among them at run time.
//!
//! The crate `multiversion` enables AVX-512 only for processors from Ice Lake on, and leaves the allocation of
//! registers to the compiler; explicit registers make the products of the sparse solvers three times as fast.

/// A computation on blocks that is compiled for each instruction set.
pub trait Sweep {
    /// Runs it with registers `R`. Must be `#[inline(always)]`.
    fn run<R: Register>(self);
}

/// Runs a computation with the widest registers of the processor.
pub fn dispatch(sweep: impl Sweep) {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("fma") {
            // SAFETY: the processor has AVX-512F and FMA, which is all that the function asks for.
            #[allow(unsafe_code)]
            return unsafe { x86::with_avx512(sweep) };
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the processor has AVX2 and FMA, which is all that the function asks for.
            #[allow(unsafe_code)]
            return unsafe { x86::with_avx2(sweep) };
        }
    }
    sweep.run::<[f32; 4]>();
}

/// Several single-precision numbers in one register. A type of this kind exists only inside
/// [`dispatch`], which has asked the processor for it.
pub trait Register: Copy {
    /// Number of lanes.
    const WIDTH: usize;
    /// The same number in all lanes.
    fn splat(value: f32) -> Self;
    /// Loads the first `WIDTH` numbers, which must exist.
    fn load(from: &[f32]) -> Self;
    /// Stores into the first `WIDTH` numbers, which must exist.
    fn store(self, to: &mut [f32]);
    /// self + a b.
    fn plus(self, a: Self, b: Self) -> Self;
    /// self - a b.
    fn minus(self, a: Self, b: Self) -> Self;
}

/// The portable version, for processors without the instructions of x86: four numbers, as NEON and SSE have
/// them.
impl Register for [f32; 4] {
    const WIDTH: usize = 4;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        [value; 4]
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        std::array::from_fn(|k| from[k])
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..4].copy_from_slice(&self);
    }

    #[inline(always)]
    fn plus(self, a: Self, b: Self) -> Self {
        std::array::from_fn(|k| {
            // Fused where that is an instruction and not a call.
            if cfg!(target_arch = "aarch64") {
                a[k].mul_add(b[k], self[k])
            } else {
                self[k] + a[k] * b[k]
            }
        })
    }

    #[inline(always)]
    fn minus(self, a: Self, b: Self) -> Self {
        self.plus(a.map(|v| -v), b)
    }
}

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod x86 {
    use super::{Register, Sweep};
    use std::arch::x86_64::*;

    #[target_feature(enable = "avx512f,fma")]
    pub fn with_avx512(sweep: impl Sweep) {
        sweep.run::<__m512>();
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn with_avx2(sweep: impl Sweep) {
        sweep.run::<__m256>();
    }

    // SAFETY, of all that follows: the methods are called from the two functions above alone, whose features
    // make the instructions exist; slices are cut to the width before their pointer is taken.

    impl Register for __m512 {
        const WIDTH: usize = 16;

        #[inline(always)]
        fn splat(value: f32) -> Self {
            unsafe { _mm512_set1_ps(value) }
        }

        #[inline(always)]
        fn load(from: &[f32]) -> Self {
            unsafe { _mm512_loadu_ps(from[..16].as_ptr()) }
        }

        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            unsafe { _mm512_storeu_ps(to[..16].as_mut_ptr(), self) }
        }

        #[inline(always)]
        fn plus(self, a: Self, b: Self) -> Self {
            unsafe { _mm512_fmadd_ps(a, b, self) }
        }

        #[inline(always)]
        fn minus(self, a: Self, b: Self) -> Self {
            unsafe { _mm512_fnmadd_ps(a, b, self) }
        }
    }

    impl Register for __m256 {
        const WIDTH: usize = 8;

        #[inline(always)]
        fn splat(value: f32) -> Self {
            unsafe { _mm256_set1_ps(value) }
        }

        #[inline(always)]
        fn load(from: &[f32]) -> Self {
            unsafe { _mm256_loadu_ps(from[..8].as_ptr()) }
        }

        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            unsafe { _mm256_storeu_ps(to[..8].as_mut_ptr(), self) }
        }

        #[inline(always)]
        fn plus(self, a: Self, b: Self) -> Self {
            unsafe { _mm256_fmadd_ps(a, b, self) }
        }

        #[inline(always)]
        fn minus(self, a: Self, b: Self) -> Self {
            unsafe { _mm256_fnmadd_ps(a, b, self) }
        }
    }
}
