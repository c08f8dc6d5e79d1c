//! Flash photographs of a sheet of repeated tiles, such as holographic gift paper (2018 paper, sections 4 and 7.1).
//!
//! Every pixel is a ray to a point of the sheet with its own directions to the camera and to each point of the light.
//! Radiance is summed over the light's area and the filter's band. Each order is a Gaussian in direction cosines,
//! whose width is set by the coherence and whose integral is its exact efficiency. No formulas are shared with the
//! reconstruction.

mod pattern;
mod render;
mod score;
#[cfg(test)]
mod tests;

pub use pattern::{Grooves, Pattern, Periods};
pub use score::Score;

use super::bracket::{bracket, check_exposures};
use crate::random::{key, uniform};
use nacre_base::{Error, Result};
use nacre_frames::Frame;
use nacre_image::{Attribute, OutputFolder, write_exr};
use nacre_optics::geometry;
use nacre_optics::geometry::{Camera, Geometry, Pose};
use pattern::Tile;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A scene with a tiled sheet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TilesPhotograph {
    /// Seed of polygons, misalignments and noise.
    pub seed: u64,
    /// Number of tiles to the right and down.
    pub tiles: [usize; 2],
    /// Width and height of a tile in mm.
    pub tile_mm: [f64; 2],
    /// Pattern of a tile.
    pub pattern: Pattern,
    /// Largest misalignment of a tile along each axis, in pixels of the photograph.
    pub misaligned_px: f64,
    /// Tilt of the sheet about the axes to the right and up in degrees, unknown to the geometry.
    pub tilt_deg: [f64; 2],
    /// Height of the sheet's centre above its left and right edge in mm: a cylinder.
    pub bow_mm: f64,
    /// Standard deviation of the coherence function on the surface in µm.
    pub coherence_um: f64,
    /// Centre wavelength of the filter in nm.
    pub wavelength_nm: f64,
    /// Full width at half maximum of the filter's band in nm.
    pub band_nm: f64,
    /// Positions of the light relative to the sheet's centre in mm (right, up, above), one photograph each.
    pub lights_mm: Vec<[f64; 3]>,
    /// Standard deviation of a Gaussian light parallel to the sheet in mm (2018 paper, section 7.1).
    pub light_sigma_mm: f64,
    /// Diameter of a uniform disc of light in mm, instead of the Gaussian.
    pub light_disc_mm: Option<f64>,
    /// Position of the camera relative to the sheet's centre in mm; it looks at the centre.
    pub camera_mm: [f64; 3],
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Standard deviation of the lens blur in pixels.
    pub blur_px: f64,
    /// Stray light on the sheet, relative to the brightest pixel.
    pub stray: f64,
    /// Exposures relative to the first.
    pub exposures: Vec<f64>,
    /// Level of the brightest pixel in the first exposure, as a fraction of white.
    pub level: f64,
    /// Electrons at white.
    pub full_scale_e: f64,
    /// Standard deviation of the read noise in electrons.
    pub read_noise_e: f64,
    /// Whether to add a photograph under room light, in which every polygon has its own grey level.
    pub room: bool,
}

impl Default for TilesPhotograph {
    fn default() -> Self {
        Self {
            seed: 1,
            tiles: [10, 8],
            tile_mm: [29.7, 26.25],
            pattern: Pattern::default(),
            misaligned_px: 0.0,
            tilt_deg: [0.0; 2],
            bow_mm: 0.0,
            coherence_um: 16.25,
            wavelength_nm: 560.0,
            band_nm: 10.0,
            lights_mm: Self::spread(5),
            light_sigma_mm: 6.0,
            light_disc_mm: None,
            camera_mm: [0.0, 0.0, 500.0],
            width: 1200,
            height: 860,
            blur_px: 0.6,
            stray: 0.002,
            exposures: vec![1.0, 8.0],
            level: 0.9,
            full_scale_e: 40_000.0,
            read_noise_e: 8.0,
            room: true,
        }
    }
}

/// Fraction of the picture's width that the sheet fills.
const FILLED: f64 = 0.97;

