//! Comparison of maps of one sample from several methods with the first of them.

use super::asset::{Kind, Map, Maps};
use nacre_base::statistics::median;
use nacre_base::{Error, Result};
use nacre_image::{Correlation, Field};
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::{FRAC_PI_2, PI};

/// Maximum number of maps.
const MOST: usize = 8;

/// Longest side in pixels of the maps used for coarse registration.
const LONGEST: usize = 512;

/// Minimum overlap, as a fraction of the smaller map's known pixels.
const OVERLAP: f32 = 0.3;

/// Correlation below which a warning doubts that the maps show one sample.
const UNLIKE: f64 = 0.5;

/// Difference in standard deviations above which a pixel counts as inconsistent.
const BEYOND: f64 = 5.0;

/// Agreement of two maps where both are defined.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Number of pixels defined in both maps.
    pub pixels: usize,
    /// Median difference from the first map: degrees, or fraction of the period.
    pub offset: f64,
    /// Median absolute deviation from `offset`.
    pub scatter: f64,
    /// Median of the difference over the combined σ, relative to its value for a normal distribution: 1 if σ describes
    /// all differences. `None` if a σ is missing.
    pub sigmas: Option<f64>,
    /// Fraction of the pixels that differ by more than five σ.
    pub beyond: Option<f64>,
}

/// A map, and its agreement with the first map.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// Name of the map.
    pub name: String,
    /// Fraction of its pixels with an orientation or a period.
    pub known: f64,
    /// Median σ of orientations in degrees.
    pub sigma_deg: Option<f64>,
    /// Median relative σ of periods.
    pub sigma_period: Option<f64>,
    /// Shift to the right and down by registration, in pixels of the first map.
    pub shift_px: [i64; 2],
    /// Correlation with the first map after the shift; 1 for identical maps.
    pub likeness: f64,
    /// Agreement of orientations, if both maps have them.
    pub orientation: Option<Agreement>,
    /// Agreement of periods, if both maps have them.
    pub period: Option<Agreement>,
}

/// All maps, registered to the first.
pub struct Comparison {
    /// Registered maps, all of the first one's size.
    pub maps: Vec<(String, Maps)>,
    /// Statistics of each map, including the first, and its agreement with the first.
    pub compared: Vec<Compared>,
    /// Warnings about scale and registration.
    pub warnings: Vec<String>,
}

/// Registers maps to the first, if `align` is set, and compares them.
///
/// # Errors
/// `Input` for fewer than two or more than eight maps, and for maps without common pixels.
pub fn compare(all: Vec<(String, Maps)>, align: bool) -> Result<Comparison> {
    if !(2..=MOST).contains(&all.len()) {
        let problem = format!("are {}", all.len());
        return Err(Error::input("maps to be compared", problem, format!("give 2 to {MOST}")));
    }
    let mut rest = all.into_iter();
    let Some((first_name, first)) = rest.next() else { return Err(Error::input("maps", "are none", "give two")) };
    let (mut maps, mut compared, mut warnings) = (vec![(first_name.clone(), first.clone())], vec![], vec![]);
    compared.push(described(&first_name, &first));
    for (name, other) in rest {
        let mut found = described(&name, &other);
        let scaled = scaled(&first, other, &name, &mut warnings)?;
        if align {
            (found.shift_px, found.likeness) = placed(&first, &scaled).ok_or_else(|| {
                let remedy = "give maps of the same part of one sample, both with orientations or both with periods";
                Error::input(&name, format!("has nothing in common with {first_name}"), remedy)
            })?;
            if found.likeness < UNLIKE {
                warnings.push(format!(
                    "{name} is hardly like {first_name} wherever it is laid ({:.0} % alike)",
                    100.0 * found.likeness
                ));
            }
        }
        let moved = scaled.moved(found.shift_px, [first.width, first.height])?;
        let agree = |kind| Some(agreement(first.maps.get(&kind)?, moved.maps.get(&kind)?, kind)).flatten();
        (found.orientation, found.period) = (agree(Kind::Orientation), agree(Kind::Period));
        compared.push(found);
        maps.push((name, moved));
    }
    Ok(Comparison { maps, compared, warnings })
}

