//! Options of the bokeh reconstruction.

use super::deconvolution::{Iterations, Noise, Psf};
use super::height::{Calibration, KnownGrating};
use super::lens::{Cutoff, Lens};
use super::noise_estimate;
use super::photograph::{Crop, Light, Photograph};
use super::reconstruct::{check_input, sharpen_into};
use super::report::Report;
use super::slice::Line;
use nacre_base::estimate::Work;
use nacre_base::operation::Operation;
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::NoiseModel;
use nacre_frames::Transfer;
use nacre_image::read;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Default width in pixels over which a slice is averaged.
pub const SLICE_WIDTH: usize = 15;

/// Default wavelength in nm (blue light).
const BLUE_NM: f64 = 450.0;

/// The point spread function of the lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PsfChoice {
    /// Standard deviation of a Gaussian blur in pixels.
    #[schemars(extend("x-bare" = 2.0, "x-placeholder" = "PX"))]
    Sigma(f64),
    /// Image of a point, of odd width and height with the point in its middle.
    #[schemars(extend("x-file" = true, "x-flag" = "psf", "x-placeholder" = "IMAGE"))]
    Image(PathBuf),
}

/// Known size of a pixel on the sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum KnownScale {
    /// Not known.
    #[default]
    Unknown,
    /// Size of a pixel on the sample in µm.
    #[schemars(extend("x-flag" = "pixel-um", "x-placeholder" = "UM"))]
    Pixel(f64),
    /// From the line density of the grating.
    Lines {
        /// Line density of the grating in lines per mm, which gives the size of a pixel once they are counted.
        #[schemars(extend("x-flag" = "lines-per-mm", "x-placeholder" = "L"))]
        per_mm: f64,
        /// Number of lines that the slice crosses (default: counted).
        #[serde(default)]
        #[schemars(extend("x-flag" = "lines", "x-placeholder" = "N"))]
        count: Option<f64>,
    },
}

/// Reconstruct height and lines of a grating from a photograph of an out-of-focus highlight on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "BokehOptions", extend(
    "x-input" = "Photograph of the highlight (PNG, TIFF, JPEG, EXR), results of `reconstruct hdr`, or a session of exposures, which are merged first",
    "x-examples" = "\
Examples:
  nacre reconstruct bokeh cd.png --psf-sigma 2.5 --crop 900,700,800,800 --rotate-deg 90 --out result
  nacre reconstruct bokeh grating.jpg --psf-sigma 2 --lines-per-mm 50 --lens-focal-mm 250 --f-number 5.6 \\
      --distance-m 0.85 --known-shape blazed --known-depth-um 0.4 --out known
  nacre reconstruct bokeh phone.jpg --psf-sigma 2 --pixel-um 1.2 --calibration known/calibration.json --out phone

Writes deconvolved.exr (Y), height.exr (height), their pictures, slice.csv, report.json, and calibration.json
where a known grating was given. Dark is deep; heights are relative without a calibration."
))]
pub struct Options {
    /// Blur of the lens, which is removed: standard deviation of a Gaussian in pixels, or an image of a point.
    #[schemars(extend("title" = "Point spread function", "x-expand" = true))]
    pub psf: PsfChoice,
    /// Channel of a colour photograph.
    #[serde(default, alias = "light")]
    #[schemars(extend("title" = "Channel"))]
    pub channel: Light,
    /// Transfer function of the photograph (default: sRGB for JPEG, else linear).
    #[serde(default)]
    pub transfer: Option<Transfer>,
    /// Part of the photograph: left, top, width and height in pixels (default: all of it).
    #[serde(default)]
    #[schemars(extend("x-placeholder" = "X,Y,W,H"))]
    pub crop: Option<Crop>,
    /// Rotation of the result in degrees, anticlockwise; multiples of 90 are exact.
    #[serde(default)]
    #[schemars(extend("x-advanced" = true, "x-aliases" = ["rotate"]))]
    pub rotate_deg: f64,
    /// Number of iterations; auto stops where they find more noise than structure.
    #[serde(default)]
    #[schemars(extend("x-placeholder" = "auto|N"))]
    pub iterations: Iterations,
    /// Noise of the camera: electrons at white and read noise in electrons (default: estimated from the photograph).
    #[serde(default)]
    #[schemars(extend("x-advanced" = true, "x-list" = true, "x-unset" = "auto", "x-placeholder" = "auto|FULL_E,READ_E"))]
    pub noise: Option<NoiseModel>,
    /// Accelerate iterations by extrapolation; plain Richardson-Lucy needs several times as many.
    #[serde(default = "yes")]
    #[schemars(extend("x-advanced" = true))]
    pub accelerate: bool,
    /// Calibration of light to height (calibration.json of an earlier result).
    #[serde(default)]
    #[schemars(extend("x-advanced" = true, "x-file" = true))]
    pub calibration: Option<Calibration>,
    /// Known grating, from which light is calibrated to height.
    #[serde(default)]
    #[schemars(extend("x-advanced" = true, "title" = "Known grating"))]
    pub known: Option<KnownGrating>,
    /// Size of a pixel on the sample in µm, or line density of the grating.
    #[serde(default)]
    #[schemars(extend("title" = "Scale", "x-expand" = true))]
    pub scale: KnownScale,
    /// The lens, which gives its cut-off.
    #[serde(default)]
    pub lens: Option<Lens>,
    /// Wavelength of the light in nm.
    #[serde(default = "blue_nm")]
    #[schemars(extend("x-aliases" = ["wavelength"]))]
    pub wavelength_nm: f64,
    /// Ends of the slice across the lines: x0, y0, x1, y1 in pixels (default: across the middle).
    #[serde(default)]
    #[schemars(extend("x-placeholder" = "X0,Y0,X1,Y1"))]
    pub slice: Option<Line>,
    /// Width of the slice in pixels, over which it is averaged.
    #[serde(default = "slice_width")]
    #[schemars(extend("x-advanced" = true))]
    pub slice_width: usize,
    /// Leave the scale bar out of pictures. They have one where the size of a pixel is known.
    #[serde(default)]
    #[schemars(extend("x-advanced" = true))]
    pub no_scale_bar: bool,
}