impl TilesPhotograph {
    /// Up to five positions of a light 200 mm above the default sheet.
    ///
    /// The half vectors of one point of the tile, over all lights and tiles, are evenly
    /// spaced: in steps of a fifth of the change across a tile.
    pub fn spread(lights: usize) -> Vec<[f64; 3]> {
        let at = |k: usize| {
            let fifth = |n: usize| (n % 5) as f64 / 5.0 - 0.4;
            // Half vectors change by 1/200 + 1/500 per mm on the sheet, and by 1/200 per mm of the light.
            [29.7 * 1.4 * fifth(2 + k), 26.25 * 1.4 * fifth(2 + 2 * k), 200.0]
        };
        (0..lights.clamp(1, 5)).map(at).collect()
    }

    /// Checks all numbers.
    ///
    /// # Errors
    /// `Input`, naming the number.
    pub fn check(&self) -> Result<()> {
        let bad = |name: &str, problem: String| Err(Error::input(name, problem, "correct the scene"));
        self.pattern.check()?;
        let ranges = [
            ("tile_mm", self.tile_mm[0], 1.0, 1e4),
            ("tile_mm", self.tile_mm[1], 1.0, 1e4),
            ("misaligned_px", self.misaligned_px, 0.0, 100.0),
            ("tilt_deg", self.tilt_deg[0].abs(), 0.0, 30.0),
            ("tilt_deg", self.tilt_deg[1].abs(), 0.0, 30.0),
            ("bow_mm", self.bow_mm.abs(), 0.0, 100.0),
            ("coherence_um", self.coherence_um, 1.0, 1e3),
            ("wavelength_nm", self.wavelength_nm, 200.0, 2000.0),
            ("band_nm", self.band_nm, 0.0, 100.0),
            ("light_sigma_mm", self.light_sigma_mm, 0.0, 100.0),
            ("light_disc_mm", self.light_disc_mm.unwrap_or(0.0), 0.0, 500.0),
            ("camera_mm", self.camera_mm[2], 1.0, 1e6),
            ("blur_px", self.blur_px, 0.0, 20.0),
            ("stray", self.stray, 0.0, 1.0),
            ("level", self.level, 1e-6, 1e3),
            ("full_scale_e", self.full_scale_e, 1.0, 1e9),
            ("read_noise_e", self.read_noise_e, 0.0, 1e6),
        ];
        if let Some((name, value, least, most)) =
            ranges.iter().find(|(_, v, least, most)| !(*least..=*most).contains(v))
        {
            return bad(name, format!("is {value}; expected {least} to {most}"));
        }
        let count = self.tiles[0].saturating_mul(self.tiles[1]);
        if !(1..=10_000).contains(&count) {
            return bad("tiles", format!("are {:?}; expected 1 to 10000 in all", self.tiles));
        }
        if self.width.min(self.height) < 32 || self.width.max(self.height) > 8192 {
            return bad("width, height", format!("are {} × {}; expected 32 to 8192", self.width, self.height));
        }
        let place = |l: &[f64; 3]| l[2] >= 1.0 && l.iter().all(|v| v.abs() <= 1e5);
        if !(1..=100).contains(&self.lights_mm.len()) || !self.lights_mm.iter().all(place) {
            return bad("lights_mm", "are not 1 to 100 places 1 mm and more above the sheet".into());
        }
        if !self.camera_mm[..2].iter().all(|v| v.abs() <= self.camera_mm[2]) {
            return bad("camera_mm", "sees the sheet at more than 45°".into());
        }
        check_exposures(&self.exposures)
    }

    /// Width and height of the sheet in mm.
    pub fn sheet_mm(&self) -> [f64; 2] {
        [0, 1].map(|k| self.tiles[k] as f64 * self.tile_mm[k])
    }

