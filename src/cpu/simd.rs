//! Which SIMD instructions the loops of the cpu path are compiled to. They are chosen at run time: a library for x86-64
//! is built for the oldest of these processors, which take four numbers at a time.
//!
//! Results do not depend on it: no multiplication is fused with an addition, and no order of additions changes. AVX-512
//! was measured to gain nothing over AVX2 in what memory bounds, and to cost as much code again.

/// Call `f`, compiled for AVX2 where the processor has it, together with all that the compiler inlines into it: pass a
/// closure that is `#[inline(always)]` and calls functions that are.
#[inline(always)]
pub(super) fn widest<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = fearless_simd::Level::new().as_avx2() {
        return fearless_simd::Simd::vectorize(avx2, f);
    }
    // aarch64 has NEON in any case.
    f()
}
