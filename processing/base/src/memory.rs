//! Memory that is moved past the caches, or into them ahead of time: hints to the processor, which no safe code can give.

#![allow(unsafe_code, reason = "there are no safe intrinsics for stores past the caches and for prefetching")]

/// Values that one line of the caches holds.
#[cfg(target_arch = "x86_64")]
const LINE: usize = 16;

/// Has these values fetched into the second cache, but does not wait for them.
#[inline(always)]
pub fn prefetch(values: &[f32]) {
    #[cfg(target_arch = "x86_64")]
    for line in values.chunks(LINE) {
        use std::arch::x86_64::{_MM_HINT_T1, _mm_prefetch};
        // SAFETY: every x86-64 processor has it, and whatever address it is given it reads nothing that a program could see.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(line.as_ptr().cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = values;
}

/// Copies values to where none of them is soon read again: the memory is not read before it is written, and the caches keep what
/// they have. The slices have one length. [`stored`] has to follow before other threads are told.
#[inline(always)]
pub fn store_past_caches(to: &mut [f32], from: &[f32]) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{__m128, _mm_loadu_ps, _mm_stream_ps};
        // SAFETY: a vector is four floats, whatever their bits.
        let (head, vectors, tail) = unsafe { to.align_to_mut::<__m128>() };
        let (first, from) = from.split_at(head.len());
        let (middle, last) = from.split_at(4 * vectors.len());
        head.copy_from_slice(first);
        for (to, from) in vectors.iter_mut().zip(middle.as_chunks::<4>().0) {
            // SAFETY: both are four floats, the first aligned and ours alone.
            unsafe { _mm_stream_ps(std::ptr::from_mut(to).cast(), _mm_loadu_ps(from.as_ptr())) };
        }
        tail.copy_from_slice(last);
    }
    #[cfg(not(target_arch = "x86_64"))]
    to.copy_from_slice(from);
}

/// Everything that was stored past the caches is there for other threads before anything that follows.
pub fn stored() {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: every x86-64 processor has it.
    unsafe {
        std::arch::x86_64::_mm_sfence();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wherever they begin and however many there are, and nothing beside them.
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
