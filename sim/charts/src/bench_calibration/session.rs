//! Absolute orientations of a session on a calibrated bench.

use super::capture::{Shot, TURN, shoot};
use super::{with_reference, written};
use nacre_base::operation::perform;
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use nacre_calibrate::orientation;
use nacre_frames::Calibration;
use nacre_image::read_exr;
use nacre_polarimetry::{Model, Options, angle_difference, reconstruct};
use nacre_sim::surface::SampleKind;
use nacre_sim::{Bench, BenchConfig, write_truth};
use std::path::Path;

/// Turn of the known sample in degrees.
const KNOWN_DEG: f64 = 30.0;

/// Errors of the absolute orientations of a session.
#[derive(Clone, Copy, Debug)]
pub struct Absolute {
    /// Median error in degrees.
    pub median_deg: f64,
    /// Median error in degrees after the best common offset.
    pub relative_deg: f64,
    /// That offset in degrees.
    pub offset_deg: f64,
    /// Error in degrees that the report expects of a typical pixel; NaN if the offset is not calibrated.
    pub expected_deg: f64,
}

/// The bench with an ideal analyser, stage and panel; its camera is the same.
pub fn ideal(bench: &BenchConfig) -> BenchConfig {
    let usual = BenchConfig::default();
    let mut ideal = BenchConfig { stage: usual.stage, panel: usual.panel, ..bench.clone() };
    ideal.stage.extinction_ratio = 1e6;
    ideal
}

/// Captures a kinematic tile of known orientations for their offset, and another tile. Compares the orientations of
/// that tile with the true ones, offset included.
///
/// # Errors
/// Those of capture and reconstruction.
pub fn absolute(bench: &BenchConfig, calibration: &Calibration, folder: &Path) -> Result<Absolute> {
    let reference = with_reference(bench, SampleKind::Kinematic, KNOWN_DEG, 6);
    let auto = Options { model: Some(Model::Auto), ..Options::default() };
    let captured = |bench: &BenchConfig, calibration: &Calibration, name: &str| {
        let (input, out) = (folder.join(format!("{name}-session")), folder.join(name));
        shoot(bench, &Shot::Turn { count: TURN, crossed: false }, calibration, &input)?;
        reconstruct(&input, &out, &auto, &Silent).map(|report| (out, report))
    };
    let (known, _) = captured(&reference, calibration, "reference")?;
    let (truth, out) = (folder.join("truth.exr"), folder.join("orientation"));
    write_truth(&Bench::new(&reference, &Silent)?, &truth)?;
    let options = orientation::Options { known_map: Some(truth), ..orientation::Options::default() };
    perform(&options, &known, &out, false, &Silent)?;
    let calibration = Calibration { orientation: written(&out)?.orientation, ..calibration.clone() };
    let tile = with_reference(bench, SampleKind::Kinematic, 0.0, 7);
    let (result, report) = captured(&tile, &calibration, "tile")?;
    let path = result.join("orientation.exr");
    let found = read_exr(&path)?.take("orientation", &path)?;
    let truth = Bench::new(&tile, &Silent)?.truth().orientation.clone();
    let both = found.iter().zip(&truth).filter(|(f, t)| f.is_finite() && t.is_finite());
    let errors: Vec<f64> = both.map(|(f, t)| angle_difference(f64::from(*f), f64::from(*t))).collect();
    let sum = |of: fn(f64) -> f64| errors.iter().map(|e| of(2.0 * e)).sum::<f64>();
    let offset = 0.5 * sum(f64::sin).atan2(sum(f64::cos));
    let median = |offset: f64| {
        let mut off: Vec<f64> = errors.iter().map(|e| angle_difference(*e, offset).abs().to_degrees()).collect();
        off.sort_by(f64::total_cmp);
        off.get(off.len() / 2).copied().ok_or_else(|| Error::file(&path, "has no orientation", "report this"))
    };
    Ok(Absolute {
        median_deg: median(0.0)?,
        relative_deg: median(offset)?,
        offset_deg: offset.to_degrees(),
        expected_deg: report.absolute_error_deg.unwrap_or(f64::NAN),
    })
}
