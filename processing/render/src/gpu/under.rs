//! Textures of environment lighting. All positions of a flat sample share one frame, so the reflection of tables and
//! bases depends on the direction of view only. Tables use the exact correlation ([`planar`]), the base the processor's
//! samples. On other shapes the shaders sample light at random.

use super::alias::draws;
use super::repeating::Cells;
use super::texture::Texture;
use crate::environment::{self, Frame, planar};
use crate::light::Sky;
use crate::light::viewer::RANGE;
use crate::material::diffraction::Diffraction;
use crate::material::diffraction::table::Table;
use crate::material::shading::{Above, Place, add};
use crate::material::texture::Over;
use crate::material::{Base, Material};
use crate::shape::Form;
use crate::vector::V3;
use nacre_base::random::Stream;
use nacre_optics::color::linear_srgb;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Maximum number of sines of view along a side for a table; the memory of the correlation grows with their square.
const VIEWS: usize = 512;

/// Samples of the base over all directions of view.
const SAMPLES: usize = 1 << 20;

/// Number of wave numbers of the sky's colours.
const NUMBERS: usize = 256;

/// Largest evaluated sine of view.
const RIM: f64 = 0.999;

/// Placeholder textures for scenes without an environment.
pub(super) fn none() -> Vec<Texture> {
    ["sky", "sky_colors", "under_top", "under_base"].map(|name| Texture::none(name, 4)).to_vec()
}

/// The textures of an environment over a sample seen from a point, and of the sampling of a height field's frequencies;
/// or the reason why shaders do not support it.
pub(super) fn all(
    sky: &Sky,
    material: &Material,
    (form, from): (&Form, V3),
    frequencies: Option<Cells>,
) -> Result<Vec<Texture>, String> {
    let [_, _, mut top, mut base] = none().try_into().map_err(|_| "report this")?;
    if let Form::Flat { center, frame, .. } = form {
        let side = if (from - center).dot(&frame[2]) < 0.0 { -1.0 } else { 1.0 };
        let frame = [frame[0], frame[1], frame[2] * side];
        if let Some(Diffraction::Table(of)) = &material.diffraction {
            top = table(of, sky, &frame)?;
        }
        if let Some(of) = &material.base {
            base = self::base(of, material, sky, &frame);
        }
    } else if let Some(Diffraction::Table(of)) = &material.diffraction {
        top = cells(of);
    }
    let top = frequencies.map_or(top, |cells| cells.texture);
    Ok(vec![picture(sky), colors(sky), top, base])
}

/// The sky with its sampling density. Below it, per pixel, the alias table: own share and alternative pixel (Walker
/// 1977).
fn picture(sky: &Sky) -> Texture {
    let (width, height) = (sky.map.width, sky.map.height);
    let middle = |k: usize| {
        let (polar, azimuth) =
            (PI * ((k / width) as f64 + 0.5) / height as f64, TAU * (0.5 - ((k % width) as f64 + 0.5) / width as f64));
        [polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()]
    };
    let density: Vec<f64> = (0..width * height).into_par_iter().map(|k| sky.map.density(middle(k))).collect();
    // Share of all draws, times the number of pixels.
    let edge = |y: usize| (PI * y as f64 / height as f64).cos();
    let angle = |k: usize| (edge(k / width) - edge(k / width + 1)) * TAU / width as f64;
    let shares = density.iter().enumerate().map(|(k, d)| d * angle(k) * (width * height) as f64).collect();
    let light = sky.map.rgb.iter().zip(&density);
    let light =
        light.flat_map(|(rgb, d)| rgb.map(|v| (f64::from(v) * sky.strength) as f32).into_iter().chain([*d as f32]));
    let draws = draws(shares)
        .into_iter()
        .flat_map(|(share, other)| [share as f32, (other % width) as f32, (other / width) as f32, 0.0]);
    Texture::new("sky", width, 4, light.chain(draws).collect())
}

/// X, Y, Z per wave number of red, green and blue, one row each.
fn colors(sky: &Sky) -> Texture {
    let number = |k: usize| RANGE[0] + (RANGE[1] - RANGE[0]) * k as f64 / (NUMBERS - 1) as f64;
    let row = |c: usize| (0..NUMBERS).map(move |k| sky.upsampling.at(number(k))[c]);
    let texel = |[x, y, z]: [f64; 3]| [x as f32, y as f32, z as f32, 0.0];
    Texture::new("sky_colors", NUMBERS, 4, (0..3).flat_map(row).flat_map(texel).collect())
}

