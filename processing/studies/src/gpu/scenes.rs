//! Flat samples under a light or a sky, and the files of their scenes.

use super::broken;
use nacre_base::Result;
use nacre_base::random::Stream;
use nacre_image::{Attribute, write_exr};
use nacre_render::Scene;
use std::f64::consts::PI;
use tempfile::TempDir;

/// A material: direction and period of its grating, and whether it is lit by a sky.
pub(super) struct Material {
    pub name: &'static str,
    diffraction: &'static str,
    groove: [f64; 2],
    sky: bool,
    /// Factor on the reference's number of samples.
    pub noise: usize,
}

const SINUSOID: &str = "type = \"grating\"\ncoherence_um = 10\nrelief = { depth_um = 0.15 }\norientation_deg = 30\nperiod_um = 1.5\nreflectance = \"aluminium\"";
const MAPS: &str =
    "type = \"grating\"\ncoherence_um = 10\nrelief = { depth_um = 0.1 }\nmaps = \"maps\"\nreflectance = \"silver\"";
const TABLE: &str = "type = \"table\"\nfile = \"lut.exr\"\nalbedo = 0.8";

pub(super) const MATERIALS: [Material; 5] = [
    Material { name: "sinusoid, 1.5 µm", diffraction: SINUSOID, groove: [30.0, 1.5], sky: false, noise: 1 },
    Material { name: "maps, 1.1 to 1.4 µm", diffraction: MAPS, groove: [45.0, 1.2], sky: false, noise: 1 },
    Material { name: "table", diffraction: TABLE, groove: [0.0, 2.0], sky: false, noise: 1 },
    Material { name: "sinusoid under a sky", diffraction: SINUSOID, groove: [30.0, 1.5], sky: true, noise: 1 },
    Material { name: "table under a sky", diffraction: TABLE, groove: [0.0, 2.0], sky: true, noise: 32 },
];

/// Files that the scenes refer to.
pub(super) struct Files {
    pub folder: TempDir,
}

impl Files {
    /// Writes the files: maps of squares with masked ones, `side` pixels wide; a lookup table of blurred orders; and a
    /// sky with a lamp.
    pub(super) fn written(side: usize) -> Result<Self> {
        let folder = tempfile::tempdir().map_err(|e| broken("temporary folder", e))?;
        let path = |name: &str| folder.path().join(name);
        std::fs::create_dir(path("maps")).map_err(|e| broken("maps", e))?;
        let square = |x: usize, y: usize| (8 * x / side + 3 * (8 * y / side)) % 11;
        let map = |name: &str, channel: &str, value: fn(f64) -> f64| {
            write_exr(&path("maps").join(name), side, side, &[channel, "mask"], &[], &|c, y, row| {
                for (x, out) in row.iter_mut().enumerate() {
                    let known = square(x, y) != 10;
                    let value = if known { value(square(x, y) as f64) as f32 } else { f32::NAN };
                    *out = if c == 0 { value } else { f32::from(u8::from(known)) };
                }
            })
        };
        map("orientation.exr", "orientation", |k| (0.7 + 0.06 * (k - 5.0)).rem_euclid(PI))?;
        map("period.exr", "period", |k| 1.1 + 0.03 * k)?;
        write_exr(
            &path("lut.exr"),
            128,
            128,
            &["X", "Y", "Z"],
            &[("extent", Attribute::Number(1.0))],
            &|c, y, row| {
                for (x, out) in row.iter_mut().enumerate() {
                    let [h, v] = [x as f64, 127.0 - y as f64].map(|k| (k + 0.5) / 64.0 - 1.0);
                    let order = |at: f64| (-0.5 * (((h.abs() - at) / 0.05).powi(2) + (v / 0.1).powi(2))).exp();
                    *out = (order(0.0) + order(0.22 + 0.05 * (2.0 - c as f64))) as f32;
                }
            },
        )?;
        write_exr(&path("sky.exr"), 128, 64, &["R", "G", "B"], &[], &|c, y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let (polar, azimuth) = (PI * (y as f64 + 0.5) / 64.0, 2.0 * PI * (0.5 - (x as f64 + 0.5) / 128.0));
                let lamp = (-0.5 * ((polar - 1.1).powi(2) + (azimuth - 0.9).powi(2)) / 0.03).exp();
                *out = (0.2 + 0.1 * c as f64 * polar.cos().max(0.0) + 8.0 * lamp) as f32;
            }
        })?;
        Ok(Self { folder })
    }
}

/// A sample that faces the camera, rotated by a few random degrees. The light is placed so that a first order of a
/// visible colour is seen.
pub(super) fn scene(material: &Material, [width, height]: [usize; 2], seed: u64) -> String {
    let mut random = Stream::of(seed);
    let [angle, period] = material.groove;
    let [um, tilt, pan] = [[0.45, 0.65], [-0.1, 0.1], [-0.1, 0.1]].map(|[a, b]| a + (b - a) * random.next());
    let (sin, cos) = angle.to_radians().sin_cos();
    let [x, y] = [cos * um / period, sin * um / period];
    let at = [x, y, (1.0 - x * x - y * y).sqrt()].map(|v| 500.0 * v);
    let light = match material.sky {
        true => "type = \"environment\"\nfile = \"sky.exr\"".to_owned(),
        false => format!("type = \"point\"\nposition = {at:?}\nsigma_mm = 10"),
    };
    format!(
        "[camera]\nposition = [0, 0, 500]\ntarget = [0, 0, 0]\nfov_deg = 12\nwidth = {width}\nheight = {height}\n\
         [[shape]]\ntype = \"plane\"\nnormal = [{pan}, {tilt}, 1]\nsize = [{}, 110]\nmaterial = \"m\"\n[[light]]\n{light}\n\
         [material.m]\ncoverage = 0.9\n[material.m.base]\nalbedo = [0.1, 0.05, 0.02]\nroughness = 0.3\n[material.m.diffraction]\n{}\n",
        110 * width / height,
        material.diffraction
    )
}

/// Parses a scene.
pub(super) fn parsed(text: &str) -> Result<Scene> {
    toml::from_str(text).map_err(|e| broken("scene", e))
}
