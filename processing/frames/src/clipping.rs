//! Detection of the value at which photographs clip below the stated white, such as 12-bit data in 16-bit files.

use nacre_image::{Raster, Samples};

/// Maximum number of samples per photograph.
const LOOKED_AT: usize = 1 << 20;

/// Thresholds for clipping at a photograph's largest value. Photographs of uniform surfaces have many pixels of one
/// value, but similarly many of adjacent values.
mod limits {
    /// Minimum fraction of samples at the largest value.
    pub const SHARE: f64 = 0.001;
    /// Minimum ratio of samples at the largest value to those at the next two lower values.
    pub const OVER_NEIGHBOURS: usize = 10;
    /// Minimum value relative to white; photographs below it are black.
    pub const OF_WHITE: f64 = 0.01;
    /// Minimum number of photographs with the same largest value, unless its bits are all ones.
    pub const PHOTOGRAPHS: usize = 2;
}

/// Largest values of photographs that appear clipped.
#[derive(Debug, Default)]
pub struct Clipping {
    /// Value, and fraction of samples with that value.
    peaks: Vec<(u16, f64)>,
    bits: u32,
}

impl Clipping {
    /// Examines one channel of a photograph; floating-point photographs are ignored.
    pub fn observe(&mut self, raster: &Raster, channel: usize) {
        let every = |samples: usize| (samples / raster.channels).div_ceil(LOOKED_AT).max(1) * raster.channels;
        let mut counts = vec![0_usize; 1 << 16];
        match &raster.samples {
            Samples::U8(v) => v.iter().skip(channel).step_by(every(v.len())).for_each(|v| counts[usize::from(*v)] += 1),
            Samples::U16(v) => {
                v.iter().skip(channel).step_by(every(v.len())).for_each(|v| counts[usize::from(*v)] += 1)
            }
            Samples::F32(_) => return,
        }
        self.bits = if matches!(raster.samples, Samples::U8(_)) { 8 } else { 16 };
        let total: usize = counts.iter().sum();
        let mut occupied = (0..counts.len()).rev().filter(|v| counts[*v] > 0);
        let Some(peak) = occupied.next() else { return };
        let below: usize = occupied.take(2).map(|v| counts[v]).sum();
        let share = counts[peak] as f64 / total as f64;
        if share >= limits::SHARE && counts[peak] >= limits::OVER_NEIGHBOURS * below.max(1) {
            self.peaks.push((peak as u16, share));
        }
    }

    /// Value below `white` at which photographs clip, and the largest fraction of clipped samples.
    pub fn level(&self, white: f64) -> Option<(u16, f64)> {
        let (value, _) = *self
            .peaks
            .iter()
            .filter(|(v, _)| (limits::OF_WHITE * white..white).contains(&f64::from(*v)))
            .max_by_key(|(v, _)| *v)?;
        let alike = self.peaks.iter().filter(|(v, _)| *v == value);
        let share = alike.clone().map(|(_, share)| *share).fold(0.0, f64::max);
        // 4095, or 4095 shifted up to 65520.
        let all_ones = |v: u16| v > 0 && (v >> v.trailing_zeros()).wrapping_add(1).is_power_of_two();
        let full = all_ones(value) && u32::from(value).ilog2() >= self.bits / 2;
        (alike.count() >= limits::PHOTOGRAPHS || full).then_some((value, share))
    }

    /// Warning about clipping; `option` is the flag or key that sets white.
    pub fn warning(&self, white: f64, option: &str) -> Option<String> {
        let (value, share) = self.level(white)?;
        Some(format!(
            "up to {:.1} % of the pixels stand at the largest value, {value}, below white ({white}): they look saturated and are used nonetheless; give {option} {value}",
            100.0 * share
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raster(values: impl Iterator<Item = u16>) -> Raster {
        Raster { width: 100, height: 100, channels: 1, samples: Samples::U16(values.take(10_000).collect()) }
    }

    /// A clipped ramp of light with noise.
    fn ramp(scale: u32, clip: u16) -> Raster {
        raster((0..10_000_u32).map(move |i| (i * scale / 100 + (i * 7919) % 13).min(clip.into()) as u16))
    }

    #[test]
    fn clipped_photographs_tell_their_white() {
        for (clip, white) in [(4095, 65_535.0), (1023, 65_535.0), (65_520, 65_535.0), (16_383, 65_535.0)] {
            let mut c = Clipping::default();
            c.observe(&ramp(u32::from(clip) / 50, clip), 0);
            assert_eq!(c.level(white).map(|l| l.0), Some(clip));
            assert_eq!(c.level(clip.into()), None, "white itself");
        }
        // An arbitrary level is accepted if two photographs share it.
        let mut c = Clipping::default();
        c.observe(&ramp(80, 3000), 0);
        assert_eq!(c.level(65_535.0), None);
        c.observe(&ramp(90, 3000), 0);
        assert_eq!(c.level(65_535.0).map(|l| l.0), Some(3000));
        assert!(c.warning(65_535.0, "--white").is_some_and(|w| w.contains("--white 3000")));
    }

    #[test]
    fn even_and_dim_photographs_do_not_clip() {
        let mut c = Clipping::default();
        c.observe(&ramp(30, u16::MAX), 0);
        // Uniform light with noise of a few codes, twice.
        for _ in 0..2 {
            c.observe(&raster((0..10_000_u32).map(|i| (2000 + i % 5) as u16)), 0);
        }
        assert_eq!(c.level(65_535.0), None);
    }
}
