//! Defects: connected regions of significant differences, with area, class and size.

use crate::compare::Differences;
use num_complex::Complex32;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Growth of a region: neighbours belong to it down to this share of the threshold, and no lower than this statistic.
const GROWTH: f32 = 0.6;
const LEAST_GROWTH: f32 = 3.0;

/// Share of the strongest response down to which a pixel is inside the defect: the blur makes its edge cross a half.
const INSIDE: f32 = 0.5;

/// Share of the strongest response of the pixels by which the class is decided.
const CORE: f32 = 0.7;

/// Brightness relative to the reference below which a region is dark: a scratch or dirt.
const DARK: f64 = 0.85;

/// Length over width from which a dark region is a scratch.
const SCRATCH: f64 = 3.5;

/// Degree of polarization relative to the reference below which there is no grating.
const GONE: f64 = 0.5;

/// Change of the polarization across its direction, relative to the change along it, from which the orientation is
/// wrong. The second value applies at a low degree of polarization, to which a rotation by nearly 90° leads, too.
const TURNED: f64 = 0.35;
const TURNED_FAR: f64 = 0.12;

/// Degree of polarization relative to the reference up to which `TURNED_FAR` applies.
const LITTLE: f64 = 0.6;

/// Polarization relative to the reference below which it has turned by more than 45°.
const OPPOSITE: f64 = -0.1;

/// Brightness change, as a logarithm, that explains a region whose polarization is unchanged.
const STAIN: f64 = 0.05;

/// Brightness change, as a logarithm, from which a turn does not explain the region. A grating that is turned reflects
/// as much light as before; one of another period does not.
const ANOTHER: f64 = 0.01;

/// Class of a defect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// No grating where the reference has one, on a surface that is not dark.
    Missing,
    /// A grating of another orientation.
    WrongOrientation,
    /// A grating of another period or depth.
    WrongPeriod,
    /// A dark line.
    Scratch,
    /// A dark or stained area.
    Dirt,
}

impl Class {
    /// All classes.
    pub const ALL: [Self; 5] = [Self::Missing, Self::WrongOrientation, Self::WrongPeriod, Self::Scratch, Self::Dirt];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::WrongOrientation => "wrong_orientation",
            Self::WrongPeriod => "wrong_period",
            Self::Scratch => "scratch",
            Self::Dirt => "dirt",
        }
    }

    /// Name in text.
    pub fn label(self) -> &'static str {
        match self {
            Self::WrongOrientation => "wrong orientation",
            Self::WrongPeriod => "wrong period",
            _ => self.name(),
        }
    }
}

/// A defect, in the frame of the reference.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Defect {
    /// Class.
    pub class: Class,
    /// Centre: column and row of the reference.
    pub at_px: [f64; 2],
    /// Area in pixels.
    pub area_px: f64,
    /// Area in mm²; `None` if the pixel size is unknown.
    pub area_mm2: Option<f64>,
    /// Length and width in pixels: those of the rectangle with the same second moments.
    pub size_px: [f64; 2],
    /// Length and width in mm.
    pub size_mm: Option<[f64; 2]>,
    /// Largest difference in standard deviations.
    pub deviation: f64,
    /// Expected number of such or larger deviations per sheet without defects, for normal noise.
    pub false_alarms: f64,
    /// Mean difference of the orientation in degrees; `None` without a grating.
    pub orientation_deg: Option<f64>,
    /// Degree of polarization relative to the reference.
    pub polarization: f64,
    /// Brightness relative to the reference; `None` if not known.
    pub brightness: Option<f64>,
    /// Period relative to the reference; `None` if not measured.
    pub period: Option<f64>,
}

/// Connected regions above a threshold.
pub struct Regions {
    /// Number of the region of each pixel, from 1; 0 outside.
    pub labels: Vec<u32>,
    /// Defects, in the order of the numbers.
    pub defects: Vec<Defect>,
}

/// Finds regions whose statistic exceeds the threshold somewhere and that have `min_area` pixels or more.
pub fn regions(found: &Differences, threshold: f64, min_area: usize, pixel_um: Option<f64>) -> Regions {
    let high = threshold as f32;
    let low = (GROWTH * high).max(LEAST_GROWTH).min(high);
    let mut labels = vec![0; found.statistic.len()];
    let mut seen = vec![false; found.statistic.len()];
    let mut defects = vec![];
    for start in 0..labels.len() {
        if seen[start] || found.statistic[start] < high {
            continue;
        }
        let pixels = connected(found, start, low, &mut seen);
        if pixels.len() < min_area {
            continue;
        }
        defects.push(described(found, &pixels, pixel_um));
        pixels.iter().for_each(|i| labels[*i] = defects.len() as u32);
    }
    Regions { labels, defects }
}

