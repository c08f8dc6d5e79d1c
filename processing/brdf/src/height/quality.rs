//! Quality of a height field for the computation of diffraction.

use super::HeightField;
use super::grating::{Grating, MANY};
use crate::transform::Plan;
use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::PI;

/// Largest number of listed peaks, and their smallest power relative to the strongest.
const PEAKS: usize = 6;
const WEAKEST: f64 = 0.02;

/// Ratio of a seam's step to the largest step inside, above which the seam is reported.
const SEAM: f64 = 1.25;

/// Height differences below this fraction of the range are rounding errors.
const ROUNDED: f64 = 1e-9;

/// Deviation from a whole number of periods of a single grating that interpolation between frequencies tolerates.
const CYCLES: f64 = 0.08;

/// Smallest reported tilt: a slope of 0.002 rotates the mirror direction by 0.23°.
const TILT: f64 = 0.002;

/// Peak of the spatial spectrum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Peak {
    /// Period in µm.
    pub period_um: f64,
    /// Half the difference of two periods that a patch of this size can resolve, in µm.
    pub resolution_um: f64,
    /// Direction of the grating vector in degrees, anticlockwise from the right, 0 to 180.
    pub direction_deg: f64,
    /// Fraction of the height variance.
    pub share: f64,
}

/// Contents of a height field, and its quality for diffraction.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Quality {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Pixel pitch in µm.
    pub pixel_um: f64,
    /// Width and height in µm.
    pub size_um: [f64; 2],
    /// Height range: highest minus lowest point, in µm.
    pub range_um: f64,
    /// Standard deviation of the heights in µm.
    pub rms_um: f64,
    /// Root mean square slope between neighbours.
    pub rms_slope: f64,
    /// Slopes to the right and up of the best-fitting plane.
    pub tilt: [f64; 2],
    /// Peaks of the spatial spectrum, strongest first.
    pub periods: Vec<Peak>,
    /// Grating of which the patch is a part, if there is only one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grating: Option<Grating>,
    /// Steps (or changes of slope) from the last to the first column and row, relative to the largest between
    /// neighbours inside. Above 1.25 the repeated patch has visible seams.
    pub seams: [f64; 2],
    /// Shortest wavelength in nm whose orders the pitch can carry, over all viewing directions at normal incidence.
    pub shortest_nm: f64,
    /// Height resolution of the file in µm.
    pub step_um: Option<f64>,
    /// Notes on reading the file: format, channel, encoding.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Warnings about the patch.
    pub warnings: Vec<String>,
}

impl Quality {
    /// Analyses a height field; `coherence_um` is the width of the coherence window (four standard deviations).
    pub fn of(field: &HeightField, coherence_um: f64) -> Self {
        let count = field.um.len() as f64;
        let mean = field.um.iter().sum::<f64>() / count;
        let seams = seams(field);
        let grating = Grating::find(field, seams.iter().all(|s| *s <= SEAM));
        let rms_um = (field.um.iter().map(|h| (h - mean).powi(2)).sum::<f64>() / count).sqrt();
        let mut this = Self {
            width: field.width,
            height: field.height,
            pixel_um: field.pixel_um,
            size_um: field.size_um(),
            range_um: field.range_um(),
            rms_um,
            rms_slope: rms_slope(field),
            tilt: field.tilt(),
            periods: with_grating(periods(field), grating, field),
            grating,
            seams,
            shortest_nm: 2e3 * field.pixel_um,
            step_um: field.step_um,
            notes: field.notes.clone(),
            warnings: vec![],
        };
        this.warnings = this.warn(coherence_um);
        this
    }

    /// Quality of a patch from [`Grating::whole`]: one period of a grating, whose slope and steps belong to the
    /// profile.
    pub(crate) fn of_whole(field: &HeightField, grating: Grating, coherence_um: f64) -> Self {
        let grating = Grating { direction_deg: 0.0, periods: 1.0, ..grating };
        let mut this =
            Self { tilt: [0.0; 2], seams: [0.0; 2], grating: Some(grating), ..Self::of(field, coherence_um) };
        this.periods = with_grating(this.periods, this.grating, field);
        this.warnings = this.warn(coherence_um);
        this
    }

    /// Whether the patch repeats seamlessly. A single grating needs a whole number of periods, as its own steps may
    /// hide those at the seams. Other patches need seams without steps.
    pub fn is_periodic(&self) -> bool {
        self.cut().is_none() && (self.grating.is_some() || self.seams.iter().all(|s| *s <= SEAM))
    }

    /// Numbers of periods of a single grating to the right and up, if they are not whole.
    pub(crate) fn cut(&self) -> Option<[f64; 2]> {
        let peak = self.single()?;
        let (sin, cos) = peak.direction_deg.to_radians().sin_cos();
        let cycles = [cos * self.size_um[0] / peak.period_um, sin * self.size_um[1] / peak.period_um];
        cycles.iter().any(|c| (c - c.round()).abs() > CYCLES).then_some(cycles)
    }

