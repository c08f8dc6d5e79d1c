//! Point spread functions.

use nacre_base::{Error, Result};
use nacre_image::Raster;

/// Largest standard deviation of a Gaussian, in pixels.
pub const MAX_SIGMA: f64 = 200.0;

/// Maximum width and height of a point spread function given as an image, in pixels.
pub const MAX_PSF_SIDE: usize = 1023;

/// Truncation radius of a Gaussian in standard deviations; 6e-5 of its mass lies beyond.
const REACH: f64 = 4.0;

/// Point spread function of a lens, normalised to a sum of 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Psf(pub(super) Shape);

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    /// Symmetric and equal along rows and columns: centre value and one side.
    Separable(Vec<f32>),
    /// Arbitrary: odd width and height, values row by row.
    Any { width: usize, height: usize, values: Vec<f32> },
}

impl Psf {
    /// Gaussian with this standard deviation in pixels, truncated at four standard deviations.
    ///
    /// # Errors
    /// `Input` unless it is above 0 and at most [`MAX_SIGMA`].
    pub fn gaussian(sigma: f64) -> Result<Self> {
        Self::gaussian_within(sigma, (REACH * sigma).ceil().max(1.0) as usize)
    }

    /// Gaussian truncated at `radius` pixels from its centre.
    ///
    /// # Errors
    /// As [`Self::gaussian`]; for a radius above 1000.
    pub fn gaussian_within(sigma: f64, radius: usize) -> Result<Self> {
        if !(sigma > 0.0 && sigma <= MAX_SIGMA) {
            let problem = format!("is {sigma} pixels; expected above 0, at most {MAX_SIGMA}");
            return Err(Error::input(
                "PSF sigma",
                problem,
                "measure the width of an edge or a speck of dust in the photograph",
            ));
        }
        if radius > 1000 {
            return Err(Error::input(
                "PSF radius",
                format!("is {radius} pixels; expected at most 1000"),
                "give a smaller one",
            ));
        }
        let half: Vec<f64> = (0..=radius).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
        let sum = half[0] + 2.0 * half[1..].iter().sum::<f64>();
        Ok(Self(Shape::Separable(half.into_iter().map(|v| (v / sum) as f32).collect())))
    }

    /// From the first channel of an image with odd width and height and the point in the middle pixel.
    ///
    /// # Errors
    /// `Input` for other sizes, for negative or non-finite values, and for an image of zeros.
    pub fn image(raster: &Raster) -> Result<Self> {
        use nacre_image::Samples as S;
        let (width, height, n) = (raster.width, raster.height, raster.channels);
        let bad = |problem: String, remedy: &str| Err(Error::input("PSF image", problem, remedy));
        if width % 2 == 0 || height % 2 == 0 {
            let problem = format!("is {width} x {height} pixels, which has no middle pixel");
            return bad(problem, "crop it to odd width and height with the point in the middle");
        }
        if width.max(height) > MAX_PSF_SIDE {
            return bad(format!("is {width} x {height} pixels, at most {MAX_PSF_SIDE} are taken"), "crop it");
        }
        let values: Vec<f64> = match &raster.samples {
            S::U8(v) => v.iter().step_by(n).map(|v| f64::from(*v)).collect(),
            S::U16(v) => v.iter().step_by(n).map(|v| f64::from(*v)).collect(),
            S::F32(v) => v.iter().step_by(n).map(|v| f64::from(*v)).collect(),
        };
        if values.iter().any(|v| !(0.0..f64::from(f32::MAX)).contains(v)) {
            return bad(
                "has values that are negative or not finite".into(),
                "subtract its background and clip it at 0",
            );
        }
        let sum: f64 = values.iter().sum();
        if sum <= 0.0 {
            return bad("is black".into(), "give a photograph of a point");
        }
        let values = values.into_iter().map(|v| (v / sum) as f32).collect();
        Ok(Self(Shape::Any { width, height, values }))
    }

    /// Horizontal and vertical radius in pixels.
    pub fn reach(&self) -> [usize; 2] {
        match &self.0 {
            Shape::Separable(half) => [half.len() - 1; 2],
            Shape::Any { width, height, .. } => [width / 2, height / 2],
        }
    }

    /// Squared modulus of the transfer function at `n · n` evenly distributed frequencies of equal weight.
    pub(super) fn power(&self, n: usize) -> Vec<f64> {
        // Centres of cells in the half plane fx > 0; the other half is its mirror image.
        let at = |k: usize, of: f64| std::f64::consts::PI * ((k as f64 + 0.5) / n as f64 * of - (of - 1.0));
        match &self.0 {
            Shape::Separable(half) => {
                let one = |k: usize| {
                    let side =
                        half.iter().enumerate().skip(1).map(|(j, v)| f64::from(*v) * (j as f64 * at(k, 1.0)).cos());
                    (f64::from(half[0]) + 2.0 * side.sum::<f64>()).powi(2)
                };
                let line: Vec<f64> = (0..n).map(one).collect();
                line.iter().flat_map(|a| line.iter().map(move |b| a * b)).collect()
            }
            Shape::Any { width, height, values } => {
                let middle = [(width / 2) as f64, (height / 2) as f64];
                // Negligible values are skipped for speed.
                let least = 1e-6 * values.iter().copied().fold(0.0, f32::max);
                let cell = |i: usize| {
                    let (fx, fy) = (at(i % n, 1.0), at(i / n, 2.0));
                    let (mut re, mut im) = (0.0, 0.0);
                    for (j, v) in values.iter().enumerate().filter(|(_, v)| **v > least) {
                        let (x, y) = ((j % width) as f64 - middle[0], (j / width) as f64 - middle[1]);
                        let (sin, cos) = (fx * x + fy * y).sin_cos();
                        re += f64::from(*v) * cos;
                        im += f64::from(*v) * sin;
                    }
                    re * re + im * im
                };
                use rayon::prelude::*;
                (0..n * n).into_par_iter().map(cell).collect()
            }
        }
    }
}
