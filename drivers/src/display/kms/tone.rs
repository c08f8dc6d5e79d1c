//! Tone curve of a display: luminance of each code.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Tone curve of a display.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Tone {
    /// Luminance is the code to this power.
    Gamma(f64),
    /// Luminances measured at equidistant codes from black to white, in any unit, strictly increasing.
    Measured(Vec<f64>),
}

impl Default for Tone {
    fn default() -> Self {
        Self::Gamma(2.2)
    }
}

impl Tone {
    /// Checks the curve.
    ///
    /// # Errors
    /// The valid values.
    pub fn check(&self) -> Result<(), String> {
        match self {
            Self::Gamma(gamma) if (0.2..=5.0).contains(gamma) => Ok(()),
            Self::Gamma(gamma) => Err(format!("tone.gamma is {gamma}; give 0.2 to 5, usually 2.2")),
            Self::Measured(levels) => {
                let sane = (2..=1024).contains(&levels.len()) && levels.iter().all(|l| l.is_finite() && *l >= 0.0);
                let rising = levels.windows(2).all(|pair| pair[0] < pair[1]);
                if sane && rising { Ok(()) } else { Err("tone.measured must be 2 to 1024 rising luminances".into()) }
            }
        }
    }

    /// Luminance of a code: 0 for black, 1 for white.
    pub fn luminance(&self, code: u8) -> f64 {
        let part = f64::from(code) / 255.0;
        match self {
            Self::Gamma(gamma) => part.powf(*gamma),
            Self::Measured(levels) => {
                let [Some(black), Some(white)] = [levels.first(), levels.last()] else { return part };
                let place = part * (levels.len() - 1) as f64;
                let below = (place as usize).min(levels.len().saturating_sub(2));
                let level = |i: usize| levels.get(i).copied().unwrap_or(*white);
                let here = level(below) + (place - below as f64) * (level(below + 1) - level(below));
                (here - black) / (white - black)
            }
        }
    }

    /// Codes closest to `steps` + 1 equidistant luminances from black to white.
    pub fn codes(&self, steps: usize) -> Vec<u8> {
        self.nearest((0..=steps).map(|i| i as f64 / steps.max(1) as f64))
    }

    /// Codes closest to these luminances in [0, 1].
    pub fn nearest(&self, wanted: impl IntoIterator<Item = f64>) -> Vec<u8> {
        let luminances: Vec<f64> = (0..=255).map(|code| self.luminance(code)).collect();
        let nearest = |wanted: f64| {
            let above = luminances.partition_point(|l| *l < wanted).min(255);
            let below = above.saturating_sub(1);
            if wanted - luminances[below] < luminances[above] - wanted { below } else { above }
        };
        wanted.into_iter().map(|l| u8::try_from(nearest(l)).unwrap_or(u8::MAX)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn luminance_is_linear_in_the_requested_value() {
        let measured = Tone::Measured((0..=17).map(|i| 0.3 + 250.0 * (f64::from(i) / 17.0).powf(2.4)).collect());
        for tone in [Tone::Gamma(2.2), Tone::Gamma(1.0), measured] {
            tone.check().unwrap();
            for (i, code) in tone.codes(64).into_iter().enumerate() {
                let wanted = i as f64 / 64.0;
                assert!((tone.luminance(code) - wanted).abs() < 0.006, "{tone:?}: {wanted}");
            }
            assert_eq!((tone.codes(4)[0], tone.codes(4)[4]), (0, 255));
            let all: Vec<u8> = (0..=255).collect();
            assert_eq!(tone.nearest(all.iter().map(|code| tone.luminance(*code))), all);
        }
    }

    #[test]
    fn curves_that_are_none_are_refused() {
        for bad in [vec![], vec![1.0], vec![0.0, 2.0, 1.0], vec![0.0, f64::NAN], vec![0.0; 2000]] {
            assert!(Tone::Measured(bad).check().is_err());
        }
        assert!(Tone::Gamma(f64::NAN).check().is_err() && Tone::Gamma(0.0).check().is_err());
    }

    proptest! {
        #[test]
        fn no_curve_is_too_wild(levels: Vec<f64>, steps in 0usize..70) {
            let tone = Tone::Measured(levels);
            prop_assert_eq!(tone.codes(steps).len(), steps + 1);
        }
    }
}
