//! Maps, pictures and radial profile of a table.

use super::figure::figure;
use super::lookup::{Table, UNKNOWN};
use super::report::Coverage;
use super::settings::Settings;
use super::table::Grid;
use nacre_base::Result;
use nacre_base::parallel::sum_in_order;
use nacre_image::{Attribute, OutputFolder, scalar_picture, write_exr, write_png8};
use nacre_optics::color::{Illuminant, displayed_codes};
use nacre_plot::png_from_svg;
use rayon::prelude::*;
use std::fmt::Write;

/// Coverage above which an entry counts as complete.
const FULL: f32 = 0.99;

/// Colour of unknown entries; brightness of the picture's ninth decile, relative to white, before compression.
const GRAY: [u8; 3] = [58, 58, 66];
const KEY: f32 = 0.4;

/// Pixels of the figure per unit of its page.
const FIGURE_ZOOM: f32 = 2.0;

/// Number of rings of the radial profile.
const RINGS: usize = 256;

/// Number of entries per partial sum of coverage; fixed, so that the mean does not depend on the number of threads.
const SUMMED: usize = 1 << 14;

/// A table and the options of its computation.
pub(super) struct Output<'a> {
    pub table: &'a Table,
    pub settings: &'a Settings,
}

impl Output<'_> {
    fn size(&self) -> usize {
        self.settings.size
    }

    fn grid(&self) -> Grid {
        Grid { size: self.size(), extent: self.table.extent, warp: self.settings.warp }
    }

    /// X, Y, Z and coverage; light is NaN for unknown entries.
    fn at(&self, i: usize) -> [f32; 4] {
        let [x, y, z, coverage] = self.table.entries[i];
        if coverage < UNKNOWN { [f32::NAN, f32::NAN, f32::NAN, coverage] } else { [x, y, z, coverage.min(1.0)] }
    }

    pub(super) fn coverage(&self) -> Coverage {
        let all = self.table.entries.len() as f64;
        let share = |count: usize| count as f64 / all;
        let counted =
            |keep: &(dyn Fn(f32) -> bool + Sync)| self.table.entries.par_iter().filter(|e| keep(e[3])).count();
        let of_block = |entries: &[[f32; 4]]| entries.iter().map(|e| f64::from(e[3].min(1.0))).sum::<f64>();
        Coverage {
            mean: sum_in_order(self.table.entries.par_chunks(SUMMED).map(of_block)) / all,
            full: share(counted(&|c| c >= FULL)),
            none: share(counted(&|c| c < UNKNOWN)),
        }
    }

    /// Writes `lut.exr`, `lut.png`, `figure.svg`, `figure.png`, `coverage.png` and `profile.csv`.
    pub(super) fn write(&self, folder: &OutputFolder) -> Result<()> {
        let size = self.size();
        let units = "X Y Z under this light, 1 for a photograph that is 1 everywhere (exponent 0); NaN where nothing was measured; \
                     coverage is the part that was measured";
        let light = Illuminant::of(&self.settings.illuminant)?;
        let white = light.white(self.settings.observer).unwrap_or([0.0, 1.0, 0.0]);
        let attributes = [
            ("units", Attribute::Text(units.into())),
            // Stored for readers without the illuminant's file.
            ("white", Attribute::Text(white.map(|v| format!("{v:.6}")).join(" "))),
            ("extent", Attribute::Text(self.table.extent.to_string())),
            ("warp", Attribute::Text(self.settings.warp.to_string())),
            ("illuminant", Attribute::Text(self.settings.illuminant.clone())),
        ];
        write_exr(&folder.path("lut.exr"), size, size, &["X", "Y", "Z", "coverage"], &attributes, &|c, y, row| {
            row.iter_mut().enumerate().for_each(|(x, out)| *out = self.at(y * size + x)[c]);
        })?;
        folder.sync("lut.exr")?;
        write_png8(&folder.path("lut.png"), size, size, 3, &self.picture())?;
        let luminance = |x: usize, y: usize| self.at(y * size + x)[1];
        let figure = figure(&self.grid(), &luminance, &self.settings.illuminant)?;
        folder.write("figure.svg", figure.as_bytes())?;
        folder.write("figure.png", &png_from_svg(&figure, FIGURE_ZOOM)?)?;
        let coverage = |x: usize, y: usize| Some(self.at(y * size + x)[3]);
        let title = "Coverage";
        let canvas =
            scalar_picture([size; 2], &coverage, [0.0, 1.0], "part of each entry that was measured", title, None);
        canvas.save_png(&folder.path("coverage.png"))?;
        folder.write("profile.csv", self.profile().as_bytes())
    }

    /// The picture in sRGB: nine tenths of the entries are darker than [`KEY`]; brighter ones are compressed.
    fn picture(&self) -> Vec<u8> {
        let entries = &self.table.entries;
        let step = (entries.len() >> 20).max(1);
        let mut light: Vec<f32> =
            (0..entries.len()).step_by(step).map(|i| self.at(i)[1]).filter(|y| *y > 0.0).collect();
        light.sort_by(f32::total_cmp);
        let scale = KEY / light.get(light.len() * 9 / 10).map_or(1.0, |y| y.max(f32::MIN_POSITIVE));
        let mut bytes = vec![0_u8; entries.len() * 3];
        bytes.par_chunks_mut(3).enumerate().for_each(|(i, out)| {
            let [x, y, z, coverage] = self.at(i);
            if y.is_nan() {
                out.copy_from_slice(&GRAY);
                return;
            }
            for ((out, code), unknown) in out.iter_mut().zip(displayed_codes([x, y, z].map(|v| v * scale))).zip(GRAY) {
                *out = (f32::from(code) * coverage + f32::from(unknown) * (1.0 - coverage) + 0.5) as u8;
            }
        });
        bytes
    }

    /// Means over rings around the zero order.
    fn profile(&self) -> String {
        let grid = self.grid();
        let mut rings = vec![[0.0_f64; 5]; RINGS];
        for i in 0..self.table.entries.len() {
            let radius = grid.at(i % grid.size).hypot(grid.at(i / grid.size)) / grid.extent;
            let [x, y, z, coverage] = self.at(i);
            // The corners lie outside of the last ring.
            let Some(ring) = rings.get_mut((radius * RINGS as f64) as usize) else { continue };
            ring[3] += f64::from(coverage);
            ring[4] += 1.0;
            if y.is_finite() {
                [x, y, z].iter().zip(&mut ring[..3]).for_each(|(v, sum)| *sum += f64::from(*v));
            }
        }
        let mut csv = String::from("half_vector,X,Y,Z,coverage\n");
        for (k, [x, y, z, coverage, count]) in rings.iter().enumerate().filter(|(_, r)| r[4] > 0.0) {
            let radius = (k as f64 + 0.5) / RINGS as f64 * grid.extent;
            let _ =
                writeln!(csv, "{radius:.6},{:e},{:e},{:e},{:.4}", x / count, y / count, z / count, coverage / count);
        }
        csv
    }
}
