//! Packed f32 arithmetic, one type per instruction set.
//!
//! The methods are fast only when inlined into functions that enable the instruction set. Calling them on a processor that
//! lacks it is undefined behaviour, hence `unsafe`.

use half::bf16;

/// A register of f32 lanes.
pub(super) trait Vector: Copy {
    /// Number of lanes.
    const LANES: usize;
    /// All lanes zero.
    unsafe fn zero() -> Self;
    /// All lanes equal.
    unsafe fn splat(value: f32) -> Self;
    /// Loads `LANES` numbers, any alignment.
    unsafe fn load(from: *const f32) -> Self;
    /// Loads `LANES` bf16 numbers, any alignment, and widens them.
    unsafe fn load_bf16(from: *const bf16) -> Self;
    /// Stores `LANES` numbers, any alignment.
    unsafe fn store(self, to: *mut f32);
    /// `self * factor + addend`, fused where the hardware fuses.
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// Sum.
    unsafe fn add(self, other: Self) -> Self;
    /// Difference.
    unsafe fn sub(self, other: Self) -> Self;
    /// Product.
    unsafe fn mul(self, other: Self) -> Self;
    /// Quotient.
    unsafe fn div(self, other: Self) -> Self;
    /// Larger of each pair.
    unsafe fn max(self, other: Self) -> Self;
    /// Smaller of each pair.
    unsafe fn min(self, other: Self) -> Self;
    /// `value * 2^n`, where `n` is in the low bits of `self`'s representation.
    unsafe fn scale_by_low_bits(self, value: Self) -> Self;

    /// The exponential, within 2 ulp. Saturates outside [-87, 88].
    #[inline(always)]
    unsafe fn exp(self) -> Self {
        // Adding 1.5 * 2^23 rounds to an integer, and leaves it in the low bits.
        const ROUND: f32 = 12_582_912.0;
        unsafe {
            let x = self.max(Self::splat(-87.0)).min(Self::splat(88.0));
            let shifted = x.mul_add(Self::splat(std::f32::consts::LOG2_E), Self::splat(ROUND));
            let n = shifted.sub(Self::splat(ROUND));
            let r = n.mul_add(Self::splat(-0.693_359_4), x);
            let r = n.mul_add(Self::splat(2.121_944_4e-4), r);
            let mut p = Self::splat(1.987_569_1e-4);
            for coefficient in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5] {
                p = p.mul_add(r, Self::splat(coefficient));
            }
            let value = p.mul_add(r.mul(r), r).add(Self::splat(1.0));
            shifted.scale_by_low_bits(value)
        }
    }

    /// `1 / (1 + exp(-x))`.
    #[inline(always)]
    unsafe fn sigmoid(self) -> Self {
        unsafe {
            let one = Self::splat(1.0);
            one.div(one.add(Self::zero().sub(self).exp()))
        }
    }

    /// The hyperbolic tangent, with an absolute error below 2e-7.
    #[inline(always)]
    unsafe fn tanh(self) -> Self {
        unsafe {
            let one = Self::splat(1.0);
            let e = self.add(self).exp();
            one.sub(Self::splat(2.0).div(e.add(one)))
        }
    }
}

/// Eight lanes in plain Rust, correct everywhere and vectorised by the compiler where it can.
#[derive(Clone, Copy)]
pub(super) struct Portable([f32; 8]);

macro_rules! lanewise {
    ($name:ident, |$a:ident, $b:ident| $body:expr) => {
        #[inline(always)]
        unsafe fn $name(self, other: Self) -> Self {
            Self(std::array::from_fn(|i| {
                let ($a, $b) = (self.0[i], other.0[i]);
                $body
            }))
        }
    };
}

impl Vector for Portable {
    const LANES: usize = 8;
    #[inline(always)]
    unsafe fn zero() -> Self {
        Self([0.0; 8])
    }
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Self([value; 8])
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        unsafe { Self(from.cast::<[f32; 8]>().read_unaligned()) }
    }
    #[inline(always)]
    unsafe fn load_bf16(from: *const bf16) -> Self {
        let raw = unsafe { from.cast::<[u16; 8]>().read_unaligned() };
        Self(raw.map(|bits| f32::from_bits(u32::from(bits) << 16)))
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe { to.cast::<[f32; 8]>().write_unaligned(self.0) }
    }
    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        Self(std::array::from_fn(|i| {
            // Without hardware support, `mul_add` would call a slow library function.
            if cfg!(any(target_arch = "aarch64", target_feature = "fma")) {
                self.0[i].mul_add(factor.0[i], addend.0[i])
            } else {
                self.0[i] * factor.0[i] + addend.0[i]
            }
        }))
    }
    lanewise!(add, |a, b| a + b);
    lanewise!(sub, |a, b| a - b);
    lanewise!(mul, |a, b| a * b);
    lanewise!(div, |a, b| a / b);
    lanewise!(max, |a, b| if a > b { a } else { b });
    lanewise!(min, |a, b| if a < b { a } else { b });
    lanewise!(scale_by_low_bits, |low, value| f32::from_bits(value.to_bits().wrapping_add(low.to_bits() << 23)));
}

