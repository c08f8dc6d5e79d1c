//! Cache control: non-temporal stores and prefetch, which safe code cannot express.

#![allow(unsafe_code, reason = "there are no safe intrinsics for stores past the caches and for prefetching")]

/// Number of values per cache line.
#[cfg(target_arch = "x86_64")]
const LINE: usize = 16;

/// Prefetches these values into the second-level cache without waiting.
#[inline(always)]
pub fn prefetch(values: &[f32]) {
    #[cfg(target_arch = "x86_64")]
    for line in values.chunks(LINE) {
        use std::arch::x86_64::{_MM_HINT_T1, _mm_prefetch};
        // SAFETY: every x86-64 processor supports this instruction, and a prefetch of any address has no architectural
        // effect.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(line.as_ptr().cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = values;
}

/// Copies values that will not be read again soon: the target is not read before it is written, and the caches keep
/// their contents. Both slices have the same length. [`stored`] must be called before other threads read the target.
#[inline(always)]
pub fn store_past_caches(to: &mut [f32], from: &[f32]) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{__m128, _mm_loadu_ps, _mm_stream_ps};
        // SAFETY: a vector is four floats, and any bits are valid.
        let (head, vectors, tail) = unsafe { to.align_to_mut::<__m128>() };
        let (first, from) = from.split_at(head.len());
        let (middle, last) = from.split_at(4 * vectors.len());
        head.copy_from_slice(first);
        for (to, from) in vectors.iter_mut().zip(middle.as_chunks::<4>().0) {
            // SAFETY: both are four floats; the target is aligned and exclusively borrowed.
            unsafe { _mm_stream_ps(std::ptr::from_mut(to).cast(), _mm_loadu_ps(from.as_ptr())) };
        }
        tail.copy_from_slice(last);
    }
    #[cfg(not(target_arch = "x86_64"))]
    to.copy_from_slice(from);
}

/// Makes all non-temporal stores visible to other threads before any subsequent operation.
pub fn stored() {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: every x86-64 processor supports this instruction.
    unsafe {
        std::arch::x86_64::_mm_sfence();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For any alignment and length, and without writing beyond the slice.
    #[test]
    fn stores_what_it_is_given() {
        let from: Vec<f32> = (0..40_u8).map(f32::from).collect();
        for (begin, length) in (0..8).flat_map(|begin| (0..32).map(move |length| (begin, length))) {
            let mut to = [-1.0_f32; 40];
            let here = begin..begin + length;
            prefetch(&from[here.clone()]);
            store_past_caches(&mut to[here.clone()], &from[1..=length]);
            stored();
            assert_eq!(to[here], from[1..=length]);
            assert_eq!(to.iter().filter(|v| **v == -1.0).count(), 40 - length);
        }
    }
}
