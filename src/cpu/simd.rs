//! Instruction sets of path `cpu`, chosen at run time, since a build for baseline x86-64 has vectors of four numbers
//! only.
//!
//! Results do not depend on it: multiplications and additions are not fused, and their order is fixed. AVX-512 gained
//! nothing over AVX2 where memory is the limit, and would double the code.

/// Calls `f`, compiled for AVX2 if the processor supports it. `f` and the functions that it calls must be
/// `#[inline(always)]`.
#[inline(always)]
pub(super) fn widest<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = fearless_simd::Level::new().as_avx2() {
        return fearless_simd::Simd::vectorize(avx2, f);
    }
    // aarch64 always has NEON.
    f()
}