/// Prefetches the cache line at an address, which need not be valid.
#[inline(always)]
pub(super) fn prefetch<T>(address: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: every x86-64 processor has the instruction, and it never faults.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(address.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = address;
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Vector, bf16};
    use std::arch::x86_64::*;

    /// Eight lanes; needs AVX2 and FMA.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx2(__m256);

    /// Sixteen lanes; needs AVX-512F.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx512(__m512);

    macro_rules! pairwise {
        ($($name:ident => $intrinsic:ident),*) => {$(
            #[inline(always)]
            unsafe fn $name(self, other: Self) -> Self {
                unsafe { Self($intrinsic(self.0, other.0)) }
            }
        )*};
    }

    impl Vector for Avx2 {
        const LANES: usize = 8;
        #[inline(always)]
        unsafe fn zero() -> Self {
            unsafe { Self(_mm256_setzero_ps()) }
        }
        #[inline(always)]
        unsafe fn splat(value: f32) -> Self {
            unsafe { Self(_mm256_set1_ps(value)) }
        }
        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self {
            unsafe { Self(_mm256_loadu_ps(from)) }
        }
        #[inline(always)]
        unsafe fn load_bf16(from: *const bf16) -> Self {
            unsafe {
                let wide = _mm256_cvtepu16_epi32(_mm_loadu_si128(from.cast()));
                Self(_mm256_castsi256_ps(_mm256_slli_epi32::<16>(wide)))
            }
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut f32) {
            unsafe { _mm256_storeu_ps(to, self.0) }
        }
        #[inline(always)]
        unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
            unsafe { Self(_mm256_fmadd_ps(self.0, factor.0, addend.0)) }
        }
        pairwise!(add => _mm256_add_ps, sub => _mm256_sub_ps, mul => _mm256_mul_ps, div => _mm256_div_ps,
                  max => _mm256_max_ps, min => _mm256_min_ps);
        #[inline(always)]
        unsafe fn scale_by_low_bits(self, value: Self) -> Self {
            unsafe {
                let exponent = _mm256_slli_epi32::<23>(_mm256_castps_si256(self.0));
                Self(_mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(value.0), exponent)))
            }
        }
    }

    impl Vector for Avx512 {
        const LANES: usize = 16;
        #[inline(always)]
        unsafe fn zero() -> Self {
            unsafe { Self(_mm512_setzero_ps()) }
        }
        #[inline(always)]
        unsafe fn splat(value: f32) -> Self {
            unsafe { Self(_mm512_set1_ps(value)) }
        }
        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self {
            unsafe { Self(_mm512_loadu_ps(from)) }
        }
        #[inline(always)]
        unsafe fn load_bf16(from: *const bf16) -> Self {
            unsafe {
                let wide = _mm512_cvtepu16_epi32(_mm256_loadu_si256(from.cast()));
                Self(_mm512_castsi512_ps(_mm512_slli_epi32::<16>(wide)))
            }
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut f32) {
            unsafe { _mm512_storeu_ps(to, self.0) }
        }
        #[inline(always)]
        unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
            unsafe { Self(_mm512_fmadd_ps(self.0, factor.0, addend.0)) }
        }
        pairwise!(add => _mm512_add_ps, sub => _mm512_sub_ps, mul => _mm512_mul_ps, div => _mm512_div_ps,
                  max => _mm512_max_ps, min => _mm512_min_ps);
        #[inline(always)]
        unsafe fn scale_by_low_bits(self, value: Self) -> Self {
            unsafe {
                let exponent = _mm512_slli_epi32::<23>(_mm512_castps_si512(self.0));
                Self(_mm512_castsi512_ps(_mm512_add_epi32(_mm512_castps_si512(value.0), exponent)))
            }
        }
    }
}
