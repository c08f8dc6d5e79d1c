//! Conversion of a diffraction photograph to the distribution of orientation and period.

use super::distribution::{Distribution, MAX_BINS};
use super::report::Report;
use nacre_base::statistics::median;
use nacre_base::{Error, Result};
use nacre_image::lobe;
use nacre_optics::geometry::Geometry;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Minimum width of a bin in pixels of the photograph; narrower bins would be dominated by noise and gaps.
const PIXELS_PER_BIN: f64 = 2.0;

/// Quantile of the bins whose light is taken as background.
const DARKEST: f64 = 0.02;

/// Radius of the excluded glare around the zero order, in radii of its lobe.
const GLARE: f64 = 3.0;

/// Distance in pixels between measured and expected zero order above which a warning is issued.
const ASTRAY: f64 = 5.0;

/// Linear light of a photograph; NaN where unknown (saturated).
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` values, top row first.
    pub values: Vec<f32>,
}

/// Measure how orientations and periods of a foil's random dots are distributed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend(
    "x-input" = "The photograph (EXR, or 16-bit PNG or TIFF in linear light), results of `reconstruct hdr`, or a session of exposures, which are merged first",
    "x-examples" = "\
Examples:
  nacre reconstruct foil hdr.exr --geometry geometry.json --depth-um 0.08 --out spiral
  nacre reconstruct foil session --geometry geometry.json --period-um 0.8:1.5 --out spiral
  nacre synthesize spiral --size 1024,1024 --pixel-um 25 --square-px 3 --out new

Takes one photograph of the foil under a flash behind a narrow-band filter, linear and of high dynamic range, and where camera, foil and
light were (nacre calibrate geometry). Writes histogram.exr (share, sigma, coverage), histogram.png and report.json."
))]
#[schemars(rename = "FoilOptions")]
pub struct Settings {
    /// Positions of camera, foil and light (geometry.json; default: the one beside the photograph).
    #[schemars(extend("x-file" = true))]
    pub geometry: Option<Geometry>,
    /// Shortest and longest period in µm (default: from the picture's corners to the zero order's glare).
    #[schemars(extend("x-placeholder" = "MIN:MAX"))]
    pub period_um: Option<[f64; 2]>,
    /// Bins of orientation and of period (default: as fine as pixels allow).
    #[schemars(extend("x-advanced" = true, "x-placeholder" = "NxM"))]
    pub bins: Option<[usize; 2]>,
    /// Peak-to-peak depth of the sinusoidal gratings in µm: corrects for efficiencies and for second and third orders.
    ///
    /// Without it, gratings count as shallow, and all light as first orders.
    pub depth_um: Option<f64>,
    /// Height of the light above the foil in mm, for a geometry without a light: its position follows from the zero
    /// order.
    pub light_height_mm: Option<f64>,
}

impl Settings {
    /// Validates the options.
    ///
    /// # Errors
    /// `Input`, naming the option.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, problem: String, remedy: &str| Err(Error::input(what, problem, remedy));
        match self.period_um {
            Some([a, b]) if !(a >= 0.1 && a < b && b <= 100.0) => {
                return bad("period-um", format!("is {a} to {b}"), "give the shortest and the longest, 0.1 to 100 µm");
            }
            _ => {}
        }
        match self.bins {
            Some(bins) if !bins.iter().all(|n| (4..=MAX_BINS).contains(n)) => {
                return bad("bins", format!("are {bins:?}"), "give 4 to 2048 of both");
            }
            _ => {}
        }
        match self.depth_um {
            Some(um) if !(0.001..=2.0).contains(&um) => {
                return bad("depth-um", format!("is {um}"), "give 0.001 to 2 µm");
            }
            _ => {}
        }
        match self.light_height_mm {
            Some(mm) if !(0.1..=1e5).contains(&mm) => {
                bad("light-height-mm", format!("is {mm}"), "give 0.1 to 100000 mm")
            }
            _ => Ok(()),
        }
    }
}

/// Measurement of one pixel.
#[derive(Clone, Copy)]
struct Sample {
    /// Half vector ωi + ωo along the surface.
    half: [f64; 2],
    /// Area of the pixel in half-vector space.
    area: f64,
    /// cos θi + cos θo.
    w: f64,
    /// Light, corrected for cosine and inverse-square falloff.
    light: f64,
}

/// Sums of a bin over both signs of the half vector.
#[derive(Clone, Copy, Default)]
struct Bin {
    area: f64,
    light: f64,
    square: f64,
    w: f64,
    pixels: f64,
}

/// Measures the distribution.
///
/// # Errors
/// `Input` for an incomplete geometry, and for photographs without a diffraction pattern.
pub fn measure(light: &Light, geometry: &Geometry, settings: &Settings) -> Result<(Distribution, Report)> {
    settings.check()?;
    let mut report = Report { relative: geometry.relative, ..Report::default() };
    let nm = geometry.wavelength_nm.ok_or_else(|| {
        Error::input("geometry", "has no wavelength", "add one: `nacre calibrate geometry … --wavelength NM`")
    })?;
    let lambda = nm / 1000.0;
    let (source, glare) = zero_order(light, geometry, settings, &mut report)?;
    let samples = samples(light, geometry, source);
    let frame = frame(&samples, settings, lambda, glare)?;
    let mut bins = vec![Bin::default(); frame.orientations * frame.periods];
    for s in &samples {
        let lines = s.half[0].hypot(s.half[1]) / lambda;
        if let Some(at) = frame.bin(s.half[1].atan2(s.half[0]), 1.0 / lines) {
            let bin = &mut bins[at];
            bin.area += s.area;
            bin.light += s.area * s.light;
            bin.square += s.area * s.light * s.light;
            bin.w += s.area * s.w;
            bin.pixels += 1.0;
        }
    }
    let density = density(&bins, &frame, settings, lambda, &mut report);
    let distribution = shares(frame, &bins, &density, geometry.relative, &mut report)?;
    judge(&distribution, settings, &mut report);
    Ok((distribution, report))
}

/// Position of the light, verified against the zero order or derived from it, and the half-vector radius of the glare.
fn zero_order(light: &Light, geometry: &Geometry, settings: &Settings, report: &mut Report) -> Result<([f64; 3], f64)> {
    let found = lobe::find(&light.values, light.width, light.height, None);
    let source = match (geometry.light_mm, settings.light_height_mm, &found) {
        (Some(light), ..) => light,
        (None, Some(height), Ok(lobe)) => {
            let seen = geometry.point(lobe.center).ok_or_else(|| lobe::not_found("does not lie on the sample"))?;
            let viewer = geometry.viewer();
            let share = height / viewer[2];
            let along = |k: usize| seen[k] + share * (seen[k] - viewer[k]);
            [along(0), along(1), height]
        }
        (None, Some(_), Err(problem)) => return Err(lobe::not_found(problem)),
        (None, None, _) => {
            let remedy = "add one (`nacre calibrate geometry … --highlight …`), or say --light-height-mm";
            return Err(Error::input("geometry", "has no light", remedy));
        }
    };
    let expected = mirror(geometry, source);
    match (&found, expected) {
        (Ok(lobe), Some([x, y])) => {
            let off = (lobe.center[0] - x).hypot(lobe.center[1] - y);
            report.zero_order_px = Some(lobe.center);
            report.zero_order_off_px = Some(off);
            if off > ASTRAY {
                let words = "the zero order lies {off} px from where the geometry has it: periods are off accordingly";
                report.warnings.push(words.replace("{off}", &format!("{off:.1}")));
            }
        }
        (Err(problem), _) => report
            .warnings
            .push(format!("the zero order was not found, so that the light's place is not checked: {problem}")),
        (Ok(_), None) => report.warnings.push("the zero order does not lie on the sample".into()),
    }
    // Radius in half vectors, from the pixels at its rim.
    let place = found.as_ref().ok().map(|l| l.center).or(expected);
    let radius = found.as_ref().map_or(4.0, |l| (l.radius() as f64).max(2.0));
    let glare = place.map_or(0.0, |[x, y]| {
        let half = |p: [f64; 2]| geometry.point(p).map(|at| geometry.half(at, source)).map(|h| h[0].hypot(h[1]));
        let reach = GLARE * radius;
        [[x + reach, y], [x - reach, y], [x, y + reach], [x, y - reach]]
            .into_iter()
            .filter_map(half)
            .fold(0.0, f64::max)
    });
    Ok((source, glare))
}

/// Pixel of the light's mirror image.
fn mirror(geometry: &Geometry, source: [f64; 3]) -> Option<[f64; 2]> {
    let viewer = geometry.viewer();
    let share = viewer[2] / (viewer[2] + source[2]);
    geometry.pixel([viewer[0] + share * (source[0] - viewer[0]), viewer[1] + share * (source[1] - viewer[1]), 0.0])
}

fn samples(light: &Light, geometry: &Geometry, source: [f64; 3]) -> Vec<Sample> {
    let viewer = geometry.viewer();
    let one = |i: usize| -> Option<Sample> {
        let value = f64::from(light.values[i]);
        if !value.is_finite() {
            return None;
        }
        let (x, y) = ((i % light.width) as f64, (i / light.width) as f64);
        let half = |x: f64, y: f64| geometry.point([x, y]).map(|p| geometry.half(p, source));
        let place = geometry.point([x, y])?;
        let [a, b, c, d] = [half(x - 0.5, y)?, half(x + 0.5, y)?, half(x, y - 0.5)?, half(x, y + 0.5)?];
        let area = ((b[0] - a[0]) * (d[1] - c[1]) - (b[1] - a[1]) * (d[0] - c[0])).abs();
        let distance = |to: [f64; 3]| ((to[0] - place[0]).powi(2) + (to[1] - place[1]).powi(2) + to[2] * to[2]).sqrt();
        let (near, far) = (distance(source), distance(viewer));
        let cos = source[2] / near;
        Some(Sample {
            half: geometry.half(place, source),
            area,
            w: cos + viewer[2] / far,
            light: value * near * near / cos,
        })
    };
    (0..light.values.len()).into_par_iter().filter_map(one).collect()
}

/// The bins, as fine as the pixels allow.
fn frame(samples: &[Sample], settings: &Settings, lambda: f64, glare: f64) -> Result<Distribution> {
    let reach = samples.iter().map(|s| s.half[0].hypot(s.half[1])).fold(0.0, f64::max);
    let [low, high] = settings.period_um.map_or([glare / lambda, reach / lambda], |[a, b]| [1.0 / b, 1.0 / a]);
    let low = low.max(0.02);
    if low >= high || samples.is_empty() {
        let problem = format!("shows {:.2} lines per µm at most", reach / lambda);
        return Err(Error::input("photograph", problem, "take it from nearer, or with the light nearer to the sample"));
    }
    let mean = samples.iter().map(|s| s.area).sum::<f64>() / samples.len() as f64;
    let step = PIXELS_PER_BIN * mean.sqrt() / lambda;
    let [orientations, periods] = settings.bins.unwrap_or([
        ((PI * 0.5 * (low + high) / step) as usize).clamp(18, 360),
        (((high - low) / step) as usize).clamp(8, 256),
    ]);
    let count = orientations * periods;
    Ok(Distribution {
        orientations,
        periods,
        lines_per_um: [low, high],
        share: vec![0.0; count],
        sigma: vec![f64::NAN; count],
        coverage: vec![0.0; count],
        relative: false,
    })
}

/// Efficiency of order n of a sinusoidal grating at w = cos θi + cos θo (2018 paper, Eq. 2, exact: Jn²).
fn order(n: i32, depth_um: f64, w: f64, lambda: f64) -> f64 {
    libm::jn(n, PI * w * depth_um / lambda).powi(2)
}

/// Relative density of first orders over half vectors, by bin; NaN for bins without pixels.
fn density(bins: &[Bin], frame: &Distribution, settings: &Settings, lambda: f64, report: &mut Report) -> Vec<f64> {
    let raw: Vec<f64> = bins.iter().map(|b| if b.pixels > 0.0 { b.light / b.area } else { f64::NAN }).collect();
    let mut sorted: Vec<f64> = raw.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let background = sorted.get((DARKEST * sorted.len() as f64) as usize).copied().unwrap_or(0.0);
    let top = sorted.last().copied().unwrap_or(0.0);
    report.background = if top > 0.0 { background / top } else { 0.0 };
    let mut density = vec![f64::NAN; raw.len()];
    // In order of increasing line density, so that second and third orders of coarser gratings can be subtracted.
    for row in 0..frame.periods {
        let lines = 0.5 * (frame.edge(row) + frame.edge(row + 1));
        for column in 0..frame.orientations {
            let at = row * frame.orientations + column;
            if raw[at].is_nan() {
                continue;
            }
            let w = bins[at].w / bins[at].area;
            let light = raw[at] - background;
            density[at] = match settings.depth_um {
                None => light / (0.25 * w * w),
                Some(depth) => {
                    let higher: f64 = (2..=3)
                        .map(|n| {
                            let below = between(&density, frame, lines / f64::from(n), column);
                            order(n, depth, w, lambda) * below / f64::from(n * n)
                        })
                        .sum();
                    (light - higher) / order(1, depth, w, lambda)
                }
            };
        }
    }
    density
}

/// Density interpolated between rows; 0 where unknown.
fn between(density: &[f64], frame: &Distribution, lines: f64, column: usize) -> f64 {
    let [low, high] = frame.lines_per_um;
    let place = (lines - low) / (high - low) * frame.periods as f64 - 0.5;
    if place < -0.5 {
        return 0.0;
    }
    let at = |row: f64| {
        let row = row.clamp(0.0, (frame.periods - 1) as f64) as usize;
        let value = density[row * frame.orientations + column];
        if value.is_nan() { 0.0 } else { value.max(0.0) }
    };
    let share = place - place.floor();
    at(place.floor()) * (1.0 - share) + at(place.floor() + 1.0) * share
}

/// Normalises the density to shares that sum to 1.
fn shares(
    mut frame: Distribution,
    bins: &[Bin],
    density: &[f64],
    relative: bool,
    report: &mut Report,
) -> Result<Distribution> {
    frame.relative = relative;
    let mut sum = 0.0;
    for row in 0..frame.periods {
        let (a, b) = (frame.edge(row), frame.edge(row + 1));
        let area = 0.5 * (b * b - a * a);
        for at in row * frame.orientations..(row + 1) * frame.orientations {
            let bin = &bins[at];
            if density[at].is_nan() {
                continue;
            }
            frame.coverage[at] = 1.0;
            frame.share[at] = density[at].max(0.0) * area;
            sum += frame.share[at];
            let raw = bin.light / bin.area;
            let scatter = (bin.square / bin.area - raw * raw).max(0.0).sqrt() / bin.pixels.sqrt();
            // The scatter of a bin is undefined for a single pixel.
            frame.sigma[at] = if bin.pixels > 1.0 && raw != 0.0 { scatter / raw * frame.share[at] } else { f64::NAN };
        }
    }
    if !(sum > 0.0 && sum.is_finite()) {
        let remedy = "check that the photograph shows the pattern of one narrow band, and the range of periods";
        return Err(Error::input("photograph", "holds no diffracted light in that range", remedy));
    }
    frame.share.iter_mut().chain(&mut frame.sigma).for_each(|s| *s /= sum);
    report.bins = [frame.orientations, frame.periods];
    report.lines_per_um = frame.lines_per_um;
    report.period_um = frame.period_um();
    report.covered = frame.coverage.iter().sum::<f64>() / frame.coverage.len() as f64;
    Ok(frame)
}

/// Adds warnings about the limits of the measurement.
fn judge(found: &Distribution, settings: &Settings, report: &mut Report) {
    let rows = found.of_periods();
    let median = median(rows.clone()).unwrap_or(0.0);
    let top = rows.iter().copied().fold(0.0, f64::max);
    let unseen = 1.0 - report.covered;
    if unseen > 0.01 {
        report
            .warnings
            .push(format!("{:.0} % of the bins are not in the photograph: shares there are unknown", 100.0 * unseen));
    }
    if rows.last().is_some_and(|last| *last > 0.2 * top && *last > 2.0 * median) {
        report.warnings.push("the pattern goes on beyond the photograph: shorter periods are missing".into());
    }
    let [low, high] = found.lines_per_um;
    if settings.depth_um.is_none() && high > 2.0 * low {
        let words = "second orders count as first ones of half the period: say --depth-um, or a range below one octave with --period-um";
        report.warnings.push(words.into());
    }
    if found.relative {
        report.warnings.push("periods are relative: the geometry is not calibrated".into());
    }
}
