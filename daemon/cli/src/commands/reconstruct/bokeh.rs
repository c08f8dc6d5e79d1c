//! `nacre reconstruct bokeh`.

use crate::commands::Estimating;
use crate::commands::carry_out;
use crate::commands::values::{BarArgs, numbers, transfer};
use crate::console::Console;
use clap::ValueEnum;
use nacre_capture::Failure;
use nacre_frames::Transfer;
use nacre_lut::bokeh::deconvolution::Iterations;
use nacre_lut::bokeh::{
    self, Calibration, Crop, KnownGrating, KnownScale, Lens, Light, Line, Options, PsfChoice, Shape,
};
use nacre_polarimetry::NoiseModel;
use std::path::PathBuf;

/// Arguments of `nacre reconstruct bokeh`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre reconstruct bokeh cd.png --psf-sigma 2.5 --crop 900,700,800,800 --rotate 90 --out result
  nacre reconstruct bokeh grating.jpg --psf-sigma 2 --lines-per-mm 50 --lens-focal-mm 250 --f-number 5.6 \\
      --distance-m 0.85 --known-shape blazed --known-depth-um 0.4 --out known
  nacre reconstruct bokeh phone.jpg --psf-sigma 2 --pixel-um 1.2 --calibration known/calibration.json --out phone

Writes deconvolved.exr (Y), height.exr (height), their pictures, slice.csv, report.json, and calibration.json
where a known grating was given. Dark is deep; heights are relative without a calibration.")]
pub struct Bokeh {
    /// The photograph (PNG, TIFF, JPEG, EXR), results of `reconstruct hdr`, or a session of exposures, which are merged first.
    image: PathBuf,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// Standard deviation of the blur in pixels, taken for a Gaussian.
    #[arg(long, value_name = "PX", allow_negative_numbers = true, required_unless_present = "psf")]
    psf_sigma: Option<f64>,
    /// Image of what the lens makes of a point, of odd width and height with the point in its middle.
    #[arg(long, value_name = "IMAGE", conflicts_with = "psf_sigma")]
    psf: Option<PathBuf>,
    /// Part of the photograph: column and row of its upper left corner, width, height.
    #[arg(long, value_name = "X,Y,W,H", value_parser = crop)]
    crop: Option<Crop>,
    /// Turns the result anticlockwise, by any angle; multiples of 90 are exact.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    rotate: f64,
    /// Light of a colour photograph that is taken.
    #[arg(long, default_value = "blue")]
    channel: ChannelName,
    /// How values grow with light: linear, srgb or gamma=NUMBER; srgb for JPEG and linear otherwise if not said.
    #[arg(long, value_parser = transfer)]
    transfer: Option<Transfer>,
    /// A number, or auto: until another one would fit more noise than structure.
    #[arg(long, value_name = "N|auto", default_value = "auto", allow_negative_numbers = true, value_parser = iterations)]
    iterations: Iterations,
    /// auto (from the photograph itself), or the camera's electrons at white and read noise in electrons.
    #[arg(long, value_name = "auto|FULL_E,READ_E", default_value = "auto", value_parser = noise)]
    noise: Noise,
    /// Plain Richardson-Lucy, which needs several times as many iterations.
    #[arg(long)]
    no_accelerate: bool,
    /// The calibration.json (or .toml) of an earlier run with a known grating.
    #[arg(long, value_name = "FILE", conflicts_with = "known_shape")]
    calibration: Option<PathBuf>,
    /// Shape of the grating in the photograph, if it is known: makes a calibration.
    #[arg(long, requires = "known_depth_um")]
    known_shape: Option<ShapeName>,
    /// From its lowest to its highest point, in µm.
    #[arg(long, value_name = "UM", requires = "known_shape", allow_negative_numbers = true)]
    known_depth_um: Option<f64>,
    /// Size of a pixel on the sample.
    #[arg(long, value_name = "UM", allow_negative_numbers = true, conflicts_with = "lines_per_mm")]
    pixel_um: Option<f64>,
    /// Lines per mm of the grating, which tells the size of a pixel once they are counted.
    #[arg(long, value_name = "L", allow_negative_numbers = true)]
    lines_per_mm: Option<f64>,
    /// Lines that the slice crosses; counted if not said.
    #[arg(long, value_name = "N", requires = "lines_per_mm", allow_negative_numbers = true)]
    lines: Option<f64>,
    /// Focal length of the lens; with the next two it tells what the lens can show.
    #[arg(long, value_name = "F", requires_all = ["f_number", "distance_m"], allow_negative_numbers = true)]
    lens_focal_mm: Option<f64>,
    /// Focal length over aperture.
    #[arg(long, value_name = "N", requires = "lens_focal_mm", allow_negative_numbers = true)]
    f_number: Option<f64>,
    /// From the lens to the sample.
    #[arg(long, value_name = "D", requires = "lens_focal_mm", allow_negative_numbers = true)]
    distance_m: Option<f64>,
    /// Wavelength of the light that is taken.
    #[arg(long, value_name = "NM", default_value_t = 450.0, allow_negative_numbers = true)]
    wavelength: f64,
    /// From one point of the result to another, across the lines; across its middle if not said.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = line)]
    slice: Option<Line>,
    /// Pixels across that the slice is the mean of.
    #[arg(long, value_name = "PX", default_value_t = bokeh::SLICE_WIDTH)]
    slice_width: usize,
    #[command(flatten)]
    bar: BarArgs,
    /// Replace results that are already in the folder.
    #[arg(long, visible_alias = "overwrite")]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

#[derive(Clone, Copy, ValueEnum)]
enum ChannelName {
    Red,
    Green,
    Blue,
    Luminance,
}

#[derive(Clone, Copy, ValueEnum)]
enum ShapeName {
    Sinusoid,
    Blazed,
    Rectangular,
}

/// Where noise comes from.
#[derive(Clone, Copy)]
enum Noise {
    Auto,
    Given(NoiseModel),
}

fn crop(text: &str) -> Result<Crop, String> {
    numbers(text, "column, row, width and height: 100,50,640,480").map(Crop)
}

fn line(text: &str) -> Result<Line, String> {
    numbers(text, "two points: 0,240,639,240").map(Line)
}

fn iterations(text: &str) -> Result<Iterations, String> {
    match (text, text.parse()) {
        ("auto", _) => Ok(Iterations::default()),
        (_, Ok(n)) => Ok(Iterations::Count(n)),
        _ => Err("give auto, or a number above 0".into()),
    }
}

fn noise(text: &str) -> Result<Noise, String> {
    if text == "auto" {
        return Ok(Noise::Auto);
    }
    let [full_scale_e, read_noise_e] = numbers(text, "auto, or electrons at white and of read noise: 20000,8")?;
    Ok(Noise::Given(NoiseModel { full_scale_e, read_noise_e }))
}

impl Bokeh {
    /// Runs the reconstruction.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        carry_out(&self.options()?, &self.image, &self.out, self.force, console)
    }

