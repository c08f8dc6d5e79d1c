//! Maps and pictures.

use super::answer::{Grating, Verdict};
use super::scan::Found;
use nacre_base::Result;
use nacre_image::{Attribute, OutputFolder, Palette, orientation_picture, scalar_picture, write_exr};

/// Contents of the output.
pub(super) struct Output<'a> {
    pub found: &'a Found,
    pub width: usize,
    pub height: usize,
    pub wavelength_nm: f64,
    pub pixel_um: Option<f64>,
    pub palette: Palette,
    pub scale_bar: bool,
    /// Relative σ common to all periods, from wavelength and distances.
    pub scale_sigma: f64,
    /// Standard deviation common to all orientations, in rad.
    pub turn_sigma: f64,
}

impl Output<'_> {
    /// Grating of a pixel, unless masked.
    fn at(&self, i: usize) -> Option<&Grating> {
        self.found.gratings[i].as_ref().filter(|_| self.found.verdicts[i] == Verdict::Resolved)
    }

    /// Period and its σ, including common errors.
    pub(super) fn period(&self, i: usize) -> Option<[f64; 2]> {
        self.at(i).map(|g| [g.period_um, g.period_sigma_um.hypot(self.scale_sigma * g.period_um)])
    }

    /// Writes `orientation.exr`, `period.exr` and their pictures.
    pub(super) fn write(&self, folder: &OutputFolder) -> Result<()> {
        let size = [self.width, self.height];
        self.exr(
            folder,
            "orientation.exr",
            "orientation, sigma: rad; mask: 1 measured, 0 masked",
            "orientation",
            |i| self.at(i).map(|g| [g.orientation, g.orientation_sigma.hypot(self.turn_sigma)].map(|v| v as f32)),
        )?;
        self.exr(folder, "period.exr", "period, sigma: um; mask: 1 found, 0 masked", "period", |i| {
            self.period(i).map(|p| p.map(|v| v as f32))
        })?;
        let turn = |x: usize, y: usize| self.at(y * size[0] + x).map(|g| g.orientation as f32);
        let bar_um = self.pixel_um.filter(|_| self.scale_bar);
        orientation_picture(size, &turn, "Orientation", self.palette, bar_um)
            .save_png(&folder.path("orientation.png"))?;
        let period = |x: usize, y: usize| self.at(y * size[0] + x).map(|g| g.period_um as f32);
        let [low, high] = self.range();
        let [many, few] = [low, high].map(|p| 1000.0 / p);
        let title = format!("Period\n{few:.0} to {many:.0} lines/mm");
        let label = format!("µm ({low:.2} is {many:.0} lines/mm, {high:.2} is {few:.0})");
        scalar_picture(size, &period, [low, high], &label, &title, bar_um).save_png(&folder.path("period.png"))
    }

    fn exr(
        &self,
        folder: &OutputFolder,
        name: &str,
        units: &str,
        channel: &str,
        value: impl Fn(usize) -> Option<[f32; 2]> + Sync,
    ) -> Result<()> {
        let mut attributes =
            vec![("units", Attribute::Text(units.into())), ("wavelength_nm", Attribute::Number(self.wavelength_nm))];
        attributes.extend(self.pixel_um.map(|um| ("pixel_um", Attribute::Number(um))));
        let fill = |c: usize, y: usize, row: &mut [f32]| {
            for (x, out) in row.iter_mut().enumerate() {
                let found = value(y * self.width + x);
                *out = match c {
                    2 => f32::from(u8::from(found.is_some())),
                    c => found.map_or(f32::NAN, |v| v[c]),
                };
            }
        };
        write_exr(&folder.path(name), self.width, self.height, &[channel, "sigma", "mask"], &attributes, &fill)?;
        folder.sync(name)
    }

    /// Range of the periods without the lowest and highest percent.
    fn range(&self) -> [f32; 2] {
        let mut known: Vec<f32> =
            (0..self.found.gratings.len()).filter_map(|i| self.at(i)).map(|g| g.period_um as f32).collect();
        known.sort_by(f32::total_cmp);
        let at = |share: usize| known.get(known.len().saturating_sub(1) * share / 100).copied().unwrap_or(1.0);
        let (low, high) = (at(1), at(99));
        if high > 1.02 * low { [low, high] } else { [0.99 * low, 1.01 * high] }
    }
}
