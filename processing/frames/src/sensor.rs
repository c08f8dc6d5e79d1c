//! Tells raw frames of a polarization sensor from other photographs.

use nacre_base::statistics::median;
use nacre_image::{Raster, Samples};

/// Blocks that are looked at, along a side.
const BLOCKS: usize = 200;

/// In a raw frame, pixels of a block differ by polarization, more than a pixel differs from the like one of the next block.
const BLOCK_OVER_NEIGHBOUR: f64 = 3.0;

/// Crossed pairs of a block have one sum: their difference is smaller than that of the pixels by this factor. It tells a polarization
/// sensor from a colour mosaic.
const PAIRS_AGREE: f64 = 3.0;

/// The layout that a photograph shows if it is a raw frame of a polarization sensor, but for a turn; `None` for other photographs, and for
/// frames of scenes with little polarization.
pub fn sensor_layout(raster: &Raster) -> Option<&'static str> {
    let (w, h) = (raster.width / 2, raster.height / 2);
    if raster.width % 2 + raster.height % 2 > 0 || w < 3 || h < 3 {
        return None;
    }
    let value = |x: usize, y: usize| {
        let at = (y * raster.width + x) * raster.channels;
        match &raster.samples {
            Samples::U8(v) => f64::from(v[at]),
            Samples::U16(v) => f64::from(v[at]),
            Samples::F32(v) => f64::from(v[at]),
        }
    };
    let steps = [w, h].map(|n| (n / BLOCKS).max(1));
    let places: Vec<[usize; 2]> = (0..h - 1)
        .step_by(steps[1])
        .flat_map(|y| (0..w - 1).step_by(steps[0]).map(move |x| [2 * x, 2 * y]))
        .filter(|[x, y]| value(*x, *y).is_finite())
        .collect();
    let typical = |of: &dyn Fn(usize, usize) -> f64| {
        median(places.iter().map(|[x, y]| of(*x, *y).abs()).collect::<Vec<_>>()).unwrap_or(f64::NAN)
    };
    let block = |x: usize, y: usize| [value(x, y), value(x + 1, y), value(x, y + 1), value(x + 1, y + 1)];
    let neighbour = typical(&|x, y| value(x, y) - value(x + 2, y)).max(typical(&|x, y| value(x, y) - value(x, y + 2)));
    let pairings = [([0, 3, 1, 2], "90,45,135,0"), ([0, 1, 2, 3], "0,90,45,135"), ([0, 2, 1, 3], "0,45,90,135")];
    pairings.into_iter().find_map(|([a, b, c, d], name)| {
        let pick = |f: fn([f64; 4]) -> f64| typical(&|x, y| f([a, b, c, d].map(|i| block(x, y)[i])));
        let crossed = pick(|[a, b, _, _]| a - b).max(pick(|[_, _, c, d]| c - d));
        let sums = pick(|[a, b, c, d]| a + b - c - d);
        // Rows or columns that differ as a whole have two equal differences.
        let unlike = pick(|[a, b, c, d]| a - b - c + d).min(pick(|[a, b, c, d]| a - b + c - d));
        let crossed = crossed.min(unlike);
        (crossed > BLOCK_OVER_NEIGHBOUR * neighbour && crossed > PAIRS_AGREE * sums).then_some(name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `kind(x, y)` gives the factor of a pixel on a smooth picture with noise.
    fn frame(kind: impl Fn(usize, usize) -> f64) -> Raster {
        let value = |i: usize| {
            let (x, y) = (i % 120, i / 120);
            let picture = 2000.0 + 800.0 * (x as f64 / 17.0).sin() + 10.0 * y as f64;
            (picture * kind(x, y)) as u16 + (i * 7919 % 11) as u16
        };
        Raster { width: 120, height: 90, channels: 1, samples: Samples::U16((0..120 * 90).map(value).collect()) }
    }

    #[test]
    fn only_frames_of_polarization_sensors_are_taken_for_them() {
        for (layout, name) in [
            ([90.0, 45.0, 135.0, 0.0], "90,45,135,0"),
            ([0.0, 45.0, 90.0, 135.0], "0,45,90,135"),
            ([135.0, 45.0, 0.0, 90.0], "0,90,45,135"),
        ] {
            let analyser = |x: usize, y: usize| {
                let angle: f64 = layout[x % 2 + 2 * (y % 2)];
                0.5 + 0.15 * (2.0 * (angle.to_radians() - 0.3)).cos()
            };
            assert_eq!(sensor_layout(&frame(analyser)), Some(name));
        }
        assert_eq!(sensor_layout(&frame(|_, _| 1.0)), None, "grey");
        let bayer = |x: usize, y: usize| [0.4, 1.0, 1.0, 0.6][x % 2 + 2 * (y % 2)];
        assert_eq!(sensor_layout(&frame(bayer)), None, "a colour mosaic");
        assert_eq!(sensor_layout(&frame(|_, y| 0.5 + 0.4 * (y % 2) as f64)), None, "interlaced rows");
    }
}