    fn warn(&self, coherence_um: f64) -> Vec<String> {
        let mut all = vec![];
        if self.range_um == 0.0 {
            all.push("the surface is flat: nothing diffracts".into());
        }
        if self.shortest_nm > 380.0 {
            let most = (0.38 / (2.0 * self.pixel_um)).min(1.0).asin().to_degrees();
            all.push(format!(
                "pixels of {} µm are too coarse for 380 nm: at normal incidence they carry its orders up to {most:.0}° from the normal",
                self.pixel_um
            ));
        }
        if let Some([x, y]) = self.cut() {
            all.push(format!(
                "the patch holds {:.2} periods to the right and {:.2} up, no whole numbers, and is repeated: its orders are those of the \
                 cut pattern, not of the grating; crop it to whole periods",
                x.abs(),
                y.abs()
            ));
        } else if !self.is_periodic() {
            let [x, y] = self.seams;
            all.push(format!(
                "the patch does not go on where it is repeated (steps or bends at its edges are {x:.1} and {y:.1} times the largest inside), \
                 which scatters light along both axes; crop it to whole periods if it has any"
            ));
        }
        let least = self.size_um[0].min(self.size_um[1]);
        if least < coherence_um && self.height > 1 && self.single().is_none() && self.range_um > 0.0 {
            all.push(format!(
                "the patch ({least:.1} µm) is smaller than the coherence length ({coherence_um} µm) and is no plain grating: its repetition \
                 shows as orders of a grating of {least:.1} µm; a coherence of {least:.0} µm shows what the patch itself diffracts"
            ));
        }
        let [right, up] = self.tilt;
        let whole = right.abs() * self.size_um[0] + up.abs() * self.size_um[1];
        // The slope of a single period belongs to its profile.
        let is_profile = self.grating.is_some_and(|g| g.periods == 1.0);
        if right.hypot(up) > TILT && whole > 0.05 * self.range_um && !is_profile {
            all.push(format!(
                "the patch slopes by {right:.4} to the right and {up:.4} up; if that is the sample's tilt and not its profile, level it"
            ));
        }
        if let Some(step) = self.step_um.filter(|s| *s > 0.002) {
            all.push(format!("heights come in steps of {:.1} nm, whose noise shows between the orders", 1e3 * step));
        }
        if let Some(peak) = self.periods.first().filter(|p| p.period_um < 1.5 && p.share > 0.1) {
            all.push(format!(
                "the period of {:.2} µm is near to the wavelengths, where scalar theory is off by tens of percent and knows no polarization",
                peak.period_um
            ));
        }
        all
    }

    /// Peak of a surface that consists of one grating and its harmonics almost entirely.
    fn single(&self) -> Option<&Peak> {
        let first = self.periods.first()?;
        if self.grating.is_some() {
            return Some(first);
        }
        let harmonic = |p: &Peak| {
            let ratio = first.period_um / p.period_um;
            let turned = (p.direction_deg - first.direction_deg).abs();
            let known = (p.resolution_um / p.period_um).max(0.05);
            (ratio - ratio.round()).abs() < known * ratio && turned.min(180.0 - turned) < 3.0
        };
        let together: f64 = self.periods.iter().map(|p| p.share).sum();
        (self.periods.iter().all(harmonic) && together > 0.85).then_some(first)
    }
}

fn rms_slope(field: &HeightField) -> f64 {
    let (w, h) = (field.width, field.height);
    let (mut sum, mut count) = (0.0, 0_usize);
    for y in 0..h {
        for x in 0..w {
            let here = field.um[y * w + x];
            if x + 1 < w {
                sum += (field.um[y * w + x + 1] - here).powi(2);
                count += 1;
            }
            if y + 1 < h {
                sum += (field.um[(y + 1) * w + x] - here).powi(2);
            }
        }
    }
    (sum / count.max(1) as f64).sqrt() / field.pixel_um
}

/// Root mean square step at the seams relative to the largest between neighbouring columns or rows, or the same ratio
/// for changes of slope, whichever is larger.
fn seams(field: &HeightField) -> [f64; 2] {
    let (w, h) = (field.width, field.height);
    let column = |x: usize| (0..h).map(move |y| y * w + x);
    let row = |y: usize| (0..w).map(move |x| y * w + x);
    let um = &field.um;
    let [low, high] = um.iter().fold([f64::MAX, f64::MIN], |[a, b], v| [a.min(*v), b.max(*v)]);
    let least = (ROUNDED * (high - low)).powi(2);
    [
        seam(w, least * h as f64, &|k| column(k % w).map(|i| um[i]).collect()),
        seam(h, least * w as f64, &|k| row(k % h).map(|i| um[i]).collect()),
    ]
}