    fn options(&self) -> Result<Options, Failure> {
        let psf = match (&self.psf, self.psf_sigma) {
            (Some(path), _) => PsfChoice::Image(path.clone()),
            (None, sigma) => PsfChoice::Sigma(sigma.unwrap_or_default()),
        };
        let known = self.known_shape.zip(self.known_depth_um).map(|(shape, depth_um)| {
            let shape = match shape {
                ShapeName::Sinusoid => Shape::Sinusoid,
                ShapeName::Blazed => Shape::Blazed,
                ShapeName::Rectangular => Shape::Rectangular,
            };
            KnownGrating { shape, depth_um }
        });
        let lens = self.lens_focal_mm.zip(self.f_number).zip(self.distance_m);
        Ok(Options {
            light: match self.channel {
                ChannelName::Red => Light::Red,
                ChannelName::Green => Light::Green,
                ChannelName::Blue => Light::Blue,
                ChannelName::Luminance => Light::Luminance,
            },
            transfer: self.transfer,
            crop: self.crop,
            rotate_deg: self.rotate,
            iterations: self.iterations,
            noise: match self.noise {
                Noise::Auto => None,
                Noise::Given(model) => Some(model),
            },
            accelerate: !self.no_accelerate,
            calibration: self.calibration.as_deref().map(Calibration::read).transpose()?,
            known,
            scale: match (self.pixel_um, self.lines_per_mm) {
                (Some(um), _) => KnownScale::Pixel(um),
                (None, Some(per_mm)) => KnownScale::Lines { per_mm, count: self.lines },
                (None, None) => KnownScale::Unknown,
            },
            lens: lens.map(|((focal_mm, f_number), distance_m)| Lens { focal_mm, f_number, distance_m }),
            wavelength_nm: self.wavelength,
            slice: self.slice,
            slice_width: self.slice_width,
            no_scale_bar: self.bar.no_scale_bar,
            ..Options::new(psf)
        })
    }
}