/// A texture over the sines of view at the centres of `size · size` cells; beyond the rim it continues the rim's
/// values.
fn over_views(name: &'static str, size: usize, value: impl Fn(usize, [f64; 3]) -> [f64; 3] + Sync) -> Texture {
    let at = |k: usize| (2 * k + 1) as f64 / size as f64 - 1.0;
    let texel = |i: usize| {
        let [x, y] = [at(i % size), at(i / size)];
        let shrink = (RIM / x.hypot(y)).min(1.0);
        let [x, y] = [x * shrink, y * shrink];
        let [r, g, b] = value(i, [x, y, (1.0 - x * x - y * y).sqrt()]);
        [r as f32, g as f32, b as f32, 0.0]
    };
    let texels: Vec<[f32; 4]> = (0..size * size).into_par_iter().map(texel).collect();
    Texture::new(name, size, 4, texels.into_flattened())
}

/// Alias table of a lookup table's cells: own share of draws, alternative cell, and density over half vectors.
fn cells(of: &Table) -> Texture {
    let (side, shares) = of.shares();
    let per_area = (side as f64 / (2.0 * of.extent)).powi(2);
    let density: Vec<f64> = shares.iter().map(|share| share * per_area).collect();
    let even = (side * side) as f64;
    let draws = draws(shares.iter().map(|share| share * even).collect());
    let texel = |((share, other), density): ((f64, usize), f64)| {
        [share as f32, (other % side) as f32, (other / side) as f32, density as f32]
    };
    Texture::new("under_top", side, 4, draws.into_iter().zip(density).flat_map(texel).collect())
}

fn table(of: &Table, sky: &Sky, frame: &[V3; 3]) -> Result<Texture, String> {
    // Twice the resolution of the table and the sky.
    let size = ((2.0 * of.size as f64 / of.extent) as usize).max(2 * sky.map.height).clamp(64, VIEWS);
    let [tangent, bitangent, normal] = frame.map(|v| sky.frame.map(|axis| axis.dot(&v)));
    let even = environment::Table::from_fn(of.size, of.extent, |h| of.raw(h));
    let found = even.and_then(|even| planar(&even, &sky.map, &Frame { tangent, bitangent, normal }, size));
    let found = found.map_err(|error| error.to_string())?;
    // The first row of the reflection is the uppermost. Outside the disc it is dark, so values beyond the last whole
    // cell are replaced by that cell.
    let inner = 1.0 - 2.0 / size as f64;
    Ok(over_views("under_top", size, |_, [x, y, _]| {
        let shrink = (inner / x.hypot(y)).min(1.0);
        let [x, y] = [x * shrink, y * shrink];
        let cell = |v: f64| ((0.5 * (v + 1.0) * size as f64) as usize).min(size - 1);
        let (column, row) = (cell(x), cell(y));
        let [u, v] = [column, row].map(|k| (2 * k + 1) as f64 / size as f64 - 1.0);
        let view = [u, v, (1.0 - u * u - v * v).max(0.0).sqrt()];
        let (rgb, whole) = (found.rgb[(size - 1 - row) * size + column], of.whole(view));
        [0, 1, 2].map(|c| f64::from(rgb[c]) * view[2] * of.scale * sky.strength / whole[c])
    }))
}

/// Reflection of a material's base and, in as many further rows, its reflection through the diffracting layer.
fn base(of: &Base, material: &Material, sky: &Sky, frame: &[V3; 3]) -> Texture {
    // Six cells per angular width of the roughness.
    let alpha = if let Over::Same([alpha]) = &of.roughness { *alpha } else { 1.0 };
    let size = ((6.0 / alpha) as usize).clamp(24, 192);
    let count = SAMPLES / (size * size);
    let above = Above { sky, frame, open: &|_| true, summed: None };
    let seen = |share: &(dyn Fn([f64; 2]) -> f64 + Sync)| {
        over_views("under_base", size, |i, view| {
            let place = Place { uv: [0.5; 2], view };
            let mut sum = [0.0; 3];
            for k in 0..count {
                let part = of.under(&place, &above, &mut Stream::new(i, k), |light| share([view[2], light]));
                add(&mut sum, part, 1.0 / count as f64);
            }
            linear_srgb(sum.map(|v| v as f32)).map(f64::from)
        })
    };
    let mut base = seen(&|_| 1.0);
    if material.through([1.0; 2]).is_some() {
        base.values.extend(seen(&|cosines| material.through(cosines).unwrap_or(0.0)).values);
        base.height *= 2;
    }
    base
}
