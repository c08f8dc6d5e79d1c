//! Maps and pictures.

use super::fit::{Found, Grating};
use super::report::Report;
use nacre_base::Result;
use nacre_image::{Attribute, Canvas, OutputFolder, orientation_picture, scalar_picture, write_exr};

/// Side in pixels up to which small maps are enlarged in pictures.
const SHOWN: usize = 640;

/// Contents of the output.
pub(super) struct Output<'a> {
    pub found: &'a [Found],
    pub report: &'a Report,
    pub scale_bar: bool,
}

impl Output<'_> {
    /// Writes `orientation.exr`, `period.exr` and their pictures.
    ///
    /// # Errors
    /// `Output`.
    pub fn write(&self, folder: &OutputFolder) -> Result<()> {
        let r = self.report;
        let (width, height) = (r.width, r.height);
        let at = |i: usize| if let Found::Grating(g) = &self.found[i] { Some(g) } else { None };
        let common = [
            ("pixel_um", Attribute::Number(r.pixel_um)),
            ("wavelength_nm", Attribute::Number(r.wavelength_nm)),
            ("method", Attribute::Text("flash".into())),
        ];
        let with = |units: &str| [&[("units", Attribute::Text(units.into()))], &common[..]].concat();
        let row = |y: usize, row: &mut [f32], value: &dyn Fn(&Grating) -> f64| {
            for (x, out) in row.iter_mut().enumerate() {
                *out = at(y * width + x).map_or(f32::NAN, |g| value(g) as f32);
            }
        };
        let mask = |y: usize, row: &mut [f32]| {
            row.iter_mut().enumerate().for_each(|(x, m)| *m = f32::from(u8::from(at(y * width + x).is_some())));
        };
        let units = with("orientation, sigma: rad; mask: 1 measured, 0 masked");
        let channels = ["orientation", "sigma", "mask"];
        write_exr(&folder.path("orientation.exr"), width, height, &channels, &units, &|c, y, out| match c {
            // A value just below π may round up to it as a float.
            0 => row(y, out, &|g| if g.orientation as f32 >= std::f32::consts::PI { 0.0 } else { g.orientation }),
            1 => row(y, out, &|g| g.orientation_sigma),
            _ => mask(y, out),
        })?;
        let relative = if r.relative { " (relative)" } else { "" };
        let units = with(&format!("period, sigma: um{relative}; mask: 1 measured, 0 masked"));
        let channels = ["period", "sigma", "mask"];
        write_exr(&folder.path("period.exr"), width, height, &channels, &units, &|c, y, out| match c {
            0 => row(y, out, &|g| self.period(g)),
            1 => row(y, out, &|g| self.period_sigma(g)),
            _ => mask(y, out),
        })?;
        self.pictures(folder, &at)
    }

    /// Period in µm.
    fn period(&self, g: &Grating) -> f64 {
        self.report.wavelength_nm / 1000.0 / g.length
    }

    /// Standard deviation of the period, including the common part.
    fn period_sigma(&self, g: &Grating) -> f64 {
        self.period(g) * (g.length_sigma / g.length).hypot(self.report.common_sigma)
    }

    fn pictures<'a>(&'a self, folder: &OutputFolder, at: &(dyn Fn(usize) -> Option<&'a Grating> + Sync)) -> Result<()> {
        let r = self.report;
        // Tiles are small, so each pixel is drawn as a square.
        let zoom = (SHOWN / r.width.max(r.height).max(1)).clamp(1, 16);
        let size = [zoom * r.width, zoom * r.height];
        let bar_um = self.scale_bar.then(|| r.pixel_um / zoom as f64);
        let shown = |x: usize, y: usize| at(y / zoom * r.width + x / zoom);
        let save = |picture: Canvas, name: &str| picture.save_png(&folder.path(name));
        let orientation = |x: usize, y: usize| shown(x, y).map(|g| g.orientation as f32);
        let title = "Orientation\nflash photographs";
        save(orientation_picture(size, &orientation, title, r.palette, bar_um), "orientation.png")?;
        let of = |g: &Grating| (1000.0 / self.period(g)) as f32;
        let lines = |x: usize, y: usize| shown(x, y).map(of);
        let values = |of: &dyn Fn(&Grating) -> f32| {
            let mut all: Vec<f32> = (0..self.found.len()).filter_map(|i| at(i).map(of)).collect();
            all.sort_by(f32::total_cmp);
            all
        };
        let all = values(&of);
        let at_share = |share: usize| all.get(all.len().saturating_sub(1) * share / 100).copied().unwrap_or(600.0);
        let [low, high] = [at_share(1), at_share(99)];
        // A single period is drawn in the middle colour of a scale of some width.
        let least = 0.02 * high;
        let [low, high] = if high - low > least { [low, high] } else { [low - least, high + least] };
        let label = if r.relative { "lines per mm (relative)" } else { "lines per mm" };
        save(scalar_picture(size, &lines, [low, high], label, "Period", bar_um), "period.png")?;
        let degrees = |g: &Grating| g.orientation_sigma.to_degrees() as f32;
        let sigma = |x: usize, y: usize| shown(x, y).map(degrees);
        let all = values(&degrees);
        let top = all.get(all.len() * 98 / 100).copied().unwrap_or(1.0);
        let label = "σ of the orientation (°)";
        save(scalar_picture(size, &sigma, [0.0, top], label, "Uncertainty", bar_um), "sigma.png")
    }
}
