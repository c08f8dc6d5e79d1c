//! `nacre brdf surface`.

use crate::commands::values::BarArgs;
use crate::console::Console;
use clap::ValueEnum;
use nacre_base::operation::lines;
use nacre_base::{Error, vacant};
use nacre_brdf::height::{Profile, Quality, Shape, Synthetic};
use nacre_brdf::output::write_height;
use nacre_capture::Failure;
use serde::Serialize;
use std::path::PathBuf;

/// Arguments of `nacre brdf surface`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf surface blazed --period-um 2.5 --depth-um 0.3 --out blazed.exr
  nacre brdf surface fingers --period-um 1.15 --depth-um 0.4 --pixels 512 --pixel-um 0.09 --angle 20 --out snake.exr

Without --pixel-um, pixels are fine enough for light at 75 degrees, and a period is a whole number of pixels. The patch
then holds whole periods if the angle is a multiple of 90. Writes FILE.exr (height in µm, with the pixel pitch) and
FILE.png (picture).")]
pub struct Surface {
    /// Shape of the surface.
    shape: Kind,
    /// Period in µm.
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    period_um: f64,
    /// Peak-to-valley depth in µm.
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    depth_um: f64,
    /// Duty cycle of a rectangular grating: raised fraction of the period (0 to 1, exclusive).
    #[arg(long, default_value_t = 0.5, allow_negative_numbers = true)]
    duty: f64,
    /// Direction of the grating vector, anticlockwise from the right, in degrees.
    #[arg(long, default_value_t = 0.0, value_name = "DEG", allow_negative_numbers = true)]
    angle: f64,
    /// Width and height in pixels; an upper bound without --pixel-um.
    #[arg(long, default_value_t = 256)]
    pixels: usize,
    /// Pixel pitch in µm (default: as fine as light at 75° needs).
    #[arg(long, value_name = "P", allow_negative_numbers = true)]
    pixel_um: Option<f64>,
    /// Height field (EXR); a picture (PNG) is written beside it.
    #[arg(long, value_name = "FILE.exr")]
    out: PathBuf,
    #[command(flatten)]
    bar: BarArgs,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
}

/// Shapes.
#[derive(Clone, Copy, ValueEnum)]
enum Kind {
    /// Sinusoidal grating.
    Sinusoid,
    /// Blazed grating: linear rise, vertical drop.
    Blazed,
    /// Rectangular grating with duty cycle --duty.
    Rectangular,
    /// Disc tracks with pits.
    Cd,
    /// Two gratings side by side; the second has an 8 % larger period and is rotated by 6°.
    TwoRegions,
    /// Rows of fingers, as on a snake's scale.
    Fingers,
}

/// Pixel pitch that light at 75° requires at 380 nm: slightly below λ/(2 (1 + sin θ)).
const FINE_UM: f64 = 0.095;

#[derive(Serialize)]
struct Report<'a> {
    surface: &'a Synthetic,
    quality: &'a Quality,
    files: Vec<PathBuf>,
}

impl Surface {
    /// Number of pixels for whole periods (at most `--pixels`), and the pixel pitch in µm.
    fn whole(&self) -> (usize, f64) {
        let per_period = (self.period_um / FINE_UM).ceil().max(4.0);
        let periods = (self.pixels as f64 / per_period).floor();
        if periods.is_nan() || periods < 1.0 {
            return (self.pixels, FINE_UM);
        }
        ((periods * per_period) as usize, self.period_um / per_period)
    }

    /// Generates and writes the height field.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let picture = self.out.with_extension("png");
        let files = vec![self.out.clone(), picture.clone()];
        vacant(&files, self.force)?;
        if !(self.duty > 0.0 && self.duty < 1.0) {
            return Err(Error::input("--duty", format!("is {}", self.duty), "give a number between 0 and 1").into());
        }
        if !self.angle.is_finite() {
            return Err(Error::input("--angle", "is no number", "give degrees").into());
        }
        let shape = match self.shape {
            Kind::Sinusoid => Shape::Grating(Profile::Sinusoid),
            Kind::Blazed => Shape::Grating(Profile::Blazed),
            Kind::Rectangular => Shape::Grating(Profile::Rectangular { duty: self.duty }),
            Kind::Cd => Shape::Cd,
            Kind::TwoRegions => Shape::TwoRegions,
            Kind::Fingers => Shape::Fingers,
        };
        // Whole pixels per period and whole periods per patch make the patch tileable.
        let (pixels, pixel_um) = self.pixel_um.map_or_else(|| self.whole(), |um| (self.pixels, um));
        let surface = Synthetic {
            shape,
            pixels,
            pixel_um,
            period_um: self.period_um,
            depth_um: self.depth_um,
            angle: self.angle.to_radians(),
        };
        let field = surface.field()?;
        write_height(&self.out, Some((&picture, !self.bar.no_scale_bar)), &field)?;
        let quality = Quality::of(&field, 65.0);
        let text = format!(
            "surface   {0} × {0} pixels of {1:.5} µm\n{2}wrote     {3}\nwrote     {4}",
            surface.pixels,
            surface.pixel_um,
            lines(&[], &quality.warnings),
            self.out.display(),
            picture.display()
        );
        console.result(&text, &Report { surface: &surface, quality: &quality, files });
        Ok(())
    }
}
