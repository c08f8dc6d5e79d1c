//! Random scenes with light in the lobes of each.

use nacre_processing::image::{Attribute, write_exr};
use std::f64::consts::TAU;
use std::path::Path;

/// Random numbers (SplitMix64).
pub struct Chance(pub u64);

impl Chance {
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A material, with direction and period of a grating in it.
#[derive(Clone, Copy)]
pub struct Material {
    pub name: &'static str,
    pub text: &'static str,
    pub groove: [f64; 2],
    pub setting: Setting,
}

/// Shape and lighting of a material.
#[derive(Clone, Copy, PartialEq)]
pub enum Setting {
    /// A plane under a lamp.
    Plane,
    /// A disc under a lamp.
    Disc,
    /// Half a cylinder under a lamp, seen from outside.
    Outside,
    /// Half a cylinder under a lamp, seen from inside.
    Inside,
    /// A plane under a sky.
    Sky,
    /// A cylinder under a sky, seen from outside.
    OutsideSky,
    /// A sphere under a lamp.
    Sphere,
    /// A sphere under a sky.
    SphereSky,
    /// A dented triangle mesh under a lamp.
    Mesh,
    /// A dented triangle mesh under a sky.
    MeshSky,
    /// A plane under an extended lamp.
    Area,
}

impl Setting {
    /// True for light from all directions.
    pub fn under_a_sky(self) -> bool {
        matches!(self, Self::Sky | Self::OutsideSky | Self::SphereSky | Self::MeshSky)
    }
}

const BASE: &str = "[material.m]\ncoverage = 0.9\n[material.m.base]\nalbedo = [0.1, 0.05, 0.02]\nroughness = 0.3\n";
const BELOW: &str =
    "[material.m]\ncoverage = 0.9\nblend = \"fresnel\"\n[material.m.base]\nalbedo = [0.8, 0.4, 0.2]\nroughness = 0.3\n";

const SINUSOID: &str = "type = \"grating\"\ncoherence_um = 10\nrelief = { depth_um = 0.15 }\norientation_deg = 30\nperiod_um = 1.5\nreflectance = \"aluminium\"";
const MAPS: &str =
    "type = \"grating\"\ncoherence_um = 10\nrelief = { depth_um = 0.1 }\nmaps = \"maps\"\nreflectance = \"silver\"";
const LACQUER: &str = "type = \"grating\"\ncoherence_um = 10\nrelief = { depth_um = 0.1 }\nmaps = \"maps\"\nreflectance = \"schlick=0.3\"";
const TABLE: &str = "type = \"table\"\nfile = \"lut.exr\"\nalbedo = 0.8";

const SLITS: &str = "type = \"multislit\"\nspacing_um = 1.5\nwidth_um = 0.5\ncount = 12\norientation_deg = 30";
const LATTICE: &str = "type = \"lattice\"\nperiod_um = [6, 5]\naperture_um = [3, 2.5]\norientation_deg = 20\ncoherence_um = 10\nreflectance = \"silver\"";
const HEIGHTS: &str = "type = \"heightfield\"\nfile = \"heights.exr\"\norientation_deg = 20\ncoherence_um = 10\nreflectance = \"aluminium\"";

const LATTICE_40: &str = "type = \"lattice\"\nperiod_um = [6, 5]\naperture_um = [3, 2.5]\norientation_deg = 20\ncoherence_um = 40\nreflectance = \"silver\"";

pub const MATERIALS: [Material; 27] = [
    Material { name: "sinusoid", text: SINUSOID, groove: [30.0, 1.5], setting: Setting::Plane },
    Material {
        name: "blazed",
        text: "type = \"grating\"\ncoherence_um = 10\nrelief = { profile = \"blazed\", depth_um = 0.25 }\norientation_deg = 70\nperiod_um = 1.4\nreflectance = \"schlick=0.6\"",
        groove: [70.0, 1.4],
        setting: Setting::Plane,
    },
    Material {
        name: "rectangular",
        text: "type = \"grating\"\ncoherence_um = 10\nrelief = { profile = { rectangular = { duty = 0.4 } }, depth_um = 0.12 }\norientation_deg = 120\nperiod_um = 1.0",
        groove: [120.0, 1.0],
        setting: Setting::Plane,
    },
    Material { name: "maps", text: MAPS, groove: [45.0, 1.2], setting: Setting::Plane },
    Material { name: "table", text: TABLE, groove: [0.0, 2.0], setting: Setting::Plane },
    Material {
        name: "disc",
        text: "type = \"cd\"\ncoherence_um = 10\nrelief = { depth_um = 0.1 }\nperiod_um = 1.5\nreflectance = \"aluminium\"",
        groove: [90.0, 1.5],
        setting: Setting::Disc,
    },
    Material { name: "maps on a cylinder", text: MAPS, groove: [45.0, 1.2], setting: Setting::Outside },
    Material { name: "table in a cylinder", text: TABLE, groove: [0.0, 2.0], setting: Setting::Inside },
    Material { name: "sinusoid under a sky", text: SINUSOID, groove: [30.0, 1.5], setting: Setting::Sky },
    Material { name: "maps under a sky", text: MAPS, groove: [45.0, 1.2], setting: Setting::Sky },
    Material { name: "table under a sky", text: TABLE, groove: [0.0, 2.0], setting: Setting::Sky },
    Material { name: "slits", text: SLITS, groove: [30.0, 1.5], setting: Setting::Plane },
    Material { name: "slits under a sky", text: SLITS, groove: [30.0, 1.5], setting: Setting::Sky },
    Material { name: "lattice", text: LATTICE, groove: [20.0, 6.0], setting: Setting::Plane },
    // With narrow lobes, pixels are lit only by the lobes' flanks.
    Material { name: "lattice of narrow lobes", text: LATTICE_40, groove: [20.0, 6.0], setting: Setting::Plane },
    Material { name: "height field", text: HEIGHTS, groove: [20.0, 3.2], setting: Setting::Plane },
    Material {
        name: "height field on a cylinder under a sky",
        text: HEIGHTS,
        groove: [20.0, 3.2],
        setting: Setting::OutsideSky,
    },
    Material { name: "maps on a sphere", text: MAPS, groove: [45.0, 1.2], setting: Setting::Sphere },
    Material { name: "maps on a sphere under a sky", text: MAPS, groove: [45.0, 1.2], setting: Setting::SphereSky },
    Material { name: "maps on a cylinder under a sky", text: MAPS, groove: [45.0, 1.2], setting: Setting::OutsideSky },
    Material { name: "maps on a mesh", text: MAPS, groove: [45.0, 1.2], setting: Setting::Mesh },
    Material { name: "lattice under a sky", text: LATTICE, groove: [20.0, 6.0], setting: Setting::Sky },
    Material {
        name: "lattice on a cylinder under a sky",
        text: LATTICE,
        groove: [20.0, 6.0],
        setting: Setting::OutsideSky,
    },
    Material { name: "table on a cylinder under a sky", text: TABLE, groove: [0.0, 2.0], setting: Setting::OutsideSky },
    Material {
        name: "sinusoid under a lamp with an area",
        text: SINUSOID,
        groove: [30.0, 1.5],
        setting: Setting::Area,
    },
    Material { name: "base below maps under a sky", text: LACQUER, groove: [45.0, 1.2], setting: Setting::Sky },
    Material {
        name: "base below maps on a cylinder under a sky",
        text: LACQUER,
        groove: [45.0, 1.2],
        setting: Setting::OutsideSky,
    },
];

const SINUSOID_3: &str = "type = \"grating\"\ncoherence_um = 10\nrelief = { depth_um = 0.15 }\norientation_deg = 30\nperiod_um = 3\nreflectance = \"aluminium\"";

/// Materials whose sums are too long for software renderers, which reject them.
pub const LONG: [Material; 5] = [
    Material { name: "sinusoid of 3 µm", text: SINUSOID_3, groove: [30.0, 3.0], setting: Setting::Plane },
    Material { name: "sinusoid of 3 µm under a sky", text: SINUSOID_3, groove: [30.0, 3.0], setting: Setting::Sky },
    Material {
        name: "rectangular of 8 µm",
        text: "type = \"grating\"\ncoherence_um = 30\nrelief = { profile = { rectangular = { duty = 0.4 } }, depth_um = 0.12 }\norientation_deg = 120\nperiod_um = 8",
        groove: [120.0, 8.0],
        setting: Setting::Plane,
    },
    Material {
        name: "slits of 4 µm",
        text: "type = \"multislit\"\nspacing_um = 4\nwidth_um = 1\ncount = 40\norientation_deg = 30",
        groove: [30.0, 4.0],
        setting: Setting::Plane,
    },
    Material { name: "maps on a mesh under a sky", text: MAPS, groove: [45.0, 1.2], setting: Setting::MeshSky },
];

/// A vector tilted about x, then panned about y, in degrees.
pub fn turned([x, y, z]: [f64; 3], tilt: f64, pan: f64) -> [f64; 3] {
    let [(s, c), (t, d)] = [tilt, pan].map(|deg| deg.to_radians().sin_cos());
    let [y, z] = [c * y - s * z, s * y + c * z];
    [t * z + d * x, y, d * z - t * x]
}

/// Position from azimuth, elevation (degrees) and distance.
pub fn around(azimuth: f64, elevation: f64, distance: f64) -> [f64; 3] {
    let [(s, c), (t, d)] = [azimuth, elevation].map(|deg| deg.to_radians().sin_cos());
    [distance * d * c, distance * d * s, distance * t]
}

/// A sample of a material in a picture of `side` pixels, randomly rotated. The light is placed so that a first order of
/// a visible colour appears in the centre.
pub fn scene(material: Material, side: usize, chance: &mut Chance) -> String {
    let [tilt, pan] = [(); 2].map(|()| chance.between(-40.0, 40.0));
    let frame = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|v| turned(v, tilt, pan));
    let [u, v, n] = frame;
    // The camera is on the z axis: its direction in the sample's frame.
    let view = frame.map(|f| f[2]);
    let [angle, period] = material.groove;
    let um = chance.between(0.45, 0.65) / period;
    let (sin, cos) = angle.to_radians().sin_cos();
    let both = [[1.0, cos, sin], [-1.0, cos, sin]].map(|[s, x, y]| [s * um * x - view[0], s * um * y - view[1]]);
    let length = |p: &[f64; 2]| p[0].hypot(p[1]);
    // Of both first orders, the one whose light is higher above the sample.
    let [x, y] = if length(&both[0]) < length(&both[1]) { both[0] } else { both[1] };
    let z = (1.0 - x * x - y * y).max(0.01).sqrt();
    let light = [0, 1, 2].map(|k| 500.0 * (x * u[k] + y * v[k] + z * n[k]));
    let sigma = chance.between(5.0, 15.0);
    let spectrum = ["D65", "A", "E"][(chance.between(0.0, 3.0) as usize).min(2)];
    let shape = match material.setting {
        Setting::Plane | Setting::Sky | Setting::Area => {
            format!("type = \"plane\"\nnormal = {n:?}\nup = {v:?}\nsize = [110, 110]")
        }
        Setting::Disc => format!("type = \"disc\"\nnormal = {n:?}\nup = {v:?}\ninner = 15\nouter = 55"),
        Setting::Sphere | Setting::SphereSky => {
            let center = n.map(|c| -60.0 * c);
            // The poles are far from the part that faces the camera.
            format!("type = \"sphere\"\ncenter = {center:?}\naxis = {v:?}\nstart = {n:?}\nradius = 60")
        }
        Setting::Mesh | Setting::MeshSky => {
            format!("type = \"mesh\"\nfile = \"sheet.obj\"\nrotation_deg = [{tilt}, {pan}, 0]")
        }
        // Its centre is at the plane's position, or opposite.
        Setting::Outside | Setting::Inside | Setting::OutsideSky => {
            let out = if material.setting == Setting::Inside { -1.0 } else { 1.0 };
            let (center, start) = (n.map(|c| -60.0 * out * c), [0, 1, 2].map(|k| out * n[k]));
            format!(
                "type = \"cylinder\"\ncenter = {center:?}\naxis = {v:?}\nstart = {start:?}\nradius = 60\nlength = 110\narc_deg = [-80, 80]"
            )
        }
    };
    let light = if material.setting == Setting::Area {
        let normal = light.map(|c| -c);
        format!(
            "type = \"rectangle\"\ncenter = {light:?}\nnormal = {normal:?}\nsize = [{}, 40]\nluminance = 100\nspectrum = \"{spectrum}\"",
            4.0 * sigma
        )
    } else if material.setting.under_a_sky() {
        let turn = chance.between(0.0, 360.0);
        format!("type = \"environment\"\nfile = \"sky.exr\"\nup = [0.2, 0.4, 1]\nturn_deg = {turn}")
    } else {
        format!("type = \"point\"\nposition = {light:?}\nsigma_mm = {sigma}\nspectrum = \"{spectrum}\"")
    };
    // With eight pixels along a side, each covers as much as with twelve. The sheet's edges, which need many samples,
    // are out of view.
    let fov = if side == 8 { 14.0 * 8.0 / 12.0 } else { 14.0 };
    let base = if material.name.starts_with("base below") { BELOW } else { BASE };
    format!(
        "[camera]\nposition = [0, 0, 500]\ntarget = [0, 0, 0]\nfov_deg = {fov}\nwidth = {side}\nheight = {side}\n\
         [[shape]]\n{shape}\nmaterial = \"m\"\n\
         [[light]]\n{light}\n\
         {base}[material.m.diffraction]\n{}\n",
        material.text
    )
}

