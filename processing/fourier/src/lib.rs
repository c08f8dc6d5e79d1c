#![doc = include_str!("../README.md")]

mod plane;

pub use plane::Fourier;
pub use realfft::{ComplexToReal, FftError, RealToComplex};
pub use rustfft::{Fft, FftNum};

use realfft::RealFftPlanner;
use rustfft::FftPlanner;
use std::sync::Arc;

/// Number types of transforms: f32 or f64. Plans come from functions without type parameters, so that rustfft's
/// algorithms are compiled in this crate only.
pub trait Real: FftNum {
    /// Plan of the forward transform of `length` complex values, with `exp(-2πi k n / length)`, unnormalised.
    fn forward(length: usize) -> Arc<dyn Fft<Self>>;
    /// Plan of the inverse transform, unnormalised.
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

/// Plan of the transform of `length` real values into `length / 2 + 1` complex ones, unnormalised.
pub fn real_forward(length: usize) -> Arc<dyn RealToComplex<f32>> {
    RealFftPlanner::new().plan_fft_forward(length)
}

/// Plan of its inverse, unnormalised.
pub fn real_inverse(length: usize) -> Arc<dyn ComplexToReal<f32>> {
    RealFftPlanner::new().plan_fft_inverse(length)
}
