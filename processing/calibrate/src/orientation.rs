//! The operation `orientation`: offset of orientations, from a map of a sample of known orientation.

use crate::analyser::near_zero;
use crate::transfer::Measured;
use crate::turn::region_of;
use nacre_base::estimate::Work;
use nacre_base::operation::{Input, MISSING, Operation, Summary, lines};
use nacre_base::progress::Progress;
use nacre_base::text::read_text;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::{CALIBRATION_FILE, Calibration, OrientationCalibration};
use nacre_image::{Depth, Info, read_exr};
use nacre_maps::{Kind, Maps};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Parts of the region along each axis, whose means give the standard deviation.
const PARTS: usize = 4;

/// Smallest share of pixels with an orientation.
const ENOUGH: f64 = 0.1;

/// Spread of the differences in degrees above which the region shows something else.
const UNIFORM_DEG: f64 = 3.0;

/// Largest size of a report.
const MAX_REPORT: u64 = 16 << 20;

/// Measure the offset of orientations on a sample of known orientation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "OrientationOptions", extend(
    "x-input" = "Result folder of `nacre reconstruct polarization` for a sample of known orientation",
    "x-examples" = "\
Examples:
  nacre calibrate orientation disc --center-px 512,498 --out orientation
  nacre calibrate orientation result --known-map design.exr --out orientation
  nacre calibrate orientation result --known-deg 90 --known-sigma-deg 0.1 --region 100,100,200,200 --out offset

The offset between the phase of the light and the orientation depends on the grating (metal, period,
depth), so the sample must be of the kind to be measured: a disc with circular tracks, or a grating
of known direction beside the sample in the same photographs. A disc has all orientations, so that
the model is the same as for other samples; known-deg is the direction of the grating vector,
perpendicular to the lines, anticlockwise from the right of the image.

Writes report.json and calibration.json."
))]
pub struct Options {
    /// Direction of the grating vector in degrees, perpendicular to the lines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub known_deg: Option<f64>,
    /// Standard deviation of that direction in degrees.
    pub known_sigma_deg: f64,
    /// Centre of a disc with circular tracks in pixels, from the left and from the top, instead of known_deg.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-placeholder" = "X,Y"))]
    pub center_px: Option<[f64; 2]>,
    /// Map of the sample's true orientations (EXR of the same size, channel orientation in rad), instead of known_deg.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-file" = true, "x-placeholder" = "FILE.exr"))]
    pub known_map: Option<PathBuf>,
    /// Region of the known sample: left, top, width, height in pixels (default: the middle half of each side, or
    /// everything for a disc or a map).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-placeholder" = "LEFT,TOP,WIDTH,HEIGHT", "x-advanced" = true))]
    pub region: Option<[usize; 4]>,
}

/// Report of the operation `orientation`.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "OrientationReport")]
pub struct Report {
    /// `orientation`.
    pub method: &'static str,
    /// Limitations of the result.
    pub warnings: Vec<String>,
    /// Offset to add to orientations in degrees.
    pub offset_deg: Measured,
    /// Standard deviation of the differences from the known orientations in degrees.
    pub spread_deg: f64,
    /// Number of pixels.
    pub pixels: usize,
    /// Grating model of the map.
    pub model: String,
    /// Seconds of processing.
    pub seconds: f64,
}

/// Part of the map's report.
#[derive(Deserialize)]
struct Reconstructed {
    model: String,
    offset_deg: f64,
    error: Errors,
}

/// Errors that the map's report states.
#[derive(Deserialize)]
struct Errors {
    model_deg: Option<f64>,
}

/// Sum of doubled angles as a vector, and the number of pixels.
#[derive(Clone, Copy, Default)]
struct Mean {
    cos: f64,
    sin: f64,
    pixels: usize,
}

impl Mean {
    fn add(&mut self, angle: f64) {
        let (sin, cos) = (2.0 * angle).sin_cos();
        (self.cos, self.sin, self.pixels) = (self.cos + cos, self.sin + sin, self.pixels + 1);
    }

    fn with(self, other: Self) -> Self {
        Self { cos: self.cos + other.cos, sin: self.sin + other.sin, pixels: self.pixels + other.pixels }
    }

