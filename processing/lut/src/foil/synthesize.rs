//! Synthesis of dot maps with orientations and periods drawn from a distribution.

use super::compare::total_variation;
use super::distribution::Distribution;
use nacre_base::estimate::Work;
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use nacre_maps::{Kind, Map, Maps};
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Maximum number of pixels of a map.
const MOST_PIXELS: usize = 64 << 20;

/// Maximum number of dots.
const MAX_DOTS: usize = 16 << 20;

/// Total area of randomly placed dots, relative to the area of the map.
const OVER: f64 = 4.0;

/// Dot shape.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Adjacent squares with this side in pixels.
    Square(usize),
    /// Randomly placed discs with this diameter in pixels; later ones cover earlier ones.
    Disc(f64),
    /// Any shape, randomly placed: width, and membership of each pixel, row by row.
    Mask(usize, Vec<bool>),
}

/// Parameters of the synthesis.
#[derive(Clone, Debug, PartialEq)]
pub struct Dots {
    /// Width and height of the map in pixels.
    pub size: [usize; 2],
    /// Size of a pixel in µm.
    pub pixel_um: f64,
    /// Shape of a dot.
    pub shape: Shape,
    /// Random seed; the same seed gives the same map.
    pub seed: u64,
}

impl Dots {
    /// Predicted time, memory and disk space. Memory is measured at 4 and 16 Mpixel (32 bytes per pixel) and rounded
    /// up.
    ///
    /// # Errors
    /// `Input` for invalid sizes and shapes.
    pub fn work(&self) -> Result<Work> {
        check(self)?;
        let pixels = self.size[0].saturating_mul(self.size[1]);
        Ok(Work {
            operation: "synthesize".into(),
            seconds: 0.03 + 0.1e-6 * pixels as f64,
            memory_bytes: 36_u64.saturating_mul(pixels as u64),
            disk_bytes: 26_u64.saturating_mul(pixels as u64),
            ..Work::default()
        })
    }
}

/// Synthesized maps, and their agreement with the distribution.
#[derive(Clone, Debug, PartialEq)]
pub struct Synthesis {
    /// Orientations and periods; σ is 0, because values are prescribed, not measured.
    pub maps: Maps,
    /// Statistics of the synthesis.
    pub report: Made,
}

/// Statistics of a synthesis.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Made {
    /// Number of drawn dots.
    pub dots: usize,
    /// Total variation distance between distribution and map, by area: orientation, and period.
    pub total_variation: [f64; 2],
    /// Expected total variation for this number of dots.
    pub expected: [f64; 2],
    /// Fraction of the map without a dot.
    pub bare: f64,
    /// Limitations of the result.
    pub warnings: Vec<String>,
}

/// Synthesizes maps.
///
/// Dots are drawn at equal steps of the cumulative distribution and then shuffled: marginals deviate less than with
/// independent draws.
///
/// # Errors
/// `Input` for invalid sizes and shapes.
pub fn synthesize(from: &Distribution, dots: &Dots) -> Result<Synthesis> {
    check(dots)?;
    let [width, height] = dots.size;
    let mut random = Stream::of(dots.seed ^ 0x5bf0_3635);
    let (owner, count) = placed(dots, &mut random);
    let drawn = draw(from, count, &mut random);
    let mut planes = [vec![f32::NAN; width * height], vec![f32::NAN; width * height]];
    let mut found = vec![0.0; from.share.len()];
    let mut covered = 0.0;
    for (i, owner) in owner.iter().enumerate() {
        let Some([theta, um]) = owner.checked_sub(1).map(|k| drawn[k as usize]) else { continue };
        (planes[0][i], planes[1][i]) = (theta as f32, um as f32);
        covered += 1.0;
        if let Some(bin) = from.bin(theta, um) {
            found[bin] += 1.0;
        }
    }
    found.iter_mut().for_each(|f| *f /= f64::max(covered, 1.0));
    let realized = Distribution { share: found, ..from.clone() };
    let tv = [
        total_variation(&from.of_orientations(), &realized.of_orientations()),
        total_variation(&from.of_periods(), &realized.of_periods()),
    ];
    let bare = 1.0 - covered / (width * height) as f64;
    let mut warnings = vec![];
    // Partly covered dots count with their visible area.
    let expected = [from.of_orientations(), from.of_periods()].map(|m| noise(&m, count as f64));
    if tv.iter().any(|t| *t > 0.05) {
        warnings.push(format!(
            "{count} dots are too few: shares are {:.0} % off; make the map larger or dots smaller",
            100.0 * tv[0].max(tv[1])
        ));
    }
    if from.relative {
        warnings.push("periods are relative: the photograph's geometry was not calibrated".into());
    }
    let maps = maps(dots, planes, from.relative);
    Ok(Synthesis { maps, report: Made { dots: count, total_variation: tv, expected, bare, warnings } })
}

/// Mean total variation of `dots` independent draws.
fn noise(shares: &[f64], dots: f64) -> f64 {
    0.5 * shares.iter().map(|s| (2.0 * s * (1.0 - s) / (PI * dots)).max(0.0).sqrt()).sum::<f64>()
}

