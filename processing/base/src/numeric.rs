//! Arithmetic without subnormal numbers.
//!
//! Recursive filters, convolutions and exponentials decay to zero through subnormal numbers, and photographs contain
//! many exact zeros after black subtraction. Many processors are a hundred times slower for subnormal numbers, which
//! are negligible here.

#![allow(unsafe_code, reason = "no safe code reaches the register that controls floating-point arithmetic")]

/// Treats subnormal numbers as zero: on this thread, on threads that it starts later, and on all threads of rayon's
/// global pool, which it starts. (POSIX threads inherit the floating-point environment.)
///
/// Call it once, when a program starts. Only numbers below 1.2e-38 (f32) and 2.3e-308 (f64) change. It has no effect on
/// processors other than x86-64 and AArch64.
pub fn flush_subnormals() {
    flush();
    rayon::broadcast(|_| flush());
}

#[cfg(target_arch = "x86_64")]
fn flush() {
    /// Flush to zero, and denormals are zeros (Intel SDM volume 1, 10.2.3).
    const FLUSH: u32 = 1 << 15 | 1 << 6;
    let mut control = 0_u32;
    // SAFETY: reads and writes only a local variable, and changes only two bits of the register.
    unsafe {
        std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut control, options(nostack));
        control |= FLUSH;
        std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const control, options(nostack));
    }
}

#[cfg(target_arch = "aarch64")]
fn flush() {
    /// FZ (Arm ARM, FPCR).
    const FLUSH: u64 = 1 << 24;
    let control: u64;
    // SAFETY: accesses no memory, and changes only one bit of the register.
    unsafe {
        std::arch::asm!("mrs {}, fpcr", out(reg) control, options(nostack));
        std::arch::asm!("msr fpcr, {}", in(reg) control | FLUSH, options(nostack));
    }
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn flush() {}

#[cfg(test)]
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod tests {
    use super::*;
    use std::hint::black_box;

    /// True if subnormal products, and products with subnormal factors, are zero.
    fn flushed() -> bool {
        let result = black_box(f32::MIN_POSITIVE) * black_box(0.5) == 0.0
            && black_box(f64::MIN_POSITIVE) * black_box(0.5) == 0.0;
        let operand = black_box(f32::from_bits(1)) * black_box(1e38) == 0.0;
        result && operand
    }

    #[test]
    fn no_thread_computes_with_subnormals() {
        assert!(!std::thread::spawn(flushed).join().unwrap());
        flush_subnormals();
        assert!(flushed());
        assert!(rayon::broadcast(|_| flushed()).into_iter().all(|f| f));
        assert!(std::thread::spawn(flushed).join().unwrap());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        assert!(pool.broadcast(|_| flushed()).into_iter().all(|f| f));
    }
}
