//! Loops compiled for several vector instruction sets, selected at run time.

use pulp::{Arch, Simd, WithSimd};

/// Runs `work`, compiled for this processor together with everything inlined into it. The closure and the functions
/// called in its loops must be `#[inline(always)]`, and its loops must be `for` loops. Closures passed to an iterator's
/// `for_each` or an array's `map` may be compiled separately, for the baseline processor. (`Arch::dispatch` calls a
/// large closure through a function compiled for the baseline.)
pub fn vectorised<T>(work: impl FnMut() -> T) -> T {
    struct Work<F>(F);
    impl<T, F: FnMut() -> T> WithSimd for Work<F> {
        type Output = T;

        #[inline(always)]
        fn with_simd<S: Simd>(mut self, _: S) -> T {
            (self.0)()
        }
    }
    Arch::new().dispatch(Work(work))
}
