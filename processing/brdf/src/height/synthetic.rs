//! Synthetic height fields with exactly known shapes.

use super::{HeightField, check_size};
use nacre_base::{Error, Result};
use std::f64::consts::TAU;

/// Cross-section of a grating over one period, with heights from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// `(1 + cos)/2`.
    Sinusoid,
    /// Linear rise along the grating vector, then a vertical fall.
    Blazed,
    /// 1 over a fraction of the period, 0 over the rest.
    Rectangular {
        /// Duty cycle, 0 to 1.
        duty: f64,
    },
}

impl Profile {
    /// Relative height, 0 to 1, at a position of `t` periods.
    pub fn at(self, t: f64) -> f64 {
        match self {
            Self::Sinusoid => 0.5 + 0.5 * (TAU * t).cos(),
            Self::Blazed => t.rem_euclid(1.0),
            Self::Rectangular { duty } => f64::from(u8::from(t.rem_euclid(1.0) < duty)),
        }
    }
}

/// Synthetic surface.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Synthetic {
    /// Shape of the surface.
    pub shape: Shape,
    /// Pixels per side.
    pub pixels: usize,
    /// Pixel pitch in µm.
    pub pixel_um: f64,
    /// Period in µm.
    pub period_um: f64,
    /// Peak-to-peak depth in µm.
    pub depth_um: f64,
    /// Direction of the grating vector, anticlockwise from the right, in rad.
    pub angle: f64,
}

/// Shape of a synthetic surface.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// Grating.
    Grating(Profile),
    /// Compact disc: straight tracks one period apart. Pits are 0.5 µm wide; lengths of pits and gaps are 3 to 11 times
    /// 0.3 µm, from a fixed pseudorandom sequence.
    Cd,
    /// Two gratings in the left and right half; the second period is 8 % longer and rotated by 6°.
    TwoRegions,
    /// Rows of fingers as on a snake's scale: a wave with pointed crests along the grating vector. Its phase changes by
    /// half a period between rows and varies by a tenth.
    Fingers,
}

impl Synthetic {
    /// Computes the height field. Only a period that divides the side gives a whole number of periods.
    ///
    /// # Errors
    /// `Input` for values out of range.
    pub fn field(&self) -> Result<HeightField> {
        check_size("surface", self.pixels, self.pixels)?;
        for (what, value, most) in [("period", self.period_um, 1e4), ("depth", self.depth_um, 100.0)] {
            if !(value > 0.0 && value <= most) {
                return Err(Error::input(what, format!("is {value} µm"), format!("give above 0, at most {most}")));
            }
        }
        let half = 0.5 * (self.pixels as f64 - 1.0);
        let at = |k: usize| {
            let x = ((k % self.pixels) as f64 - half) * self.pixel_um;
            let y = (half - (k / self.pixels) as f64) * self.pixel_um;
            self.depth_um * self.relative(x, y)
        };
        let um = (0..self.pixels * self.pixels).map(at).collect();
        HeightField::new("surface", self.pixels, self.pixels, self.pixel_um, um)
    }

    /// Relative height (0 to 1) at a position in µm from the centre, y up.
    fn relative(&self, x: f64, y: f64) -> f64 {
        let (sin, cos) = self.angle.sin_cos();
        let (along, across) = (x * cos + y * sin, y * cos - x * sin);
        let t = along / self.period_um;
        match self.shape {
            Shape::Grating(profile) => profile.at(t),
            Shape::Cd => 1.0 - f64::from(u8::from(self.is_pit(t, across))),
            Shape::TwoRegions if x < 0.0 => Profile::Sinusoid.at(t),
            Shape::TwoRegions => {
                let (sin, cos) = (self.angle + 6_f64.to_radians()).sin_cos();
                Profile::Sinusoid.at((x * cos + y * sin) / (1.08 * self.period_um))
            }
            Shape::Fingers => {
                let length = 4.0 * self.period_um;
                let row = (across / length).floor();
                let wander = 0.1 * (TAU * noise(row as i64)).sin();
                let phase = if row.rem_euclid(2.0) < 1.0 { 0.0 } else { 0.5 };
                let crest = Profile::Sinusoid.at(t + phase + wander);
                let end = (across / length).rem_euclid(1.0);
                // Thicker at the root, pointed at the tip.
                (crest.powf(1.0 + 2.0 * end) + 0.3 * (1.0 - end)) / 1.3
            }
        }
    }

    /// Whether there is a pit at `t` tracks and a position in µm along the track.
    fn is_pit(&self, t: f64, along: f64) -> bool {
        let track = t.round();
        if (t - track).abs() * self.period_um > 0.25 {
            return false;
        }
        // Starts before every patch, with runs of 3 to 11 channel bits.
        let mut place = -0.5 * self.pixels as f64 * self.pixel_um * std::f64::consts::SQRT_2 - 3.3;
        let mut k = (track as i64).wrapping_mul(1 << 20);
        while place <= along {
            place += 0.3 * (3.0 + (9.0 * noise(k)).floor());
            k += 1;
        }
        k.rem_euclid(2) == 1
    }
}

/// Pseudorandom number from 0 to 1 (SplitMix64).
fn noise(k: i64) -> f64 {
    let mut z = (k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}