fn check(dots: &Dots) -> Result<()> {
    let bad = |what: &str, problem: String, remedy: &str| Err(Error::input(what, problem, remedy));
    let [w, h] = dots.size;
    if w == 0 || h == 0 || w.saturating_mul(h) > MOST_PIXELS || w.max(h) > 65_535 {
        return bad("size", format!("is {w} × {h}"), "give at most 64 Mpixel, and 65535 along a side");
    }
    if !(1e-3..=1e5).contains(&dots.pixel_um) {
        return bad("pixel-um", format!("is {}", dots.pixel_um), "give 0.001 to 100000 µm");
    }
    match &dots.shape {
        Shape::Square(side) if !(1..=4096).contains(side) => {
            bad("dot.square", format!("is {side} px"), "give 1 to 4096 px")
        }
        Shape::Disc(d) if !(1.0..=4096.0).contains(d) => bad("dot.disc", format!("is {d} px"), "give 1 to 4096 px"),
        Shape::Mask(wide, pixels)
            if *wide == 0 || pixels.len() % wide != 0 || !pixels.contains(&true) || pixels.len() > 1 << 24 =>
        {
            bad(
                "dot.mask",
                "has no pixel that is lit".into(),
                "give a picture of a dot, white on black, of at most 16 Mpixel",
            )
        }
        _ => Ok(()),
    }
}

/// Index of the dot at each pixel, from 1 (0: none), and number of visible dots.
fn placed(dots: &Dots, random: &mut Stream) -> (Vec<u32>, usize) {
    let [width, height] = dots.size;
    if let Shape::Square(side) = dots.shape {
        let across = width.div_ceil(side);
        let owner = (0..width * height).map(|i| (i / width / side * across + i % width / side + 1) as u32).collect();
        return (owner, across * height.div_ceil(side));
    }
    let (wide, pixels) = match &dots.shape {
        Shape::Mask(wide, pixels) => (*wide, pixels.clone()),
        Shape::Disc(diameter) => {
            let n = diameter.ceil() as usize;
            let off = |k: usize| k as f64 - 0.5 * (n as f64 - 1.0);
            (n, (0..n * n).map(|i| off(i % n).hypot(off(i / n)) <= 0.5 * diameter).collect())
        }
        Shape::Square(_) => (1, vec![true]),
    };
    let area = pixels.iter().filter(|p| **p).count();
    let count = ((OVER * (width * height) as f64 / area as f64).ceil() as usize).clamp(1, MAX_DOTS);
    let mut owner = vec![0; width * height];
    for dot in 1..=count {
        // Dots wrap around the borders, so that the map is tileable.
        let (left, top) = (random.below(width), random.below(height));
        for (k, _) in pixels.iter().enumerate().filter(|(_, lit)| **lit) {
            let (x, y) = ((left + k % wide) % width, (top + k / wide) % height);
            owner[y * width + x] = dot as u32;
        }
    }
    // Only visible dots are numbered, because only they are drawn.
    let mut number = vec![0_u32; count + 1];
    let mut seen = 0;
    for o in owner.iter_mut().filter(|o| **o > 0) {
        let new = &mut number[*o as usize];
        if *new == 0 {
            seen += 1;
            *new = seen;
        }
        *o = *new;
    }
    (owner, seen as usize)
}

/// Orientations (rad) and periods (µm) in random order.
fn draw(from: &Distribution, count: usize, random: &mut Stream) -> Vec<[f64; 2]> {
    let mut drawn = Vec::with_capacity(count);
    let (mut bin, mut sum) = (0, from.share[0]);
    let start = random.next();
    for k in 0..count {
        let at = (k as f64 + start) / count as f64;
        while at >= sum && bin + 1 < from.share.len() {
            bin += 1;
            sum += from.share[bin];
        }
        // Rounding at the end of the cumulative distribution must not select an empty bin.
        let bin = if from.share[bin] > 0.0 { bin } else { from.share.iter().rposition(|s| *s > 0.0).unwrap_or(bin) };
        let theta = PI * ((bin % from.orientations) as f64 + random.next()) / from.orientations as f64;
        // Uniform in half vectors within the bin.
        let (a, b) = (from.edge(bin / from.orientations), from.edge(bin / from.orientations + 1));
        let lines = (a * a + random.next() * (b * b - a * a)).sqrt();
        drawn.push([theta, 1.0 / lines]);
    }
    for k in (1..count).rev() {
        drawn.swap(k, random.below(k + 1));
    }
    drawn
}

fn maps(dots: &Dots, [theta, um]: [Vec<f32>; 2], relative: bool) -> Maps {
    let map = |value: Vec<f32>, units: &str| {
        let mask: Vec<f32> = value.iter().map(|v| f32::from(u8::from(v.is_finite()))).collect();
        let sigma = mask.iter().map(|m| if *m > 0.0 { 0.0 } else { f32::NAN }).collect();
        let mut attributes = BTreeMap::from([
            ("units".to_owned(), units.to_owned()),
            ("pixel_um".to_owned(), dots.pixel_um.to_string()),
            ("made".to_owned(), "drawn from a measured distribution".to_owned()),
        ]);
        if relative {
            attributes.insert("periods".into(), "relative".into());
        }
        Map { value, sigma, mask, more: BTreeMap::new(), attributes }
    };
    let all = [(Kind::Orientation, map(theta, "rad")), (Kind::Period, map(um, "µm"))];
    Maps { width: dots.size[0], height: dots.size[1], maps: all.into() }
}
