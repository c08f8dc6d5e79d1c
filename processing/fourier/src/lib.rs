#![doc = include_str!("../README.md")]

mod plane;

pub use plane::Fourier;
pub use realfft::{ComplexToReal, FftError, RealToComplex};
pub use rustfft::{Fft, FftNum};

use realfft::RealFftPlanner;
use rustfft::FftPlanner;
use std::sync::Arc;

/// Numbers that are transformed, f32 or f64. Their plans are functions without parameters of type, so that this crate alone compiles
/// rustfft's algorithms.
pub trait Real: FftNum {
    /// Plan of the transform of `length` complex values, with `exp(-2πi k n / length)`, not scaled.
    fn forward(length: usize) -> Arc<dyn Fft<Self>>;
    /// Plan of the inverse transform, not scaled.
    fn inverse(length: usize) -> Arc<dyn Fft<Self>>;
}

impl Real for f32 {
    fn forward(length: usize) -> Arc<dyn Fft<f32>> {
        FftPlanner::new().plan_fft_forward(length)
    }

    fn inverse(length: usize) -> Arc<dyn Fft<f32>> {
        FftPlanner::new().plan_fft_inverse(length)
    }
}

impl Real for f64 {
    fn forward(length: usize) -> Arc<dyn Fft<f64>> {
        FftPlanner::new().plan_fft_forward(length)
    }

    fn inverse(length: usize) -> Arc<dyn Fft<f64>> {
        FftPlanner::new().plan_fft_inverse(length)
    }
}

/// Plan of the transform of `length` real values into `length / 2 + 1` complex ones, not scaled.
pub fn real_forward(length: usize) -> Arc<dyn RealToComplex<f32>> {
    RealFftPlanner::new().plan_fft_forward(length)
}

/// Plan of its inverse, not scaled.
pub fn real_inverse(length: usize) -> Arc<dyn ComplexToReal<f32>> {
    RealFftPlanner::new().plan_fft_inverse(length)
}
