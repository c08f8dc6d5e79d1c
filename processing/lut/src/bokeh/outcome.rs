//! Results of a bokeh photograph, and warnings about them.

use super::deconvolution::{Deconvolved, Iterations};
use super::height::Calibration;
use super::lens::Cutoff;
use super::options::Options;
use super::period::Lines;
use super::report::{
    Deconvolution, Heights, LinesReport, NoiseReport, Report, Scale, Seconds, SliceReport, SlitsReport,
};
use super::rotation::Map;
use super::slice::{Line, Slice};
use super::slits::Slits;
use std::path::Path;

/// Ratio of misfit to its expected value above which a warning is issued.
const UNEXPLAINED: f64 = 1.1;

/// Numbers of accelerated and of plain iterations above which a warning is issued.
const MANY: usize = 150;
const MANY_PLAIN: usize = 450;

/// Angle in degrees between slice and grating vector above which a warning is issued.
const TILTED: f64 = 3.0;

/// All results of the reconstruction.
pub(super) struct Outcome {
    /// Deconvolved photograph, cropped and rotated.
    pub map: Map,
    pub sharp: Deconvolved,
    /// Mean light of the result.
    pub mean: f64,
    /// Number of unknown pixels.
    pub unknown: usize,
    pub slice: Option<Slice>,
    pub lines: Option<Lines>,
    pub slits: Option<Slits>,
    /// Projection factor from distances along the slice to distances across the lines.
    pub across: f64,
    pub scale: Scale,
    pub cutoff: Option<Cutoff>,
    pub calibration: Option<Calibration>,
}

impl Outcome {
    pub(super) fn report(&self, input: &Path, options: &Options, psf: String, noise: Option<NoiseReport>) -> Report {
        let of_noise = |value: f64| noise.map(|_| value);
        let um = self.scale.pixel_um.map(|um| um * self.across);
        let sized = |[value, sigma]: [f64; 2]| um.map(|um| [um * value, um * sigma]);
        let slice = self.slice.as_ref();
        let mut report = Report {
            method: "bokeh",
            warnings: vec![],
            photograph: input.display().to_string(),
            channel: options.channel,
            crop: options.crop,
            rotate_deg: options.rotate_deg,
            width: self.map.width,
            height: self.map.height,
            merged: None,
            unknown_pixels: self.unknown,
            psf,
            deconvolution: Deconvolution {
                iterations: self.sharp.iterations,
                auto: matches!(options.iterations, Iterations::Auto(_)),
                converged: self.sharp.converged,
                accelerated: options.accelerate,
                noise,
                misfit: of_noise(self.sharp.misfit),
                expected: of_noise(self.sharp.expected),
            },
            scale: self.scale,
            cutoff: self.cutoff,
            slice: SliceReport {
                line: slice.map_or_else(|| Line::middle(&self.map), |s| s.line),
                width_px: slice.map_or(0, |s| s.width),
                tilt_deg: slice.map_or(0.0, |s| s.tilt_deg),
            },
            lines: self.lines.map(|lines| LinesReport { lines, period_um: um.map(|um| um * lines.period_px[0]) }),
            slits: self.slits.map(|slits| SlitsReport {
                slits,
                spacing_um: sized(slits.spacing_px),
                width_um: sized(slits.width_px),
            }),
            heights: Heights {
                unit: if self.calibration.is_some() { "µm" } else { "relative" },
                mean_light: self.mean,
                calibration: self.calibration.clone(),
            },
            seconds: Seconds::default(),
        };
        report.warnings = self.warnings(&report);
        report
    }

    fn warnings(&self, report: &Report) -> Vec<String> {
        let mut all = vec![];
        if self.unknown > 0 {
            let share = 100.0 * self.unknown as f64 / self.sharp.light.len() as f64;
            all.push(format!(
                "{} pixels ({share:.2} %) are saturated or not known, and guessed from around them; expose shorter",
                self.unknown
            ));
        }
        all.extend(self.blur_warnings(report));
        let name = report.photograph.to_lowercase();
        let jpeg = name.ends_with(".jpg") || name.ends_with(".jpeg");
        if jpeg && report.deconvolution.noise.is_some_and(|n| n.source == "estimated") {
            all.push(
                "JPEG hides noise, so that the estimate of it is too small and too much is sharpened; give --noise"
                    .into(),
            );
        }
        match self.cutoff {
            None => all.push(
                "the optical cut-off is unknown: whether the lens can show what is seen is not checked; give --lens-focal-mm, \
                 --f-number and --distance-m"
                    .into(),
            ),
            Some(cutoff) => all.extend(self.lens_warnings(&cutoff, report)),
        }
        if let Some(slice) = self.slice.as_ref().filter(|s| s.tilt_deg.abs() > TILTED && self.lines.is_some()) {
            all.push(format!(
                "the slice runs {:.1}° off the direction across the lines, which smears them over its {} pixels of width; turn \
                 the result by {:.1}° or choose another slice",
                slice.tilt_deg.abs(),
                slice.width,
                -slice.tilt_deg
            ));
        }
        if self.lines.is_none() {
            all.push("no lines are found along the slice; choose one across them with --slice".into());
        }
        if self.calibration.is_none() {
            all.push(
                "heights are relative, from 0 to 1: nothing says how light grows with height; give --calibration"
                    .into(),
            );
        }
        all
    }

    fn blur_warnings(&self, report: &Report) -> Option<String> {
        let found = &report.deconvolution;
        if found.auto && !found.converged {
            let text = "another iteration would still find structure, but no more were allowed";
            return Some(format!("{text} than {}; allow more", found.iterations));
        }
        if found.auto && found.iterations > if found.accelerated { MANY } else { MANY_PLAIN } {
            return Some(format!(
                "{} iterations are needed where light is plenty and edges are steep, but also where the point spread function is \
                 wider than the lens's, which rings and which noise does not give away: compare with a narrower one",
                found.iterations
            ));
        }
        let (misfit, expected) = found.misfit.zip(found.expected)?;
        if misfit <= UNEXPLAINED * expected {
            return None;
        }
        let times = (misfit / expected).sqrt();
        let text = format!("the blurred result differs from the photograph by {times:.2} times what noise explains");
        Some(if found.auto {
            let noise = found.noise.map_or("assumed", |n| n.source);
            format!(
                "{text}: the point spread function is another (as when it is wider than the lens's), or the noise is larger than \
                 {noise}"
            )
        } else {
            format!("{text}: more iterations would still find structure, or the point spread function is another")
        })
    }

    fn lens_warnings(&self, cutoff: &Cutoff, report: &Report) -> Option<String> {
        let Some(period) = report.lines.and_then(|l| l.period_um) else {
            return Some(format!(
                "the lens shows no period below {:.2} µm (λ / (2 NA)), but what is seen could not be compared with that, since no \
                 scale is known",
                cutoff.period_um
            ));
        };
        (period < cutoff.coherent_period_um).then(|| {
            format!(
                "a period of {period:.2} µm is near the optical cut-off of {:.2} µm (λ / (2 NA)): a single distant light straight behind \
                 the camera shows only periods above {:.2} µm (λ / NA)",
                cutoff.period_um, cutoff.coherent_period_um
            )
        })
    }

    /// Conversion from light to height.
    pub(super) fn height(&self) -> impl Fn(f64) -> f64 {
        let [low, high] = super::height::ends(&self.map.values);
        let (calibration, mean) = (self.calibration.clone(), self.mean);
        move |light| match &calibration {
            Some(calibration) => calibration.height(light / mean),
            None if high > low => (light - low) / (high - low),
            None => 0.0 * light,
        }
    }
}
