//! Detection of raw frames of sensors with a filter mosaic.

use nacre_base::statistics::median;
use nacre_image::{Raster, Samples};

/// Side of a tile in blocks of 2 × 2 pixels; texture averages out over a tile, a mosaic does not.
const TILE: usize = 8;

/// Maximum number of tiles along each axis.
const TILES: usize = 40;

/// Thresholds of the detection. The first ratio is 2.2 for a raw frame of a scene with few polarized surfaces, and at
/// most 1 for photographs of rooms, renderings and screens.
mod limits {
    /// Minimum ratio of differences within blocks (means over tiles) to those between adjacent blocks.
    pub const WITHIN_OVER_BETWEEN: f64 = 1.5;
    /// Minimum difference within blocks relative to the mean value, because codes of uniform surfaces are rounded.
    pub const OF_MEAN: f64 = 0.01;
}

/// Filter mosaic of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mosaic {
    /// Polarizers or colours with a period of 2 pixels.
    Every2,
    /// Colours that each cover 2 × 2 polarizers (or 2 × 2 plain pixels), with a period of 4 pixels.
    Every4,
}

/// Mosaic of the sensor that took a photograph; `None` if pixels show no pattern of polarizers or colour filters.
pub fn mosaic(raster: &Raster) -> Option<Mosaic> {
    // Sums over blocks of 2 × 2 pixels cancel the polarizers and keep the colours above them.
    [(2, Mosaic::Every4), (1, Mosaic::Every2)]
        .into_iter()
        .find(|(bin, _)| differs(raster, *bin))
        .map(|(_, found)| found)
}

/// True if sums over `bin` × `bin` pixels differ within blocks of 2 × 2 sums.
fn differs(raster: &Raster, bin: usize) -> bool {
    let [across, down] = [raster.width, raster.height].map(|n| n / (2 * TILE * bin));
    if raster.width % (2 * bin) + raster.height % (2 * bin) > 0 || across == 0 || down == 0 {
        return false;
    }
    let pixel = |x: usize, y: usize| {
        let at = (y * raster.width + x) * raster.channels;
        match &raster.samples {
            Samples::U8(v) => f64::from(v[at]),
            Samples::U16(v) => f64::from(v[at]),
            Samples::F32(v) => f64::from(v[at]),
        }
    };
    let value =
        |x: usize, y: usize| -> f64 { (0..bin * bin).map(|k| pixel(bin * x + k % bin, bin * y + k / bin)).sum() };
    let every = |n: usize| (0..n).step_by(n.div_ceil(TILES));
    let (mut within, mut between, mut level) = ([const { vec![] }; 6], [vec![], vec![]], vec![]);
    for (row, column) in every(down).flat_map(|row| every(across).map(move |column| (row, column))) {
        let mut means = [0.0; 4];
        for block in 0..TILE * TILE {
            let (x, y) = (2 * (column * TILE + block % TILE), 2 * (row * TILE + block / TILE));
            for (k, mean) in means.iter_mut().enumerate() {
                *mean += value(x + k % 2, y + k / 2) / (TILE * TILE) as f64;
            }
            if block % TILE > 0 && block >= TILE {
                between[0].push((value(x, y) - value(x - 2, y)).abs());
                between[1].push((value(x, y) - value(x, y - 2)).abs());
            }
        }
        let pairs = [(0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2)];
        within.iter_mut().zip(pairs).for_each(|(all, (a, b))| all.push((means[a] - means[b]).abs()));
        level.push(means.iter().sum::<f64>() / 4.0);
    }
    let typical = |values: Vec<f64>| median(values).unwrap_or(f64::NAN);
    let largest = |all: Vec<f64>| all.into_iter().fold(0.0, f64::max);
    let within = largest(within.into_iter().map(typical).collect());
    let between = largest(between.into_iter().map(typical).collect());
    within > limits::WITHIN_OVER_BETWEEN * between && within > limits::OF_MEAN * typical(level)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::{Path, PathBuf};

    /// A smooth noisy picture; `kind(x, y)` is the factor of a pixel.
    fn frame(kind: impl Fn(usize, usize) -> f64) -> Raster {
        let value = |i: usize| {
            let (x, y) = (i % 128, i / 128);
            let picture = 2000.0 + 800.0 * (x as f64 / 17.0).sin() + 10.0 * y as f64;
            (picture * kind(x, y)) as u16 + (i * 7919 % 11) as u16
        };
        Raster { width: 128, height: 96, channels: 1, samples: Samples::U16((0..128 * 96).map(value).collect()) }
    }

    #[test]
    fn frames_with_a_mosaic_are_told_from_others() {
        for layout in [[90.0, 45.0, 135.0, 0.0], [0.0, 45.0, 90.0, 135.0], [135.0, 45.0, 0.0, 90.0]] {
            let analyser = |x: usize, y: usize| {
                let angle: f64 = layout[x % 2 + 2 * (y % 2)];
                0.5 + 0.1 * (2.0 * (angle.to_radians() - 0.3)).cos()
            };
            assert_eq!(mosaic(&frame(analyser)), Some(Mosaic::Every2));
            let coloured = |x: usize, y: usize| analyser(x, y) * [0.4, 1.0, 1.0, 0.6][x / 2 % 2 + 2 * (y / 2 % 2)];
            assert_eq!(mosaic(&frame(coloured)), Some(Mosaic::Every4));
        }
        let bayer = |x: usize, y: usize| [0.4, 1.0, 1.0, 0.6][x % 2 + 2 * (y % 2)];
        assert_eq!(mosaic(&frame(bayer)), Some(Mosaic::Every2), "colour filters");
        assert_eq!(mosaic(&frame(|_, _| 1.0)), None, "grey");
        let texture = |x: usize, y: usize| 0.7 + 0.05 * ((x * 31 + y * 17) % 7) as f64;
        assert_eq!(mosaic(&frame(texture)), None, "texture");
    }

    #[test]
    fn a_real_raw_frame_is_recognised_and_other_photographs_are_not() {
        let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
        let data = std::env::var_os("NACRE_TEST_DATA").map_or(default, PathBuf::from);
        let raw = data.join("polarization/imx250mzr/camera_IMX250MZR.png");
        if !raw.is_file() {
            println!("skipped: no test data");
            return;
        }
        assert_eq!(mosaic(&nacre_image::read(&raw).unwrap()), Some(Mosaic::Every2));
        for other in ["polarization/rotating_analyser_630nm/000.png", "hdr/stack_room_exp_2.jpg"] {
            assert_eq!(mosaic(&nacre_image::read(&data.join(other)).unwrap()), None, "{other}");
        }
    }
}