fn described(name: &str, maps: &Maps) -> Compared {
    let sigma = |kind: Kind| {
        let map = maps.maps.get(&kind)?;
        let of = |i: usize| {
            let sigma = f64::from(map.sigma[i]);
            if kind == Kind::Period { sigma / f64::from(map.value[i]) } else { sigma.to_degrees() }
        };
        median(
            (0..map.value.len()).filter(|i| map.mask[*i] > 0.0).map(of).filter(|s| s.is_finite()).collect::<Vec<_>>(),
        )
    };
    let known = maps.maps.values().map(Map::known).max().unwrap_or(0) as f64 / (maps.width * maps.height) as f64;
    Compared {
        name: name.to_owned(),
        known,
        sigma_deg: sigma(Kind::Orientation),
        sigma_period: sigma(Kind::Period),
        shift_px: [0, 0],
        likeness: 1.0,
        orientation: None,
        period: None,
    }
}

/// Pixel size in µm, if the map's header states it.
pub(super) fn pixel_um(maps: &Maps) -> Option<f64> {
    maps.maps.values().find_map(|m| m.attributes.get("pixel_um")?.parse().ok()).filter(|p: &f64| *p > 0.0)
}

/// Resamples a map to the pixel size of the first.
fn scaled(first: &Maps, other: Maps, name: &str, warnings: &mut Vec<String>) -> Result<Maps> {
    let (Some(wanted), Some(own)) = (pixel_um(first), pixel_um(&other)) else {
        if [first.width, first.height] != [other.width, other.height] {
            warnings.push(format!("the size of a pixel is not known in all; those of {name} are taken to be as large"));
        }
        return Ok(other);
    };
    let factor = own / wanted;
    // The sizes differ by less than half a pixel over the whole map.
    if ((factor - 1.0) * other.width.max(other.height) as f64).abs() < 0.5 {
        return Ok(other);
    }
    other.resampled(factor)
}

/// Complex field whose correlation measures agreement: doubled orientation angles, or periods minus their mean.
fn field(maps: &Maps, kind: Kind, step: usize) -> Option<Field> {
    let map = maps.maps.get(&kind)?;
    let (width, height) = (maps.width.div_ceil(step), maps.height.div_ceil(step));
    let from = |i: usize| (i / width * step) * maps.width + i % width * step;
    let value = |i: usize| {
        let (v, m) = (map.value[from(i)], map.mask[from(i)]);
        match kind {
            _ if m == 0.0 => Complex32::default(),
            Kind::Orientation => Complex32::from_polar(1.0, 2.0 * v),
            Kind::Period => Complex32::new(v, 0.0),
        }
    };
    let count = width * height;
    let mask: Vec<f32> = (0..count).map(|i| map.mask[from(i)]).collect();
    let field = Field { width, height, values: (0..count).map(value).collect(), mask };
    // The mean of orientations is kept, since uniform orientations can agree, too.
    Some(if kind == Kind::Period { field.centered() } else { field })
}

/// Shift of another map on the first, and their correlation there.
fn placed(first: &Maps, other: &Maps) -> Option<([i64; 2], f64)> {
    let kind = Kind::ALL.into_iter().find(|k| first.maps.contains_key(k) && other.maps.contains_key(k))?;
    let longest = first.width.max(first.height).max(other.width).max(other.height);
    let step = longest.div_ceil(LONGEST);
    let (a, b) = (field(first, kind, step)?, field(other, kind, step)?);
    // Orientations have an unknown common offset, which turns the phase of the sum.
    let orientations = kind == Kind::Orientation;
    let all = if orientations { Correlation::of_any_phase(&a, &b) } else { Correlation::of(&a, &b) };
    let enough = OVERLAP * a.mask.iter().sum::<f32>().min(b.mask.iter().sum::<f32>());
    if enough < 4.0 {
        return None;
    }
    let range = |m: usize, n: usize| -(n as i64) + 1..m as i64;
    let shifts = range(a.height, b.height).flat_map(|y| range(a.width, b.width).map(move |x| [x, y]));
    let good = shifts.filter(|d| all.overlap(*d) >= enough);
    let coarse = good.max_by(|p, q| all.at(*p).total_cmp(&all.at(*q)))?;
    if step == 1 {
        return Some((coarse, f64::from(all.at(coarse))));
    }
    // Refinement between the coarse steps, on a subset of the pixels.
    let (a, b) = (field(first, kind, 1)?, field(other, kind, 1)?);
    let reach = step as i64;
    let near: Vec<[i64; 2]> = (-reach..=reach)
        .flat_map(|v| (-reach..=reach).map(move |u| [coarse[0] * reach + u, coarse[1] * reach + v]))
        .collect();
    let tried = near.into_par_iter().map(|d| (d, likeness(&a, &b, d, step, orientations)));
    tried.max_by(|p, q| p.1.total_cmp(&q.1))
}

