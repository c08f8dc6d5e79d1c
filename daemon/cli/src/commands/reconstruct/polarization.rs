//! `nacre reconstruct polarization`.

use crate::commands::Estimating;
use crate::commands::carry_out;
use crate::commands::values::PictureArgs;
use crate::console::Console;
use nacre_capture::Failure;
use nacre_polarimetry::{Align, Demosaic, Metal, Model, Oblique, Options, PeriodMethod, Smoothing};
use std::path::PathBuf;

/// Arguments of `nacre reconstruct polarization`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre reconstruct polarization session --out result
  nacre reconstruct polarization series/frames.json --out result --force --json
  nacre reconstruct polarization series --out result --model auto
  nacre reconstruct polarization sensor --out result --demosaic edge-aware
  nacre reconstruct polarization session --out result --offset-deg 12.5 --smooth strong
  nacre reconstruct polarization session --out result --contrast-period 1.2,3 --depth-um 0.1
  nacre reconstruct polarization session --out result --relative-period 0.7,2

The model plain writes stokes.exr (S0 S1 S2), aolp.exr (aolp dolp sigma sigma_dolp mask
correlation), aolp.png, dolp.png, sigma.png and report.json. Models of gratings write
orientation.exr (orientation sigma mask correlation) and orientation.png (smoothed) in place of
aolp.png; with periods also period.exr (period sigma mask) and period.png. Orientations are
relative: one unknown offset, common to all pixels, remains.")]
pub struct Polarization {
    /// Session folder, frames.json, or a folder holding one (`nacre import` makes one for your photographs).
    input: PathBuf,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// plain, or how the fitted phase becomes the orientation of a grating [default: auto for capture sessions, plain for other
    /// photographs].
    ///
    /// plain: Stokes parameters, angle and degree of linear polarization. auto takes the simplest of the models of gratings that explains
    /// the data; sinusoid: the phase is the orientation; prenormalized: the phase about the mean of all pixels; circle: the phase about the
    /// centre of the circle that they lie on; curve: the nearest place on the curve of the fitted film.
    #[arg(long, value_name = "MODEL")]
    model: Option<Model>,
    /// auto moves photographs that are shifted against each other back, where that is worth it; off leaves them [default: auto for models
    /// of gratings, off for plain].
    #[arg(long, value_name = "auto|off")]
    align: Option<Align>,
    /// auto takes out what oblique incidence does, where the photographs say where the camera stood and fit better with
    /// it; off leaves it, and σ holds it.
    #[arg(long, default_value = "off", value_name = "auto|off")]
    oblique: Oblique,
    /// Maps of a monochrome polarization sensor in full size: how images behind each polarizer are interpolated (model plain).
    ///
    /// none: one map pixel per 2×2 super-pixel, the fastest and least noisy. bilinear: means of the nearest pixels. edge-aware:
    /// along edges, by Newton polynomials of the difference between polarizers (Li et al. 2019).
    #[arg(long, default_value = "none", value_name = "none|bilinear|edge-aware")]
    demosaic: Demosaic,
    /// Degrees added to every orientation, where one is known.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    offset_deg: f64,
    /// How orientations are smoothed in pictures.
    ///
    /// none, light (10 rounds of a bilateral filter), strong (50), or a number of rounds. orientation.exr stays as measured.
    #[arg(long, default_value = "light", value_name = "STRENGTH")]
    smooth: Smoothing,
    /// Smooth orientation.exr and its σ as well.
    #[arg(long)]
    smooth_maps: bool,
    /// Heuristic periods from the brightness, scaled to MIN,MAX µm.
    ///
    /// As the 2018 paper does; only their order has a meaning, and any unevenness of light or reflectance shows as a period.
    #[arg(long, value_name = "MIN,MAX", value_parser = range, conflicts_with = "contrast_period")]
    relative_period: Option<[f64; 2]>,
    /// Periods from the degree of polarization, which are known to lie within MIN,MAX µm, for an assumed surface.
    ///
    /// Off by 11 to 18 % for every 10 % that the depth is off.
    #[arg(long, value_name = "MIN,MAX", value_parser = range, requires = "depth_um")]
    contrast_period: Option<[f64; 2]>,
    /// Assumed depth of the grating, peak to peak, in µm.
    #[arg(long, value_name = "UM", requires = "contrast_period", conflicts_with = "relative_period")]
    depth_um: Option<f64>,
    /// Assumed metal: aluminium, silver, gold, chromium (near 560 nm), or its refractive index N,K.
    #[arg(long, default_value = "aluminium", requires = "contrast_period", conflicts_with = "relative_period")]
    metal: Metal,
    /// Assumed refractive index of what lies on the metal.
    #[arg(
        long,
        default_value_t = 1.0,
        value_name = "N",
        requires = "contrast_period",
        conflicts_with = "relative_period"
    )]
    index_above: f64,
    /// Wavelength in nm, where the photographs do not say theirs.
    #[arg(long, value_name = "NM", requires = "contrast_period", conflicts_with = "relative_period")]
    wavelength_nm: Option<f64>,
    /// Largest acceptable error of a typical orientation in degrees, noise and model together; the results are
    /// written in any case, but the exit code is 1 when the estimate is larger or cannot be made.
    #[arg(long, value_name = "DEG")]
    max_error: Option<f64>,
    /// Also write smoothed.exr: the smoothed orientations at full size.
    #[arg(long)]
    smoothed_exr: bool,
    #[command(flatten)]
    pictures: PictureArgs,
    /// Replace results that are already in the folder.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

impl Polarization {
    /// Runs the reconstruction.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let options = Options {
            model: self.model,
            align: self.align,
            oblique: self.oblique,
            demosaic: self.demosaic,
            offset_deg: self.offset_deg,
            smooth: self.smooth,
            smooth_maps: self.smooth_maps,
            smoothed_exr: self.smoothed_exr,
            period: self.period(),
            palette: self.pictures.palette,
            no_scale_bar: self.pictures.bar.no_scale_bar,
            max_error: self.max_error,
        };
        carry_out(&options, &self.input, &self.out, self.force, console)
    }

    fn period(&self) -> Option<PeriodMethod> {
        if let Some(range_um) = self.relative_period {
            return Some(PeriodMethod::Brightness { range_um });
        }
        Some(PeriodMethod::Contrast {
            range_um: self.contrast_period?,
            depth_um: self.depth_um?,
            metal: self.metal,
            index_above: self.index_above,
            wavelength_nm: self.wavelength_nm,
        })
    }
}

/// Two numbers with a comma between them.
fn range(text: &str) -> Result<[f64; 2], String> {
    let two = text.split_once(',').and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    two.ok_or_else(|| format!("found {text:?}; give two numbers of µm such as 0.7,2"))
}
