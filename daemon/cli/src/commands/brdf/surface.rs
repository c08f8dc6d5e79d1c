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

Without --pixel-um, pixels are as fine as light at 75 degrees needs, periods are whole pixels, and the patch holds whole
periods where the angle is a multiple of 90. Writes FILE.exr (height in µm, with the pixel pitch) and FILE.png (a picture).")]
pub struct Surface {
    /// What it is.
    shape: Kind,
    /// Period in µm.
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    period_um: f64,
    /// From the lowest to the highest point in µm.
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    depth_um: f64,
    /// Part of the period that is high, of a rectangular grating.
    #[arg(long, default_value_t = 0.5, allow_negative_numbers = true)]
    duty: f64,
    /// Direction of the grating vector, anticlockwise from the right, in degrees.
    #[arg(long, default_value_t = 0.0, value_name = "DEG", allow_negative_numbers = true)]
    angle: f64,
    /// Pixels of a row and of a column; without --pixel-um at most so many.
    #[arg(long, default_value_t = 256)]
    pixels: usize,
    /// Size of a pixel in µm.
    #[arg(long, value_name = "P", allow_negative_numbers = true)]
    pixel_um: Option<f64>,
    /// The height field.
    #[arg(long, value_name = "FILE.exr")]
    out: PathBuf,
    #[command(flatten)]
    bar: BarArgs,
    /// Replace files that are there.
    #[arg(long)]
    force: bool,
}

/// Shapes by name.
#[derive(Clone, Copy, ValueEnum)]
enum Kind {
    /// A sinusoid.
    Sinusoid,
    /// Rises evenly and falls at once.
    Blazed,
    /// High over a part of the period.
    Rectangular,
    /// Tracks of a disc, with pits.
    Cd,
    /// Two gratings side by side, the second 8 % wider and turned by 6°.
    TwoRegions,
    /// Rows of fingers, as on a snake's scale.
    Fingers,
}

/// Finest pitch that light at 75° needs at 380 nm, a little less than λ/(2 (1 + sin θ)).
const FINE_UM: f64 = 0.095;

#[derive(Serialize)]
struct Report<'a> {
    surface: &'a Synthetic,
    quality: &'a Quality,
    files: Vec<PathBuf>,
}

impl Surface {
    /// Pixels, at most as many as asked for, and their pitch.
    fn whole(&self) -> (usize, f64) {
        let per_period = (self.period_um / FINE_UM).ceil().max(4.0);
        let periods = (self.pixels as f64 / per_period).floor();
        if periods.is_nan() || periods < 1.0 {
            return (self.pixels, FINE_UM);
        }
        ((periods * per_period) as usize, self.period_um / per_period)
    }

    /// Makes and writes it.
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
        // Whole pixels in a period and whole periods in the patch, so that it can be repeated.
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
