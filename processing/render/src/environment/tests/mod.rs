mod job;
mod map;
mod methods;
mod passes;
mod real;
mod reference;

use super::{Environment, Table};

/// Hash of a number, 0 to 1.
pub fn random(i: usize) -> f64 {
    let mut x = (i as u64).wrapping_add(0x9e37_79b9_7f4a_7c15).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A sky, a floor, and several lamps of a few degrees.
pub fn room(width: usize) -> Environment {
    let height = width / 2;
    let blank = Environment::of(width, height, vec![[0.0; 3]; width * height]).unwrap();
    let lamp = |k: usize| {
        let (z, azimuth) = (1.6 * random(3 * k) - 0.6, std::f64::consts::TAU * random(3 * k + 1));
        let across = (1.0_f64 - z * z).sqrt();
        [across * azimuth.cos(), across * azimuth.sin(), z]
    };
    let lamps: Vec<[f64; 3]> = (0..12).map(lamp).collect();
    let pixel = |i: usize| {
        let d = blank.direction((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let mut sum = if d[2] > 0.0 { [0.3, 0.4, 0.6] } else { [0.2, 0.15, 0.1] };
        for (k, l) in lamps.iter().enumerate() {
            let off = 1.0 - (d[0] * l[0] + d[1] * l[1] + d[2] * l[2]);
            let bright = 60.0 * (-off / 0.0015).exp();
            (0..3).for_each(|c| sum[c] += bright * (0.5 + random(100 + 3 * k + c)));
        }
        sum.map(|v| v as f32)
    };
    Environment::of(width, height, (0..width * height).map(pixel).collect()).unwrap()
}

/// Spots of three colours on a lattice of two directions (radians), with a specular lobe at the centre.
pub fn lattice(size: usize, extent: f64, directions: [f64; 2], spacing: f64, width: f64) -> Table {
    let axes = directions.map(|a: f64| [a.cos(), a.sin()]);
    Table::from_fn(size, extent, |h| {
        let mut sum = [0.0; 3];
        for (c, stretch) in [1.15, 1.0, 0.85].iter().enumerate() {
            for m in -3..=3_i32 {
                for n in -3..=3_i32 {
                    let place: [f64; 2] = std::array::from_fn(|k| {
                        spacing * stretch * (f64::from(m) * axes[0][k] + f64::from(n) * axes[1][k])
                    });
                    let off = ((h[0] - place[0]).powi(2) + (h[1] - place[1]).powi(2)) / (width * width);
                    sum[c] += (-0.7 * f64::from(m.abs() + n.abs())).exp() * (-0.5 * off).exp();
                }
            }
        }
        sum
    })
    .unwrap()
}
