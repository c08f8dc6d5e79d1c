//! `report.json` of an inspection.

use crate::compare::{Difference, Differences};
use crate::defect::{Class, Defect, Regions};
use crate::inspection::{Inspection, Registration};
use crate::limits::Limits;
use crate::sheet::{Origin, Sheet};
use nacre_base::operation::{Summary, lines};
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;

/// Offset of orientations in degrees above which a warning doubts that the sample lay like the reference.
const TURNED_DEG: f64 = 20.0;

/// Residuals at edges above which small defects there are not found.
const ROUGH: f64 = 0.5;

/// Verdict on a sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// No limit is exceeded.
    Accept,
    /// A limit is exceeded.
    Reject,
}

/// Differences of one quantity over all compared pixels, defects included.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Differs {
    /// Root mean square.
    pub rms: f64,
    /// Typical (median) standard deviation of a pixel, noise of both sheets and registration included.
    pub sigma: f64,
    /// Share of the pixels that differ by more than three standard deviations.
    pub beyond: f64,
}

/// Differences by quantity; `None` for a quantity that is unknown in one of the sheets.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct AllDiffers {
    /// Orientation in degrees, after the common offset.
    pub orientation_deg: Option<Differs>,
    /// Degree of polarization, which shows the presence of a grating.
    pub presence: Option<Differs>,
    /// Logarithm of the brightness, after a smooth background.
    pub brightness: Option<Differs>,
    /// Logarithm of the period, after the median.
    pub period: Option<Differs>,
}

/// Inspection of one sheet.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct SheetReport {
    /// The sheet and its input files.
    pub sample: Origin,
    /// Verdict by the limits.
    pub verdict: Verdict,
    /// Limits that are exceeded.
    pub exceeded: Vec<String>,
    /// Defects, largest difference first.
    pub defects: Vec<Defect>,
    /// Registration to the reference.
    pub registration: Registration,
    /// Offset of all orientations from those of the reference in degrees, without the turn of the sheet.
    pub offset_deg: f64,
    /// Standard deviation of the offset in degrees.
    pub offset_sigma_deg: f64,
    /// Differences by quantity.
    pub differences: AllDiffers,
    /// Smallest difference of a defect in standard deviations.
    pub threshold: f64,
    /// Largest difference of any region in standard deviations.
    pub largest_deviation: f64,
    /// Width and height of the reference in pixels.
    pub size_px: [usize; 2],
    /// Size of a pixel of the reference in µm; `None` if unknown.
    pub pixel_um: Option<f64>,
    /// Limitations of the inspection.
    pub warnings: Vec<String>,
}

/// Report of an inspection.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "InspectionReport")]
pub struct Report {
    /// Always `inspect`.
    pub method: &'static str,
    /// The reference and its input files.
    pub reference: Origin,
    /// Accepted false alarms per sheet.
    pub false_alarms: f64,
    /// Smallest area of a defect in pixels.
    pub min_area_px: usize,
    /// The limits applied; of a training, those that it wrote.
    pub limits: Limits,
    /// SHA-256 of the file of limits; `None` without a file.
    pub limits_sha256: Option<String>,
    /// Whether good samples trained limits, and no verdict was made.
    pub trained: bool,
    /// All sheets, by name.
    pub sheets: Vec<SheetReport>,
    /// Number of rejected sheets.
    pub rejected: usize,
    /// Time of the inspection in Unix seconds.
    pub inspected_s: u64,
    /// Limitations of the results.
    pub warnings: Vec<String>,
}

impl SheetReport {
    /// The report of an inspection, without a verdict.
    pub fn new(reference: &Sheet, sample: &Sheet, found: &Inspection) -> Self {
        let defects = by_deviation(&found.regions).into_iter().map(|k| found.regions.defects[k].clone()).collect();
        let registration = found.registration.clone();
        let mut warnings = vec![];
        if !(reference.has_light && sample.has_light) {
            warnings
                .push("brightness and degree of polarization are not compared: one folder has no stokes.exr".into());
        }
        if found.offset_deg.abs() > TURNED_DEG {
            warnings.push(format!("all orientations are off by {:.1}°: check how the sheet lay", found.offset_deg));
        }
        if registration.edge > ROUGH {
            let share = 100.0 * registration.edge;
            warnings.push(format!("edges differ by {share:.0} % of their contrast: small defects there are not found"));
        }
        Self {
            sample: sample.origin.clone(),
            verdict: Verdict::Accept,
            exceeded: vec![],
            defects,
            registration,
            offset_deg: found.offset_deg,
            offset_sigma_deg: found.offset_sigma_deg,
            differences: AllDiffers::of(&found.differences),
            threshold: found.threshold,
            largest_deviation: found.largest,
            size_px: [found.differences.width, found.differences.height],
            pixel_um: reference.pixel_um,
            warnings,
        }
    }