fn yes() -> bool {
    true
}

fn blue_nm() -> f64 {
    BLUE_NM
}

fn slice_width() -> usize {
    SLICE_WIDTH
}

impl Operation for Options {
    const NAME: &'static str = "bokeh";
    const TITLE: &'static str = "Height and lines of a grating, from a photograph of an out-of-focus highlight on it";
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        self.check().map(drop)
    }

    fn check(&self, input: &Path) -> Result<Work> {
        check_input(input, self)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        sharpen_into(out, input, self, progress)
    }
}

impl Options {
    /// Options with default values.
    pub fn new(psf: PsfChoice) -> Self {
        Self {
            psf,
            channel: Light::default(),
            transfer: None,
            crop: None,
            rotate_deg: 0.0,
            iterations: Iterations::default(),
            noise: None,
            accelerate: true,
            calibration: None,
            known: None,
            scale: KnownScale::Unknown,
            lens: None,
            wavelength_nm: BLUE_NM,
            slice: None,
            slice_width: SLICE_WIDTH,
            no_scale_bar: false,
        }
    }

    /// Validates the options before any file is read; returns the resolution limits of the lens.
    ///
    /// # Errors
    /// `Input`, naming the option.
    pub fn check(&self) -> Result<Option<Cutoff>> {
        let bad = |name: &str, value: f64, wanted: &str| {
            Err(Error::input(name, format!("is {value}; expected {wanted}"), "correct it"))
        };
        if !(-3600.0..=3600.0).contains(&self.rotate_deg) {
            return bad("rotate_deg", self.rotate_deg, "-3600 to 3600 degrees");
        }
        if !(1..=10_000).contains(&self.slice_width) {
            return bad("slice_width", self.slice_width as f64, "1 to 10000 pixels");
        }
        if let Some(noise) = self.noise
            && !(noise.full_scale_e > 0.0 && noise.full_scale_e < 1e12 && (0.0..1e9).contains(&noise.read_noise_e))
        {
            return bad(
                "noise",
                noise.full_scale_e,
                "electrons at white above 0, and read noise of at least 0 electrons",
            );
        }
        if let PsfChoice::Sigma(sigma) = self.psf {
            Psf::gaussian(sigma)?;
        }
        if let Some(calibration) = &self.calibration {
            calibration.check()?;
            if self.known.is_some() {
                return Err(Error::input("calibration", "and a known grating are both given", "give one of them"));
            }
        }
        self.transfer.map_or(Ok(()), Transfer::check_known)?;
        let cutoff = self.lens.map(|lens| lens.cutoff(self.wavelength_nm)).transpose()?;
        match self.scale {
            KnownScale::Pixel(um) if !(um > 0.0 && um < 1e6) => return bad("scale.pixel", um, "above 0"),
            KnownScale::Lines { per_mm, count } => {
                if !(per_mm > 0.0 && per_mm < 1e5) {
                    return bad("scale.lines.per_mm", per_mm, "above 0");
                }
                if let Some(n) = count.filter(|n| !(*n >= 1.0 && *n < 1e6)) {
                    return bad("scale.lines.count", n, "at least 1");
                }
                cutoff.map_or(Ok(()), |c| c.check(1000.0 / per_mm, "scale.lines.per_mm"))?;
            }
            _ => {}
        }
        Ok(cutoff)
    }

    pub(super) fn transfer_of(&self, path: &Path) -> Transfer {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let jpeg = extension.is_some_and(|e| e == "jpg" || e == "jpeg");
        self.transfer.unwrap_or(if jpeg { Transfer::Srgb } else { Transfer::Linear })
    }

    pub(super) fn psf(&self) -> Result<(Psf, String)> {
        match &self.psf {
            PsfChoice::Sigma(sigma) => Ok((Psf::gaussian(*sigma)?, format!("Gaussian, σ {sigma} px"))),
            PsfChoice::Image(path) => Ok((Psf::image(&read(path)?)?, path.display().to_string())),
        }
    }

    /// The noise model, and whether it was given rather than estimated.
    pub(super) fn noise(&self, photograph: &Photograph) -> Option<(Noise, bool)> {
        match self.noise {
            Some(model) => {
                let floor = (model.read_noise_e / model.full_scale_e).powi(2) + photograph.step.powi(2) / 12.0;
                Some((Noise { shot: 1.0 / model.full_scale_e, floor }, true))
            }
            None => {
                noise_estimate::estimate_noise(&photograph.light, photograph.width, photograph.height, photograph.step)
                    .map(|noise| (noise, false))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_can_be_written_in_plans() {
        let text = "psf = { sigma = 2.5 }\nscale = { lines = { per_mm = 50 } }\niterations = { count = 30 }\ncrop = [1, 2, 3, 4]";
        let options: Options = toml::from_str(text).unwrap();
        let lines = KnownScale::Lines { per_mm: 50.0, count: None };
        let wanted = Options {
            scale: lines,
            iterations: Iterations::Count(30),
            crop: Some(Crop([1, 2, 3, 4])),
            ..Options::new(PsfChoice::Sigma(2.5))
        };
        assert_eq!(options, wanted);
        assert!(toml::from_str::<Options>("rotate_deg = 90").is_err(), "the blur must be said");
    }
}
