//! Operations of one iteration on each row while it is in the cache.

use super::blur::{Sums, Work};
use super::kernel::Rows;
use super::plane::{Band, Plane};
use std::ops::Range;

/// Lower bound of divisors, as in scikit-image.
const EPSILON: f32 = 1e-12;

/// Number of independent partial sums, which the compiler vectorises.
const LANES: usize = 8;

/// Noise variance as a function of expected, shifted light.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Weights {
    /// Shift of measured and expected light (Snyder et al. 1993), which represents signal-independent noise.
    pub shift: f32,
    pub slope: f32,
    pub rest: f32,
}

/// Ratio of measured light to the blurred estimate; 0 where unmeasured.
pub(super) struct Ratio<'a> {
    pub measured: &'a Plane,
    pub out: Band<'a>,
    pub weights: Weights,
    /// Columns and rows whose residuals enter the misfit.
    pub counted: &'a [Range<usize>; 2],
    /// Sum of squared residuals over variance, and sum of squared residuals.
    pub misfit: Sums,
}

impl Rows for Ratio<'_> {
    #[inline(always)]
    fn row(&mut self, y: usize, blurred: &[f32]) {
        let Weights { shift, slope, rest } = self.weights;
        let n = blurred.len();
        let (measured, out) = (&self.measured.row(y)[..n], &mut self.out.row(y)[..n]);
        let expected = |blurred: f32| blurred.max(0.0) + shift + EPSILON;
        for x in 0..n {
            out[x] = measured[x] / expected(blurred[x]);
        }
        let [columns, rows] = self.counted;
        if !rows.contains(&y) {
            return;
        }
        let (measured, blurred) = (&measured[columns.clone()], &blurred[columns.clone()]);
        let one = |measured: f32, blurred: f32| {
            let (expected, known) = (expected(blurred), if measured == 0.0 { 0.0 } else { 1.0 });
            let square = known * (measured - expected) * (measured - expected);
            [square / (slope * expected + rest), square]
        };
        let ((measured, left), (blurred, over)) = (measured.as_chunks::<LANES>(), blurred.as_chunks::<LANES>());
        let (mut weighted, mut plain) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        for (measured, blurred) in measured.iter().zip(blurred) {
            for lane in 0..LANES {
                let [over_variance, square] = one(measured[lane], blurred[lane]);
                weighted[lane] += over_variance;
                plain[lane] += square;
            }
        }
        for (measured, blurred) in left.iter().zip(over) {
            let [over_variance, square] = one(*measured, *blurred);
            weighted[0] += over_variance;
            plain[0] += square;
        }
        for (sum, lanes) in self.misfit.iter_mut().zip([weighted, plain]) {
            *sum += f64::from(lanes.iter().sum::<f32>());
        }
    }
}

impl Work for Ratio<'_> {
    fn rows(&self) -> Range<usize> {
        self.out.first..self.out.first + self.out.rows()
    }

    fn sums(&self) -> Sums {
        self.misfit
    }
}

/// Multiplies the estimate by the blurred ratio.
pub(super) struct Update<'a> {
    pub estimate: Band<'a>,
    /// Reciprocal of the measured fraction of each pixel's light; `None` if all light counts as measured.
    pub gain: Option<&'a Plane>,
}

impl Rows for Update<'_> {
    #[inline(always)]
    fn row(&mut self, y: usize, blurred: &[f32]) {
        let out = &mut self.estimate.row(y)[..blurred.len()];
        match self.gain {
            None => out.iter_mut().zip(blurred).for_each(|(v, u)| *v *= u),
            Some(gain) => {
                let gain = &gain.row(y)[..blurred.len()];
                out.iter_mut().zip(blurred).zip(gain).for_each(|((v, u), g)| *v *= u.max(0.0) * g);
            }
        }
    }
}

impl Work for Update<'_> {
    fn rows(&self) -> Range<usize> {
        self.estimate.first..self.estimate.first + self.estimate.rows()
    }

    fn sums(&self) -> Sums {
        [0.0; 2]
    }
}

/// Multiplies an extrapolated estimate, which is kept unchanged, by the blurred ratio.
pub(super) struct Leap<'a> {
    pub from: &'a Plane,
    pub gain: Option<&'a Plane>,
    pub to: Band<'a>,
    /// The previous step, which is overwritten with this one.
    pub step: Band<'a>,
    /// Scalar product of this step with the previous one, and squared norm of the previous one.
    pub products: Sums,
}

impl Rows for Leap<'_> {
    #[inline(always)]
    fn row(&mut self, y: usize, blurred: &[f32]) {
        let n = blurred.len();
        let (from, to, step) = (&self.from.row(y)[..n], &mut self.to.row(y)[..n], &mut self.step.row(y)[..n]);
        match self.gain {
            None => to.iter_mut().zip(blurred).zip(from).for_each(|((to, u), v)| *to = v * u.max(0.0)),
            Some(gain) => {
                let gain = &gain.row(y)[..n];
                for x in 0..n {
                    to[x] = from[x] * blurred[x].max(0.0) * gain[x];
                }
            }
        }
        let (mut across, mut square) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let ((to, to_left), (from, from_left)) = (to.as_chunks::<LANES>(), from.as_chunks::<LANES>());
        let (step, step_left) = step.as_chunks_mut::<LANES>();
        for ((to, from), step) in to.iter().zip(from).zip(step) {
            for lane in 0..LANES {
                let (new, old) = (to[lane] - from[lane], step[lane]);
                step[lane] = new;
                across[lane] += new * old;
                square[lane] += old * old;
            }
        }
        for ((to, from), step) in to_left.iter().zip(from_left).zip(step_left) {
            let (new, old) = (to - from, *step);
            *step = new;
            across[0] += new * old;
            square[0] += old * old;
        }
        self.products[0] += f64::from(across.iter().sum::<f32>());
        self.products[1] += f64::from(square.iter().sum::<f32>());
    }
}

impl Work for Leap<'_> {
    fn rows(&self) -> Range<usize> {
        self.to.first..self.to.first + self.to.rows()
    }

    fn sums(&self) -> Sums {
        self.products
    }
}

/// Reciprocal of the blurred value; 0 where less than 1 % of a pixel's light was measured.
pub(super) struct Inverse<'a>(pub Band<'a>);

impl Rows for Inverse<'_> {
    #[inline(always)]
    fn row(&mut self, y: usize, blurred: &[f32]) {
        let out = self.0.row(y).iter_mut().zip(blurred);
        out.for_each(|(v, b)| *v = if *b > 0.01 { 1.0 / b } else { 0.0 });
    }
}

impl Work for Inverse<'_> {
    fn rows(&self) -> Range<usize> {
        self.0.first..self.0.first + self.0.rows()
    }

    fn sums(&self) -> Sums {
        [0.0; 2]
    }
}