    /// The report with the verdict by limits.
    #[must_use]
    pub fn judged(mut self, limits: &Limits) -> Self {
        self.exceeded = limits.exceeded(&self);
        self.verdict = if self.exceeded.is_empty() { Verdict::Accept } else { Verdict::Reject };
        self
    }

    /// Centre of a defect in mm, right of and above the middle of the reference; `None` if the pixel size is unknown.
    pub fn at_mm(&self, defect: &Defect) -> Option<[f64; 2]> {
        let mm = self.pixel_um? / 1000.0;
        let [x, y] = [0, 1].map(|k| (defect.at_px[k] - 0.5 * (self.size_px[k] as f64 - 1.0)) * mm);
        Some([x, -y])
    }

    /// Number of defects of a class.
    pub fn count(&self, class: Class) -> usize {
        self.defects.iter().filter(|d| d.class == class).count()
    }
}

/// Indices of the defects in the order of their numbers: largest deviation first.
pub fn by_deviation(regions: &Regions) -> Vec<usize> {
    let mut order: Vec<usize> = (0..regions.defects.len()).collect();
    order.sort_by(|a, b| regions.defects[*b].deviation.total_cmp(&regions.defects[*a].deviation));
    order
}

impl AllDiffers {
    fn of(found: &Differences) -> Self {
        let all = || (0..found.compared.len()).filter(|i| found.compared[*i]);
        let orientation = all().filter_map(|i| found.orientation(i)).map(|d| d.map(|v| f64::from(v).to_degrees()));
        let presence = all().filter_map(|i| Some([found.presence(i)?.into(), found.sigma[i].into()]));
        let of = |d: &Difference| {
            let pairs = d.value.iter().zip(&d.sigma).filter(|(v, _)| v.is_finite());
            Differs::of(pairs.map(|(v, s)| [f64::from(*v), f64::from(*s)]))
        };
        Self {
            orientation_deg: Differs::of(orientation),
            presence: Differs::of(presence),
            brightness: of(&found.light),
            period: of(&found.period),
        }
    }
}

impl Differs {
    /// From differences and standard deviations; `None` without any.
    fn of(pairs: impl Iterator<Item = [f64; 2]>) -> Option<Self> {
        let (mut squares, mut beyond, mut sigmas) = (0.0, 0_usize, vec![]);
        for [value, sigma] in pairs {
            squares += value * value;
            beyond += usize::from(value.abs() > 3.0 * sigma);
            sigmas.push(sigma);
        }
        let count = sigmas.len() as f64;
        let sigma = nacre_base::statistics::median(sigmas)?;
        Some(Self { rms: (squares / count).sqrt(), sigma, beyond: beyond as f64 / count })
    }
}

impl Summary for Report {
    fn summary(&self) -> String {
        let mut text = String::new();
        for sheet in &self.sheets {
            let defects = Class::ALL.map(|class| (class, sheet.count(class)));
            let defects: Vec<String> =
                defects.iter().filter(|d| d.1 > 0).map(|(class, n)| format!("{n} {}", class.label())).collect();
            let defects = if defects.is_empty() { "no defect".into() } else { defects.join(", ") };
            let verdict = match sheet.verdict {
                _ if self.trained => "good",
                Verdict::Accept => "accept",
                Verdict::Reject => "reject",
            };
            let r = &sheet.registration;
            _ = writeln!(
                text,
                "{verdict:9} {}: {defects}; turned {:.2}°, shifted {:.1}, {:.1} px, {:.1} % of the reference inspected",
                sheet.sample.name,
                r.turn_deg,
                r.shift_px[0],
                r.shift_px[1],
                100.0 * r.overlap
            );
        }
        if self.trained {
            let threshold = self.limits.threshold.unwrap_or_default();
            _ = writeln!(text, "threshold {threshold:.2} σ from {} good samples", self.limits.samples);
        }
        (text + &lines(&[], &self.warnings)).trim_end().to_owned()
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