    /// Mean angle in degrees.
    fn deg(self) -> f64 {
        0.5 * self.sin.atan2(self.cos).to_degrees()
    }

    /// Circular standard deviation of the angles in degrees.
    fn spread_deg(self) -> f64 {
        let length = (self.cos.hypot(self.sin) / self.pixels.max(1) as f64).clamp(f64::MIN_POSITIVE, 1.0);
        0.5 * (-2.0 * length.ln()).sqrt().to_degrees()
    }
}

/// Orientations of the known sample.
enum Known {
    /// One direction in rad.
    Everywhere(f64),
    /// Radial from a centre in pixels.
    Radial([f64; 2]),
    /// A map with this number of pixels per row.
    Map(Vec<f32>, usize),
}

impl Known {
    /// Orientation in rad at a pixel.
    fn at(&self, x: usize, y: usize) -> f64 {
        match self {
            Self::Everywhere(angle) => *angle,
            Self::Map(values, width) => values[y * width + x].into(),
            Self::Radial([cx, cy]) => (cy - y as f64 - 0.5).atan2(x as f64 + 0.5 - cx),
        }
    }
}

impl Options {
    /// Checks the source of the known orientations, of which there must be one.
    fn check_known(&self) -> Result<()> {
        let given = [self.known_deg.is_some(), self.center_px.is_some(), self.known_map.is_some()];
        match given.iter().filter(|given| **given).count() {
            0 => {
                let remedy = "give the direction, center_px of a disc, or known_map";
                return Err(Error::input("known_deg", MISSING, remedy));
            }
            1 => {}
            _ => {
                let problem = "is given beside another source of the known orientations";
                return Err(Error::input(
                    if given[1] { "center_px" } else { "known_map" },
                    problem,
                    "give one of them",
                ));
            }
        }
        if let Some(deg) = self.known_deg.filter(|deg| !(-360.0..=360.0).contains(deg)) {
            return Err(Error::input("known_deg", format!("is {deg}"), "give degrees from -360 to 360"));
        }
        if let Some(center) = self.center_px.filter(|at| !at.iter().all(|v| v.abs() <= 1e6)) {
            let remedy = "give pixels from the left and from the top";
            return Err(Error::input("center_px", format!("is {center:?}"), remedy));
        }
        Ok(())
    }

    /// The known orientations of a picture of this size.
    fn known(&self, size: [usize; 2]) -> Result<Known> {
        self.check_known()?;
        let Some(path) = &self.known_map else {
            let radial = self.center_px.map(Known::Radial);
            return Ok(radial.unwrap_or(Known::Everywhere(self.known_deg.unwrap_or_default().to_radians())));
        };
        let mut map = read_exr(path)?;
        if [map.width, map.height] != size {
            let problem = format!("has {} × {} pixels, the result {} × {}", map.width, map.height, size[0], size[1]);
            return Err(Error::file(path, problem, "give the true orientations of the pixels of the result"));
        }
        Ok(Known::Map(map.take("orientation", path)?, size[0]))
    }

    fn region(&self, info: Info) -> Result<[usize; 4]> {
        let whole = self.known_deg.is_none().then_some([0, 0, info.width, info.height]);
        region_of(self.region.or(whole), info)
    }
}

/// Orientations in rad of a map, NaN where masked.
struct Orientations {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

fn orientations(input: &Path) -> Result<(Orientations, Reconstructed)> {
    let Maps { width, height, mut maps } = Maps::read(input)?;
    let remedy = "give a result folder of `nacre reconstruct polarization`";
    let map = maps.remove(&Kind::Orientation);
    let map = map.ok_or_else(|| Error::file(input, "has no map of orientations", remedy))?;
    let map = Orientations { width, height, values: map.value };
    let report = input.join("report.json");
    let text = read_text(&report, MAX_REPORT, remedy)?;
    let read = serde_json::from_str(&text).map_err(|e| Error::file(&report, e.to_string(), remedy))?;
    Ok((map, read))
}

impl Operation for Options {
    const NAME: &'static str = "orientation";
    const TITLE: &'static str = "Offset of orientations, from a map of a sample of known orientation";
    const INPUT: Input = Input::Maps;
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        self.check_known()?;
        if !(0.0..=45.0).contains(&self.known_sigma_deg) {
            let problem = format!("is {}", self.known_sigma_deg);
            return Err(Error::input("known_sigma_deg", problem, "give degrees from 0 to 45"));
        }
        Ok(())
    }

