//! Sums over wavelengths: step and weights.

use super::geometry::Window;
use nacre_base::{Error, Result};
use nacre_optics::color::{Illuminant, Observer};

/// Shortest and longest wavelength in nm, as in the 2014 thesis.
pub const RANGE_NM: [f64; 2] = [380.0, 780.0];

/// Smallest number of wavelengths, ratio to the next finer sum, and largest number.
const FEWEST: usize = 17;
const FINER: f64 = 1.2;
const MOST: usize = 20_000;

/// Evenly spaced wave numbers, and their contributions to X, Y and Z.
pub(super) struct Samples {
    /// Wave numbers `1/λ` in 1/µm.
    pub numbers: Vec<f64>,
    /// Weights; those of Y sum to 1.
    pub weights: Vec<[f64; 3]>,
}

/// Sums of different steps for one illuminant and one observer.
pub(super) struct Wavelengths {
    ladder: Vec<Samples>,
    /// Index of the coarsest sum that is accurate for the illuminant.
    least: usize,
    /// Error of that sum.
    pub color_error: f64,
}

impl Samples {
    fn new(count: usize, light: &Illuminant, observer: Observer) -> Self {
        let [long, short] = [RANGE_NM[1], RANGE_NM[0]].map(|nm| 1e3 / nm);
        let step = (short - long) / (count - 1) as f64;
        let numbers = (0..count).map(|k| long + step * k as f64).collect();
        // dλ = λ² dν.
        Self::of(numbers, |number| 1.0 / (number * number), light, observer)
    }

    /// Samples in even wavelength steps of about `nm` (2014 thesis, Fig. 6.5 and 6.6).
    pub(super) fn in_steps(nm: f64, light: &Illuminant, observer: Observer) -> Self {
        let count = ((RANGE_NM[1] - RANGE_NM[0]) / nm).round().max(1.0);
        let step = (RANGE_NM[1] - RANGE_NM[0]) / count;
        let numbers = (0..=count as usize).map(|k| 1e3 / (RANGE_NM[1] - step * k as f64)).collect();
        Self::of(numbers, |_| 1.0, light, observer)
    }

    /// Trapezoidal rule; `width` is the width of an interval up to a factor.
    fn of(numbers: Vec<f64>, width: impl Fn(f64) -> f64, light: &Illuminant, observer: Observer) -> Self {
        let last = numbers.len() - 1;
        let mut weights: Vec<[f64; 3]> = numbers
            .iter()
            .enumerate()
            .map(|(k, number)| {
                let nm = 1e3 / number;
                let end = if k == 0 || k == last { 0.5 } else { 1.0 };
                let width = end * light.spectrum.at(nm) * width(*number);
                observer.at(nm).map(|c| c * width)
            })
            .collect();
        let white: f64 = weights.iter().map(|w| w[1]).sum();
        weights.iter_mut().for_each(|w| w.iter_mut().for_each(|v| *v /= white.max(f64::MIN_POSITIVE)));
        Self { numbers, weights }
    }

    fn step(&self) -> f64 {
        self.numbers[1] - self.numbers[0]
    }

    /// X, Y and Z of a linearly increasing spectrum, and of a flat one.
    fn moments(&self) -> [f64; 6] {
        let mut all = [0.0; 6];
        for (number, w) in self.numbers.iter().zip(&self.weights) {
            for c in 0..3 {
                all[c] += w[c];
                all[c + 3] += w[c] * (number - 1.3) / 1.3;
            }
        }
        all
    }
}

impl Wavelengths {
    /// Sums for errors below `error`.
    ///
    /// # Errors
    /// `Input` for an illuminant without visible power.
    pub(super) fn new(light: &Illuminant, observer: Observer, finest_step: f64, error: f64) -> Result<Self> {
        let truth = Samples::new(4001, light, observer).moments();
        if truth[1].is_nan() || truth[1] < 0.5 {
            let problem = format!("{} has no light between 380 and 780 nm", light.name);
            return Err(Error::input("illuminant", problem, "give another light"));
        }
        let off =
            |samples: &Samples| samples.moments().iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let (mut ladder, mut least, mut count): (Vec<Samples>, Option<(usize, f64)>, _) = (vec![], None, FEWEST);
        loop {
            let samples = Samples::new(count, light, observer);
            let (step, color_error) = (samples.step(), off(&samples));
            ladder.push(samples);
            let place = ladder.len() - 1;
            if color_error > error {
                // A coarser sum within the error was so by chance.
                least = None;
            } else if least.is_none() {
                least = Some((place, color_error));
            }
            if (least.is_some() && step <= finest_step) || count >= MOST {
                break;
            }
            count = ((count as f64 * FINER) as usize).min(MOST);
        }
        let place = ladder.len() - 1;
        let (least, color_error) = least.unwrap_or((place, off(&ladder[place])));
        Ok(Self { ladder, least, color_error })
    }

    /// Coarsest sum that is accurate for directions with this length of the tangent.
    pub(super) fn of(&self, tangent: f64, window: Window, error: f64) -> &Samples {
        let wanted = window.step(tangent, error);
        let fine = |samples: &&Samples| samples.step() <= wanted;
        let last = self.ladder.len() - 1;
        self.ladder[self.least..].iter().find(fine).unwrap_or(&self.ladder[last])
    }
}
