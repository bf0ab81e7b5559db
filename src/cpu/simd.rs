//! Which SIMD instructions the loops of the cpu path use. It is chosen at run time: a library for x86-64 is built for the
//! oldest of these processors, which take four numbers at a time.
//!
//! Results do not depend on it: multiplications and additions are not fused, and their order does not change. AVX-512 was
//! measured to gain nothing over AVX2 in what memory bounds, and to cost as much code again.

/// Call `f`, compiled for AVX2 where the processor has it, together with all that the compiler inlines into it: pass a
/// closure that is `#[inline(always)]` and calls functions that are.
#[inline(always)]
pub(super) fn widest<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn avx2<R>(f: impl FnOnce() -> R) -> R {
            f()
        }

        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor and the operating system have what the function is compiled for.
            return unsafe { avx2(f) };
        }
    }
    // aarch64 has NEON in any case.
    f()
}