/// Writes the files of the materials: maps of squares, one of them masked, and a table of blurred orders.
pub fn files(folder: &Path) {
    const SIDE: usize = 64;
    let square = |x: usize, y: usize| (x / 8 + 3 * (y / 8)) % 11;
    let masked = |x: usize, y: usize| square(x, y) == 10;
    std::fs::create_dir_all(folder.join("maps")).unwrap();
    let map = |name: &str, channel: &str, value: &(dyn Fn(usize) -> f64 + Sync)| {
        write_exr(&folder.join("maps").join(name), SIDE, SIDE, &[channel, "mask"], &[], &|c, y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                *out = match (c, masked(x, y)) {
                    (0, false) => value(square(x, y)) as f32,
                    (0, true) => f32::NAN,
                    (_, masked) => f32::from(u8::from(!masked)),
                };
            }
        })
        .unwrap();
    };
    map("orientation.exr", "orientation", &|k| (0.7 + 0.06 * (k as f64 - 5.0)).rem_euclid(TAU / 2.0));
    map("period.exr", "period", &|k| 1.1 + 0.03 * k as f64);
    sheet(folder);
    heights(folder);
    let attributes = [("extent", Attribute::Number(1.0))];
    write_exr(&folder.join("lut.exr"), 128, 128, &["X", "Y", "Z"], &attributes, &|c, y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let h = [(x as f64 + 0.5) / 64.0 - 1.0, 1.0 - (y as f64 + 0.5) / 64.0];
            // Colours of the first orders along x, and a zero order.
            let order =
                |at: f64, width: f64| (-0.5 * (((h[0].abs() - at) / width).powi(2) + (h[1] / 0.1).powi(2))).exp();
            *out = (order(0.0, 0.05) + order(0.22 + 0.05 * (2.0 - c as f64), 0.05)) as f32;
        }
    })
    .unwrap();
    write_exr(&folder.join("sky.exr"), 64, 32, &["R", "G", "B"], &[], &|c, y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let (polar, azimuth) = (TAU / 2.0 * (y as f64 + 0.5) / 32.0, TAU * (0.5 - (x as f64 + 0.5) / 64.0));
            // Bluer above, and a lamp of 10°.
            let lamp = (-0.5 * ((polar - 1.2).powi(2) + (azimuth - 0.5).powi(2)) / 0.03).exp();
            *out = (0.3 + 0.1 * c as f64 * polar.cos() + 5.0 * lamp) as f32;
        }
    })
    .unwrap();
}

