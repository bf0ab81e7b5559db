//! Instruction sets, chosen at run time, since a build for baseline x86-64 has vectors of four numbers only.
//!
//! Results do not depend on it: multiplications and additions are not fused, and their order is fixed. AVX-512 gained
//! nothing over AVX2 where memory is the limit, and would double the code.

/// Evaluates an expression, compiled for AVX2 if the processor supports it; `$simd` makes vectors. Functions that it
/// calls must be `#[inline(always)]`.
macro_rules! widest {
    ($simd:ident => $code:expr) => {{
        let level = fearless_simd::Level::new();
        #[cfg(target_arch = "x86_64")]
        if let Some($simd) = level.as_avx2() {
            fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $code,
            );
        } else if let Some($simd) = level.as_sse2() {
            $code;
        }
        // aarch64 always has NEON; no call stands between it and its loops.
        #[cfg(target_arch = "aarch64")]
        if let Some($simd) = level.as_neon() {
            $code;
        }
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        fearless_simd::dispatch!(level, $simd => $code)
    }};
}
pub(crate) use widest;
