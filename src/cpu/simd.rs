//! Which SIMD instructions the loops of the cpu path are compiled to: chosen at run time, since a library is built for the
//! oldest processors that it may run on (x86-64: four numbers at a time).
//!
//! Results do not depend on it: there are no fused multiply-adds, and no order of additions changes.

/// Call `f` with the widest instructions of the processor: it is compiled for each of them, together with all that the
/// compiler inlines into it. Pass a closure that is `#[inline(always)]`, and calls functions that are.
#[inline(always)]
pub(super) fn widest<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    {
        // Without FMA: the compiler may not fuse operations, but nor can it by mistake.
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
        fn avx512<R>(f: impl FnOnce() -> R) -> R {
            f()
        }

        #[target_feature(enable = "avx2")]
        fn avx2<R>(f: impl FnOnce() -> R) -> R {
            f()
        }

        macro_rules! has {
            ($($feature:tt)*) => { $(is_x86_feature_detected!($feature))&&* };
        }
        if has!("avx512f" "avx512bw" "avx512dq" "avx512vl") {
            // SAFETY: the processor and the operating system have all features that the function is compiled for.
            return unsafe { avx512(f) };
        }
        if has!("avx2") {
            // SAFETY: as above.
            return unsafe { avx2(f) };
        }
    }
    // aarch64 has NEON in any case.
    f()
}
