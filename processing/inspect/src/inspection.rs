//! Inspection of one sheet: registration, differences, defects.

use crate::coarse::coarse;
use crate::compare::Differences;
use crate::defect::{Regions, expected, largest, regions};
use crate::refine::refine;
use crate::sheet::Sheet;
use crate::transform::{Freedom, Transform};
use nacre_base::Result;
use nacre_base::progress::Progress;
use schemars::JsonSchema;
use serde::Serialize;

/// Longest side of the images by which the first registration is found: its error is about one of their pixels.
const COARSE: f64 = 112.0;

/// Parameters of an inspection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Accepted false alarms per sheet.
    pub false_alarms: f64,
    /// Smallest area of a defect in pixels.
    pub min_area_px: usize,
    /// Largest turn of the sheet in degrees.
    pub max_turn_deg: f64,
    /// Threshold from good samples; it applies if it exceeds that of normal noise.
    pub trained: Option<f64>,
}

/// Registration of the sample to the reference.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Registration {
    /// `similarity`, `homography` or `smooth`: the simplest transform that fits.
    pub kind: &'static str,
    /// Correlation at the first registration, 0 to 1.
    pub likeness: f64,
    /// Turn of the sheet in degrees, anticlockwise.
    pub turn_deg: f64,
    /// Size of the sample relative to the reference, in pixels.
    pub scale: f64,
    /// Shift of the middle in pixels, right and down.
    pub shift_px: [f64; 2],
    /// Shift in mm; `None` if the pixel size is unknown.
    pub shift_mm: Option<[f64; 2]>,
    /// Standard deviation of the shift in pixels.
    pub sigma_px: f64,
    /// Largest displacement by the smooth part in pixels.
    pub smooth_px: f64,
    /// Residuals at edges relative to the contrast within a pixel: errors of sampling and registration.
    pub edge: f64,
    /// Share of the reference that is seen in the sample.
    pub overlap: f64,
}

/// Result of one inspection.
pub struct Inspection {
    /// Registration.
    pub registration: Registration,
    /// Mapping from pixels of the reference to those of the sample.
    pub transform: Transform,
    /// Differences.
    pub differences: Differences,
    /// Defects.
    pub regions: Regions,
    /// Threshold of the statistic in standard deviations.
    pub threshold: f64,
    /// Largest statistic of any region.
    pub largest: f64,
    /// Offset of all orientations of the sample from those of the reference in degrees, without the turn of the sheet.
    pub offset_deg: f64,
    /// Standard deviation of the offset in degrees.
    pub offset_sigma_deg: f64,
}

/// Inspects a sample.
///
/// # Errors
/// `Input` if sample and reference are nowhere alike; `Cancelled`.
pub fn inspect(
    reference: &Sheet,
    sample: &Sheet,
    parameters: &Parameters,
    progress: &dyn Progress,
) -> Result<Inspection> {
    let scale = reference.pixel_um.zip(sample.pixel_um).map_or(1.0, |(r, s)| r / s);
    let (start, likeness) =
        coarse(&reference.image, &sample.image, scale, parameters.max_turn_deg.to_radians(), progress)?;
    let longest = reference.image.width.max(reference.image.height) as f64;
    let refined = refine(&reference.image, &sample.image, start, (2.0 * longest / COARSE).ceil(), progress)?;
    let differences = Differences::of(reference, sample, &refined);
    progress.check()?;
    let normal = threshold(&differences, parameters.false_alarms);
    let threshold = parameters.trained.map_or(normal, |trained| trained.max(normal));
    let regions = regions(&differences, threshold, parameters.min_area_px, reference.pixel_um);
    let [turn, found_scale] = refined.transform.turn_and_scale();
    let shift_px = refined.transform.shift();
    let registration = Registration {
        kind: match refined.freedom {
            Freedom::Similarity => "similarity",
            Freedom::Homography => "homography",
            Freedom::Smooth => "smooth",
        },
        likeness,
        turn_deg: turn.to_degrees(),
        scale: found_scale,
        shift_px,
        shift_mm: sample.pixel_um.map(|um| shift_px.map(|v| v * um / 1000.0)),
        sigma_px: refined.sigma_px,
        smooth_px: refined.transform.bend_px(),
        edge: differences.edge,
        overlap: differences.overlap(),
    };
    // The turn of the sheet turns its orientations; half of the polarization's turn is that of the orientation.
    let offset = (0.5 * differences.turned - turn + std::f64::consts::FRAC_PI_2).rem_euclid(std::f64::consts::PI);
    Ok(Inspection {
        registration,
        transform: refined.transform,
        largest: largest(&differences, parameters.min_area_px),
        offset_deg: offset.to_degrees() - 90.0,
        offset_sigma_deg: 0.5 * differences.turned_sigma.to_degrees(),
        differences,
        regions,
        threshold,
    })
}

/// Deviation that normal noise exceeds in `false_alarms` pixels per sheet on average.
fn threshold(differences: &Differences, false_alarms: f64) -> f64 {
    let all = expected(differences, 0.0).max(1.0);
    (2.0 * (all / false_alarms.max(1e-9)).ln()).max(0.0).sqrt()
}