/// Correlation of two fields at a shift, from every `step`-th pixel along each axis.
fn likeness(a: &Field, b: &Field, [dx, dy]: [i64; 2], step: usize, any_phase: bool) -> f64 {
    let (mut same, mut of_a, mut of_b) = (Complex64::default(), 0.0, 0.0);
    for y in (0..b.height).step_by(step) {
        for x in (0..b.width).step_by(step) {
            let [u, v] = [x as i64 + dx, y as i64 + dy];
            if u < 0 || v < 0 || u >= a.width as i64 || v >= a.height as i64 {
                continue;
            }
            let (i, k) = (v as usize * a.width + u as usize, y * b.width + x);
            if a.mask[i] * b.mask[k] > 0.0 {
                let product = a.values[i] * b.values[k].conj();
                same += Complex64::new(product.re.into(), product.im.into());
                of_a += f64::from(a.values[i].norm_sqr());
                of_b += f64::from(b.values[k].norm_sqr());
            }
        }
    }
    let same = if any_phase { same.norm() } else { same.re };
    same / (of_a * of_b).sqrt().max(1e-30)
}

/// Agreement of two maps of the same size; `None` without common pixels.
fn agreement(first: &Map, other: &Map, kind: Kind) -> Option<Agreement> {
    let both: Vec<usize> = (0..first.value.len()).filter(|i| first.mask[*i] * other.mask[*i] > 0.0).collect();
    // Difference and its σ.
    let one = |i: &usize| {
        let [a, b] = [first, other].map(|m| [f64::from(m.value[*i]), f64::from(m.sigma[*i])]);
        match kind {
            Kind::Orientation => [fold(b[0] - a[0]).to_degrees(), a[1].hypot(b[1]).to_degrees()],
            Kind::Period => [b[0] / a[0] - 1.0, (a[1] / a[0]).hypot(b[1] / b[0])],
        }
    };
    let off: Vec<[f64; 2]> = both.iter().map(one).collect();
    // Differences are taken about the circular mean, because 90° and -90° are the same orientation.
    let about = if kind == Kind::Orientation {
        let sum = off.iter().fold([0.0; 2], |s, d| {
            let (sin, cos) = (2.0 * d[0].to_radians()).sin_cos();
            [s[0] + cos, s[1] + sin]
        });
        (0.5 * sum[1].atan2(sum[0])).to_degrees()
    } else {
        0.0
    };
    let from = |d: f64| if kind == Kind::Orientation { fold((d - about).to_radians()).to_degrees() } else { d };
    let offset = about + median(off.iter().map(|d| from(d[0])).collect::<Vec<_>>())?;
    let left =
        |d: f64| if kind == Kind::Orientation { fold((d - offset).to_radians()).to_degrees() } else { d - offset };
    let scatter = median(off.iter().map(|d| left(d[0]).abs()).collect::<Vec<_>>())?;
    let sigmas: Vec<f64> = off.iter().map(|[d, s]| d.abs() / s).filter(|z| z.is_finite()).collect();
    let beyond = sigmas.iter().filter(|z| **z > BEYOND).count() as f64 / sigmas.len().max(1) as f64;
    let beyond = (!sigmas.is_empty()).then_some(beyond);
    // Half of a normal distribution lies within 0.6745 σ.
    let sigmas = median(sigmas).map(|z| z / 0.6745);
    Some(Agreement { pixels: both.len(), offset, scatter, sigmas, beyond })
}

/// Angle difference modulo half a turn, in rad.
fn fold(turn: f64) -> f64 {
    (turn + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2
}
