//! Maps of one sample by several methods, each against the first.

use super::asset::{Kind, Map, Maps};
use nacre_base::statistics::median;
use nacre_base::{Error, Result};
use nacre_image::{Correlation, Field};
use num_complex::Complex32;
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::{FRAC_PI_2, PI};

/// Most maps that are compared.
const MOST: usize = 8;

/// Longest side on which maps are laid over each other at first, in pixels.
const LONGEST: usize = 512;

/// Least part of what the smaller map knows that the other must know as well.
const OVERLAP: f32 = 0.3;

/// Likeness below which maps are hardly of one sample.
const UNLIKE: f64 = 0.5;

/// A difference of so many of its own σ counts as one that σ does not explain.
const BEYOND: f64 = 5.0;

/// How two maps agree where both know something.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Pixels that both know.
    pub pixels: usize,
    /// Median difference to the first: degrees, or parts of the period.
    pub offset: f64,
    /// Median distance from that.
    pub scatter: f64,
    /// Median of the difference over both σ together, over that of a normal distribution: 1 where σ is right and nothing else differs.
    /// None where a σ is missing.
    pub sigmas: Option<f64>,
    /// Part of the pixels that differ by more than five σ.
    pub beyond: Option<f64>,
}

/// A map, and how it agrees with the first.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// Its name.
    pub name: String,
    /// Part of its own pixels that have an orientation or a period.
    pub known: f64,
    /// Median σ of orientations in degrees.
    pub sigma_deg: Option<f64>,
    /// Median σ of periods, over themselves.
    pub sigma_period: Option<f64>,
    /// Pixels to the right and down by which it was moved, in those of the first.
    pub shift_px: [i64; 2],
    /// How alike it is there, 1 for the same.
    pub likeness: f64,
    /// Orientations, if both have them.
    pub orientation: Option<Agreement>,
    /// Periods, if both have them.
    pub period: Option<Agreement>,
}

/// All maps, laid over the first.
pub struct Comparison {
    /// As they lie, all of the first one's size.
    pub maps: Vec<(String, Maps)>,
    /// What each says, the first one too; how those after it agree with it.
    pub compared: Vec<Compared>,
    /// What was in doubt.
    pub warnings: Vec<String>,
}

/// Lays maps over the first, where `align` wants that, and compares.
///
/// # Errors
/// `Input` for fewer than two, or more than eight; for such as have nothing in common.
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

/// Size of a map's pixels in µm, if its header has it.
pub(super) fn pixel_um(maps: &Maps) -> Option<f64> {
    maps.maps.values().find_map(|m| m.attributes.get("pixel_um")?.parse().ok()).filter(|p: &f64| *p > 0.0)
}

/// A map with pixels of the first one's size.
fn scaled(first: &Maps, other: Maps, name: &str, warnings: &mut Vec<String>) -> Result<Maps> {
    let (Some(wanted), Some(own)) = (pixel_um(first), pixel_um(&other)) else {
        if [first.width, first.height] != [other.width, other.height] {
            warnings.push(format!("the size of a pixel is not known in all; those of {name} are taken to be as large"));
        }
        return Ok(other);
    };
    let factor = own / wanted;
    // Less than half a pixel over the whole of it.
    if ((factor - 1.0) * other.width.max(other.height) as f64).abs() < 0.5 {
        return Ok(other);
    }
    other.resampled(factor)
}

/// A field that is alike where maps agree: lines of orientations, or periods about their mean.
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
    // Orientations may be one all over, and still be alike.
    Some(if kind == Kind::Period { field.centered() } else { field })
}

/// Where another map lies on the first, and how alike they are there.
fn placed(first: &Maps, other: &Maps) -> Option<([i64; 2], f64)> {
    let kind = Kind::ALL.into_iter().find(|k| first.maps.contains_key(k) && other.maps.contains_key(k))?;
    let longest = first.width.max(first.height).max(other.width).max(other.height);
    let step = longest.div_ceil(LONGEST);
    let (a, b) = (field(first, kind, step)?, field(other, kind, step)?);
    let all = Correlation::of(&a, &b);
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
    // Between the coarse steps, on some of the pixels.
    let (a, b) = (field(first, kind, 1)?, field(other, kind, 1)?);
    let reach = step as i64;
    let near: Vec<[i64; 2]> = (-reach..=reach)
        .flat_map(|v| (-reach..=reach).map(move |u| [coarse[0] * reach + u, coarse[1] * reach + v]))
        .collect();
    let tried = near.into_par_iter().map(|d| (d, likeness(&a, &b, d, step)));
    tried.max_by(|p, q| p.1.total_cmp(&q.1))
}

/// Likeness of two fields at a shift, from every so manieth pixel along each side.
fn likeness(a: &Field, b: &Field, [dx, dy]: [i64; 2], step: usize) -> f64 {
    let (mut same, mut of_a, mut of_b) = (0.0, 0.0, 0.0);
    for y in (0..b.height).step_by(step) {
        for x in (0..b.width).step_by(step) {
            let [u, v] = [x as i64 + dx, y as i64 + dy];
            if u < 0 || v < 0 || u >= a.width as i64 || v >= a.height as i64 {
                continue;
            }
            let (i, k) = (v as usize * a.width + u as usize, y * b.width + x);
            if a.mask[i] * b.mask[k] > 0.0 {
                same += f64::from((a.values[i] * b.values[k].conj()).re);
                of_a += f64::from(a.values[i].norm_sqr());
                of_b += f64::from(b.values[k].norm_sqr());
            }
        }
    }
    same / (of_a * of_b).sqrt().max(1e-30)
}

/// How a map agrees with another of the same size; none where they have no pixel in common.
fn agreement(first: &Map, other: &Map, kind: Kind) -> Option<Agreement> {
    let both: Vec<usize> = (0..first.value.len()).filter(|i| first.mask[*i] * other.mask[*i] > 0.0).collect();
    // Difference, and σ of it.
    let one = |i: &usize| {
        let [a, b] = [first, other].map(|m| [f64::from(m.value[*i]), f64::from(m.sigma[*i])]);
        match kind {
            Kind::Orientation => [fold(b[0] - a[0]).to_degrees(), a[1].hypot(b[1]).to_degrees()],
            Kind::Period => [b[0] / a[0] - 1.0, (a[1] / a[0]).hypot(b[1] / b[0])],
        }
    };
    let off: Vec<[f64; 2]> = both.iter().map(one).collect();
    // Of angles, about the mean line, so that 90° and -90° are the same.
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

/// A turn the short way around, in rad.
fn fold(turn: f64) -> f64 {
    (turn + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2
}
