//! Loops compiled for the vectors of old and of new processors, which are told apart when the program runs.

use pulp::{Arch, Simd, WithSimd};

/// Does `work`, compiled for this processor with everything that is inlined into it. That must be told: the closure and
/// what it calls in its loops are to be `#[inline(always)]`, and its loops are to be `for` loops: closures given to `for_each` of an
/// iterator or `map` of an array may be compiled apart, for old processors. (`Arch::dispatch` of a closure calls it through a function that is
/// compiled for old processors, unless it is small.)
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