/// Largest statistic of a region of `min_area` pixels or more, for the training of a threshold.
pub fn largest(found: &Differences, min_area: usize) -> f64 {
    let mut order: Vec<usize> = (0..found.statistic.len()).filter(|i| found.statistic[*i] > LEAST_GROWTH).collect();
    order.sort_by(|a, b| found.statistic[*b].total_cmp(&found.statistic[*a]));
    let mut seen = vec![false; found.statistic.len()];
    for start in order {
        let peak = found.statistic[start];
        let low = (GROWTH * peak).max(LEAST_GROWTH).min(peak);
        let pixels = connected(found, start, low, &mut seen);
        if pixels.len() >= min_area {
            return peak.into();
        }
        pixels.iter().for_each(|i| seen[*i] = false);
    }
    LEAST_GROWTH.into()
}

/// Expected number of pixels of normal noise at or above a deviation, over all quantities.
pub fn expected(found: &Differences, deviation: f64) -> f64 {
    let pixels = found.compared.iter().filter(|c| **c).count() as f64;
    let quantities = 1 + usize::from(!found.light.value.is_empty()) + usize::from(!found.period.value.is_empty());
    pixels * quantities as f64 * (-0.5 * deviation * deviation).exp()
}

fn connected(found: &Differences, start: usize, low: f32, seen: &mut [bool]) -> Vec<usize> {
    let (width, height) = (found.width as i64, found.height as i64);
    let (mut pixels, mut next) = (vec![], vec![start]);
    seen[start] = true;
    while let Some(i) = next.pop() {
        pixels.push(i);
        let (x, y) = (i as i64 % width, i as i64 / width);
        for (u, v) in (-1..=1).flat_map(|v| (-1..=1).map(move |u| (x + u, y + v))) {
            if u < 0 || v < 0 || u >= width || v >= height {
                continue;
            }
            let k = (v * width + u) as usize;
            if !seen[k] && found.statistic[k] >= low {
                seen[k] = true;
                next.push(k);
            }
        }
    }
    pixels
}

/// Change of a pixel that does not depend on the noise: the larger of polarization and brightness.
fn response(found: &Differences, i: usize) -> f32 {
    if found.overexposed[i] {
        return 1.0;
    }
    let change = (found.sample[i] - found.reference[i]).norm();
    let finite = |d: &[f32]| d.get(i).copied().filter(|v| v.is_finite()).map_or(0.0, f32::abs);
    // A factor of e of the brightness counts as much as the whole polarization.
    change.max(finite(&found.light.value).min(1.0)).max(finite(&found.period.value))
}

fn described(found: &Differences, pixels: &[usize], pixel_um: Option<f64>) -> Defect {
    let responses: Vec<f32> = pixels.iter().map(|i| response(found, *i)).collect();
    let top = responses.iter().copied().fold(0.0, f32::max);
    let part = |share: f32| {
        let chosen = pixels.iter().zip(&responses).filter(move |(_, r)| **r >= share * top);
        chosen.map(|(i, _)| *i).collect::<Vec<usize>>()
    };
    let (inside, core) = (part(INSIDE), part(CORE));
    let (at_px, size_px) = extent(&inside, found.width);
    let deviation = pixels.iter().map(|i| f64::from(found.statistic[*i])).fold(0.0, f64::max);
    let means = Means::of(found, &core);
    let mm = pixel_um.map(|um| um / 1000.0);
    Defect {
        class: class(&means, size_px),
        at_px,
        area_px: inside.len() as f64,
        area_mm2: mm.map(|mm| inside.len() as f64 * mm * mm),
        size_px,
        size_mm: mm.map(|mm| size_px.map(|v| v * mm)),
        deviation,
        false_alarms: expected(found, deviation),
        orientation_deg: means.orientation_deg(),
        polarization: means.ratio.norm().into(),
        brightness: means.brightness,
        period: means.period,
    }
}