    fn check(&self, input: &Path) -> Result<Work> {
        self.check_options()?;
        let (map, _) = orientations(input)?;
        let pixels = map.values.len() as u64;
        Ok(Work {
            operation: Self::NAME.into(),
            seconds: 0.05 + 2e-8 * pixels as f64,
            memory_bytes: 16 * pixels,
            disk_bytes: 1 << 16,
            ..Work::default()
        })
    }

    fn run(&self, input: &Path, out: &OutputFolder, _: &dyn Progress) -> Result<Report> {
        let begun = Instant::now();
        let (map, reconstructed) = orientations(input)?;
        let known = self.known([map.width, map.height])?;
        let info = Info { width: map.width, height: map.height, channels: 1, depth: Depth::F32 };
        let [left, top, width, height] = self.region(info)?;
        let mut parts = [Mean::default(); PARTS * PARTS];
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let value = map.values[(top + y) * map.width + left + x];
            if value.is_finite() {
                let off = known.at(left + x, top + y) - f64::from(value);
                if off.is_finite() {
                    parts[y * PARTS / height * PARTS + x * PARTS / width].add(off);
                }
            }
        }
        let all = parts.iter().fold(Mean::default(), |a, b| a.with(*b));
        if (all.pixels as f64) < ENOUGH * (width * height) as f64 {
            let problem = format!("has {} pixels with an orientation in the region", all.pixels);
            return Err(Error::file(input, problem, "give another --region"));
        }
        let used: Vec<f64> = parts.iter().filter(|p| p.pixels > 0).map(|p| near_zero(p.deg() - all.deg())).collect();
        let n = used.len() as f64;
        let scatter = (used.iter().map(|d| d * d).sum::<f64>() / (n * (n - 1.0).max(1.0))).sqrt();
        let of_model = reconstructed.error.model_deg;
        let offset = Measured {
            value: near_zero(all.deg() + reconstructed.offset_deg),
            sigma: scatter.hypot(self.known_sigma_deg).hypot(of_model.unwrap_or(0.0)),
        };
        let calibration = OrientationCalibration {
            source: None,
            offset_deg: offset.value,
            sigma_deg: offset.sigma,
            model: reconstructed.model.clone(),
        };
        out.write_json(CALIBRATION_FILE, &Calibration { orientation: Some(calibration), ..Calibration::default() })?;
        Ok(Report {
            method: Self::NAME,
            warnings: self.doubts(all, of_model.is_some()),
            offset_deg: offset,
            spread_deg: all.spread_deg(),
            pixels: all.pixels,
            model: reconstructed.model,
            seconds: begun.elapsed().as_secs_f64(),
        })
    }
}

impl Options {
    fn doubts(&self, all: Mean, model_is_known: bool) -> Vec<String> {
        let mut doubts = vec![];
        if !model_is_known {
            doubts.push(
                "the map states no error of its model, so the offset may be off by more than its standard deviation: see \
                 the warnings of the map"
                    .into(),
            );
        }
        if all.spread_deg() > UNIFORM_DEG {
            doubts.push(format!(
                "the orientations differ from the known ones by {:.1}° (standard deviation): give a --region of the \
                 known sample alone",
                all.spread_deg()
            ));
        }
        if self.known_deg.is_some() && self.known_sigma_deg == 0.0 {
            doubts.push("the direction of the sample is taken as exact: state --known-sigma-deg".into());
        }
        doubts
    }
}

impl Summary for Report {
    fn summary(&self) -> String {
        format!(
            "offset    {:.3}° ± {:.3}° (model {})\nregion    {} pixels, spread {:.2}°\n{}time      {:.1} s",
            self.offset_deg.value,
            self.offset_deg.sigma,
            self.model,
            self.pixels,
            self.spread_deg,
            lines(&[], &self.warnings),
            self.seconds
        )
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