/// Seam of the lines `0..n` (lists of heights), which repeat from `n` on. Sums of squares below `least` are rounding
/// errors.
fn seam(n: usize, least: f64, line: &dyn Fn(usize) -> Vec<f64>) -> f64 {
    if n < 4 {
        return 0.0;
    }
    let step = |k: usize| -> Vec<f64> { line(k + 1).iter().zip(line(k)).map(|(a, b)| a - b).collect() };
    let size = |v: &[f64]| v.iter().map(|d| d * d).sum::<f64>();
    let bend = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (b - a).powi(2)).sum::<f64>();
    // Steps from each line to the next. The last one is the seam; the one after it is the first again.
    let (mut steps, mut bends) = ([0.0_f64; 2], [0.0_f64; 2]);
    let mut last = step(0);
    steps[0] = size(&last);
    for k in 1..=n {
        let here = step(k % n);
        let at_seam = usize::from(k == n - 1);
        if k < n {
            steps[at_seam] = steps[at_seam].max(size(&here));
        }
        let at_seam = usize::from(k >= n - 1);
        bends[at_seam] = bends[at_seam].max(bend(&last, &here));
        last = here;
    }
    let ratio = |[inside, seam]: [f64; 2]| {
        if seam <= least {
            0.0
        } else if inside > least {
            (seam / inside).sqrt()
        } else {
            1e9
        }
    };
    // Slopes of rounded heights change randomly.
    ratio(steps).max(ratio(bends) / 1.5)
}

/// Puts a grating of few periods first, whose own spectral peak is too wide, and removes its harmonics from the other
/// peaks.
fn with_grating(mut peaks: Vec<Peak>, grating: Option<Grating>, field: &HeightField) -> Vec<Peak> {
    let Some(g) = grating else { return peaks };
    if g.periods < MANY {
        let size = field.size_um();
        let least = if field.height > 1 { size[0].min(size[1]) } else { size[0] };
        peaks.retain(|p| p.period_um < 0.75 * g.period_um);
        peaks.insert(
            0,
            Peak {
                period_um: g.period_um,
                resolution_um: 0.5 * g.period_um * g.period_um / least,
                direction_deg: g.direction_deg,
                share: g.share,
            },
        );
        peaks.truncate(PEAKS);
    }
    peaks
}

/// Peaks of the power spectrum under a Hann window, interpolated between bins by a parabola through the logarithms.
fn periods(field: &HeightField) -> Vec<Peak> {
    let (w, h) = (field.width, field.height);
    let hann = |k: usize, n: usize| if n > 1 { (PI * (k as f64 + 0.5) / n as f64).sin().powi(2) } else { 1.0 };
    let mean = field.um.iter().sum::<f64>() / field.um.len() as f64;
    let windowed: Vec<f64> = field
        .um
        .iter()
        .enumerate()
        .map(|(k, v)| (v - mean) * hann(k % w, w) * if h > 1 { hann(k / w, h) } else { 1.0 })
        .collect();
    let plan = Plan::<f64>::new(w, h, [w / 2, h / 2], [f64::INFINITY; 2]);
    let plane = plan.real(&windowed);
    let [mx, my] = plan.reach();
    let (mx, my) = (mx as isize, my as isize);
    let power = |ix: isize, iy: isize| {
        if ix.abs() > mx || iy.abs() > my { 0.0 } else { plane.at([ix, iy]).norm_sqr() }
    };
    let all: f64 = (-my..=my).flat_map(|iy| (-mx..=mx).map(move |ix| [ix, iy])).map(|at| plane.at(at).norm_sqr()).sum();
    let mut found: Vec<(isize, isize, f64)> = vec![];
    for iy in 0..=my {
        for ix in if iy == 0 { 1 } else { -mx }..=mx {
            // The window spreads the mean over the next bins, and slow bending is no period.
            if ix.abs().max(iy) < 2 {
                continue;
            }
            let here = power(ix, iy);
            let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|d| *d != (0, 0));
            if here > 0.0 && around.into_iter().all(|(dx, dy)| power(ix + dx, iy + dy) <= here) {
                found.push((ix, iy, here));
            }
        }
    }
    found.sort_by(|a, b| b.2.total_cmp(&a.2));
    let strongest = found.first().map_or(0.0, |f| f.2);
    found.retain(|f| f.2 >= WEAKEST * strongest && strongest > 0.0);
    found.truncate(PEAKS);
    let refine = |a: f64, b: f64, c: f64| {
        let floor = b * 1e-12;
        let [a, b, c] = [a, b, c].map(|v| v.max(floor).ln());
        let bend = a - 2.0 * b + c;
        if bend < 0.0 { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) } else { 0.0 }
    };
    let size = field.size_um();
    let peak = |(ix, iy, here): (isize, isize, f64)| {
        let dx = refine(power(ix - 1, iy), here, power(ix + 1, iy));
        let dy = if h > 1 { refine(power(ix, iy - 1), here, power(ix, iy + 1)) } else { 0.0 };
        let f = [(ix as f64 + dx) / size[0], (iy as f64 + dy) / size[1]];
        let frequency = f[0].hypot(f[1]);
        let near: f64 = (-1..=1).flat_map(|b| (-1..=1).map(move |a| (a, b))).map(|(a, b)| power(ix + a, iy + b)).sum();
        let least = if h > 1 { size[0].min(size[1]) } else { size[0] };
        Peak {
            period_um: 1.0 / frequency,
            resolution_um: 0.5 / (frequency * frequency * least),
            direction_deg: f[1].atan2(f[0]).to_degrees().rem_euclid(180.0),
            // The same peak is at the opposite frequency too.
            share: (2.0 * near / all).min(1.0),
        }
    };
    found.into_iter().map(peak).collect()
}