/// Centre, and length and width of the rectangle with the same second moments.
fn extent(pixels: &[usize], width: usize) -> ([f64; 2], [f64; 2]) {
    let n = pixels.len().max(1) as f64;
    let place = |i: &usize| [(i % width) as f64, (i / width) as f64];
    let sum = pixels.iter().map(place).fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
    let middle = sum.map(|v| v / n);
    // A pixel itself has a variance of 1/12.
    let mut moments = [1.0 / 12.0, 0.0, 1.0 / 12.0];
    for [x, y] in pixels.iter().map(place) {
        let (dx, dy) = (x - middle[0], y - middle[1]);
        moments[0] += dx * dx / n;
        moments[1] += dx * dy / n;
        moments[2] += dy * dy / n;
    }
    let (mean, half) = (0.5 * (moments[0] + moments[2]), 0.5 * (moments[0] - moments[2]));
    let root = half.hypot(moments[1]);
    (middle, [mean + root, mean - root].map(|variance| (12.0 * variance.max(1.0 / 12.0)).sqrt()))
}

/// Means over the core of a region.
struct Means {
    /// Polarization of the sample over that of the reference.
    ratio: Complex32,
    /// Whether the reference has a grating there.
    grating: bool,
    /// Whether most pixels are overexposed in the sample alone.
    overexposed: bool,
    brightness: Option<f64>,
    /// Standard deviation of the logarithm of `brightness`.
    brightness_sigma: f64,
    period: Option<f64>,
    /// Whether the degree of polarization is measured; otherwise it is 0 or 1.
    graded: bool,
    /// Standard deviation of `ratio`.
    sigma: f32,
}

impl Means {
    fn of(found: &Differences, core: &[usize]) -> Self {
        let measured = || core.iter().copied().filter(|i| !found.overexposed[*i]);
        let power: f32 = measured().map(|i| found.reference[i].norm_sqr()).sum();
        let product: Complex32 = measured().map(|i| found.sample[i] * found.reference[i].conj()).sum();
        let noise: f32 = measured().map(|i| found.sigma[i].powi(2)).sum();
        let count = core.len().max(1) as f32;
        let mean = |values: &[f32]| {
            let known: Vec<f64> =
                core.iter().filter_map(|i| values.get(*i)).filter(|v| v.is_finite()).map(|v| f64::from(*v)).collect();
            (!known.is_empty()).then(|| (known.iter().sum::<f64>() / known.len() as f64).exp())
        };
        Self {
            ratio: if power > 0.0 { product / power } else { Complex32::default() },
            overexposed: 2 * measured().count() < core.len(),
            grating: power > 4.0 * noise.max(1e-4 * count),
            brightness: mean(&found.light.value),
            // Errors of neighbours are alike, so a mean is as uncertain as one of them.
            brightness_sigma: mean(&found.light.sigma).map_or(0.0, f64::ln),
            period: mean(&found.period.value),
            graded: !found.light.value.is_empty(),
            sigma: (noise / power.max(1e-12) / count).sqrt(),
        }
    }

    fn orientation_deg(&self) -> Option<f64> {
        let known = self.grating && f64::from(self.ratio.norm()) > 3.0 * f64::from(self.sigma);
        known.then(|| 0.5 * f64::from(self.ratio.arg()).to_degrees())
    }
}

/// Decides by brightness, then orientation, then presence, then period.
fn class(means: &Means, [length, width]: [f64; 2]) -> Class {
    // Bare metal is brighter than any grating.
    if means.overexposed {
        return Class::Missing;
    }
    let mark = if length > SCRATCH * width { Class::Scratch } else { Class::Dirt };
    let change = means.brightness.map_or(0.0, f64::ln);
    // Without a grating, nothing but a mark darkens.
    if change < DARK.ln() || !means.grating && change < -STAIN {
        return mark;
    }
    if !means.grating {
        return if means.ratio.norm() > 0.0 { Class::WrongPeriod } else { Class::Dirt };
    }
    let (along, across) = ((f64::from(means.ratio.re) - 1.0).abs(), f64::from(means.ratio.im).abs());
    let (size, sigma) = (f64::from(means.ratio.norm()), 3.0 * f64::from(means.sigma));
    let another = change.abs() > ANOTHER.max(3.0 * means.brightness_sigma);
    let far = size < LITTLE && across > TURNED_FAR.max(TURNED_FAR * along + sigma);
    let aside = across > TURNED * along + sigma;
    if !another && (far || aside || f64::from(means.ratio.re) < OPPOSITE) {
        return Class::WrongOrientation;
    }
    // Without measured degrees, a lower one is the mean of pixels with and without a grating.
    if size < GONE && !aside || !means.graded && means.period.is_none() {
        return Class::Missing;
    }
    if change < -STAIN.max(along) { mark } else { Class::WrongPeriod }
}