    /// Positions of camera and sheet in a perfect calibration: the sheet is flat and at z = 0.
    pub fn geometry(&self) -> Geometry {
        let c = self.camera_mm;
        let distance = c.iter().map(|v| v * v).sum::<f64>().sqrt();
        let z = c.map(|v| -v / distance);
        // z × up, and z × x, which points down.
        let level = (z[0] * z[0] + z[2] * z[2]).sqrt();
        let x = [-z[2] / level, 0.0, z[0] / level];
        let y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]];
        let focal = FILLED * self.width as f64 * distance / self.sheet_mm()[0];
        let camera = Camera {
            focal_px: [focal; 2],
            center_px: [0.5 * (self.width - 1) as f64, 0.5 * (self.height - 1) as f64],
            distortion: [0.0; 5],
        };
        let sample = Pose { rotation: [x, y, z], translation_mm: [0.0, 0.0, distance] };
        let image_px = Some([self.width as u32, self.height as u32]);
        Geometry { wavelength_nm: Some(self.wavelength_nm), image_px, ..Geometry::new(camera, sample) }
    }

    /// Size of a pixel at the sheet's centre in mm.
    pub fn pixel_mm(&self) -> f64 {
        self.sheet_mm()[0] / (FILLED * self.width as f64)
    }

    /// Misalignment of a tile (column, row from the top), right and down, in mm.
    pub fn offset_mm(&self, tile: [usize; 2]) -> [f64; 2] {
        let part = |axis: u64| 2.0 * uniform(key(&[self.seed, 5, tile[0] as u64, tile[1] as u64, axis])) - 1.0;
        [0, 1].map(|axis| part(axis) * self.misaligned_px * self.pixel_mm())
    }

    /// Grooves at a point in mm from the left and the top of a tile.
    pub fn grooves(&self) -> impl Fn([f64; 2]) -> Option<Grooves> + Sync {
        let tile = Tile::new(&self.pattern, self.tile_mm, self.seed);
        move |place| tile.at(place)
    }

    /// Writes the photographs with their `frames.json`, `geometry.json`, `truth.exr` (one tile at the pitch of the
    /// photographs) and `scene.json` (all parameters).
    ///
    /// # Errors
    /// Those of [`Self::check`]; `Output`.
    pub fn write(&self, folder: &OutputFolder) -> Result<()> {
        self.check()?;
        let mut photographs = vec![];
        for light in &self.lights_mm {
            photographs.push(self.radiance(*light));
        }
        let top = photographs.iter().flatten().copied().fold(f64::MIN_POSITIVE, f64::max);
        let (bracket, mut frames) = (bracket!(self), vec![]);
        for (k, (light, radiance)) in self.lights_mm.iter().zip(&photographs).enumerate() {
            let level = |i: usize| (radiance[i] / top + self.stray) * self.level;
            let taken = bracket.expose(folder, (&format!("{k:02}-"), k as u64), &level)?;
            frames.extend(taken.into_iter().map(|f| Frame { light_mm: Some(*light), ..f }));
        }
        if self.room {
            let grey = self.room_light();
            bracket.save(folder, "room.png", [1000, 0], &|i| grey[i])?;
            frames.push(Frame { exposure_s: Some(1.0), flash: Some(false), ..Frame::new("room.png") });
        }
        bracket.describe(folder, frames)?;
        folder.write("geometry.json", geometry::text(&self.geometry()).as_bytes())?;
        self.write_truth(folder)?;
        folder.write_json("scene.json", self)
    }

    /// Writes orientation and period of one tile.
    fn write_truth(&self, folder: &OutputFolder) -> Result<()> {
        let pitch = self.pixel_mm();
        let [width, height] = self.tile_mm.map(|mm| ((mm / pitch).round() as usize).max(1));
        let (grooves, step) = (self.grooves(), [self.tile_mm[0] / width as f64, self.tile_mm[1] / height as f64]);
        let units = [
            ("units", Attribute::Text("orientation: rad; period: um; edge: mm to the polygon's edge".into())),
            ("pixel_um", Attribute::Number(step[0] * 1000.0)),
        ];
        let channels = ["orientation", "period", "edge"];
        write_exr(&folder.path("truth.exr"), width, height, &channels, &units, &|c, y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let found = grooves([(x as f64 + 0.5) * step[0], (y as f64 + 0.5) * step[1]]);
                let of = |g: Grooves| [g.orientation, g.period_um, g.edge_mm][c] as f32;
                *out = found.map_or(f32::NAN, of);
            }
        })
    }
}