/// A sheet of 110 mm with dents that shade each other, as triangles with texture coordinates.
fn sheet(folder: &Path) {
    const CELLS: usize = 24;
    let mut text = String::new();
    let at = |k: usize| k as f64 / CELLS as f64;
    for y in 0..=CELLS {
        for x in 0..=CELLS {
            let (u, v) = (at(x), at(y));
            let z = 4.0 * (TAU * 1.5 * u).sin() * (TAU * v).cos();
            text += &format!("v {} {} {z}\nvt {u} {v}\n", 110.0 * (u - 0.5), 110.0 * (v - 0.5));
        }
    }
    for y in 0..CELLS {
        for x in 0..CELLS {
            let a = y * (CELLS + 1) + x + 1;
            let (b, c, d) = (a + 1, a + CELLS + 2, a + CELLS + 1);
            text += &format!("f {a}/{a} {b}/{b} {c}/{c}\nf {a}/{a} {c}/{c} {d}/{d}\n");
        }
    }
    std::fs::write(folder.join("sheet.obj"), text).unwrap();
}

/// Crossed waves of 3.2 and 2.13 µm, plus waves of 1.6 µm, 0.3 µm deep.
fn heights(folder: &Path) {
    const SIDE: usize = 128;
    let attributes = [("units", Attribute::Text("µm".into())), ("pixel_um", Attribute::Number(0.05))];
    write_exr(&folder.join("heights.exr"), SIDE, SIDE, &["height"], &attributes, &|_, y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let [u, v] = [x, y].map(|k| TAU * k as f64 / SIDE as f64);
            *out = (0.08 * (2.0 * u).sin() + 0.04 * (3.0 * v + 0.4).cos() + 0.03 * (4.0 * u - 2.0 * v).sin()) as f32;
        }
    })
    .unwrap();
}
