//! Scenes to start from, with maps made by formulas.

use super::gallery_shapes::{room, snake};
use super::random::Stream;
use crate::Result;
use crate::image::{OutputFolder, write_exr};
use std::f64::consts::{PI, TAU};

/// Pixels along a side of the maps.
const MAP: usize = 1024;

/// Orientation (rad) and period (µm) at a place (u, v); none where nothing diffracts.
type Pattern = fn(f64, f64) -> Option<[f64; 2]>;

/// Foils by their maps.
const FOILS: [(&str, Pattern); 5] = [
    ("star-paper", star_paper),
    ("kinematic-tile", kinematic),
    ("logo", logo),
    ("emblem", emblem),
    ("spiral-foil", spiral_foil),
];

/// Writes scenes with their maps into a folder, under a point light and, as NAME-room, in an environment; their names.
///
/// # Errors
/// `Output` when the system refuses.
pub fn gallery(folder: &OutputFolder) -> Result<Vec<String>> {
    room(folder)?;
    let mut names = vec![];
    let mut scene = |name: &str, shape: &str, material: &str, lamp: &str| -> Result<()> {
        for (suffix, light) in [("", lamp), ("-room", ROOM)] {
            let camera = if suffix.is_empty() { CAMERA } else { LEANING };
            let name = format!("{name}{suffix}");
            folder.write(&format!("{name}.toml"), format!("{camera}{shape}{material}{light}").as_bytes())?;
            names.push(name);
        }
        Ok(())
    };
    scene("cd", DISC, CD, LAMP)?;
    scene("phone", PHONE, PHONE_LATTICE, SMALL_LAMP)?;
    scene("tv", PHONE, TV_LATTICE, SMALL_LAMP)?;
    for (name, pattern) in FOILS {
        maps(folder, name, pattern)?;
        scene(name, SHEET, &foil(name, ""), LAMP)?;
    }
    scene("rolled", ROLLED, &foil("star-paper", "repeat = [3, 1]\n"), LAMP)?;
    folder.write("snake.obj", snake().as_bytes())?;
    maps(folder, "scales", scales)?;
    scene("snake", SNAKE, SKIN, LAMP)?;
    Ok(names)
}

const CAMERA: &str = "# Lengths in mm; `nacre schema scene` describes all keys.
[camera]
position = [0, 0, 500]
target = [0, 0, 0]
fov_deg = 14
width = 360
height = 360
";

const LEANING: &str = "# Lengths in mm; `nacre schema scene` describes all keys.
[camera]
position = [0, -330, 375]
target = [0, 0, 0]
fov_deg = 14
width = 300
height = 300
";

const LAMP: &str = "
[[light]]
type = \"point\"
position = [0, 260, 420]
sigma_mm = 10

[[light]]
type = \"point\"
position = [-280, 60, 400]
sigma_mm = 10

[[light]]
type = \"point\"
position = [190, -190, 420]
sigma_mm = 10
";

const SMALL_LAMP: &str = "
[[light]]
type = \"point\"
position = [0, 20, 500]
sigma_mm = 0.7
";

const ROOM: &str = "
[[light]]
type = \"environment\"
file = \"room.exr\"
";

const DISC: &str = "
[[shape]]
type = \"disc\"
inner = 20
outer = 58
material = \"sample\"
";

const CD: &str = "
[material.sample]
coverage = 0.9

[material.sample.base]
albedo = [0.3, 0.3, 0.3]
roughness = 0.3

[material.sample.diffraction]
type = \"cd\"
period_um = 1.6
relief = { profile = { rectangular = { duty = 0.35 } }, depth_um = 0.15 }
coherence_um = 20
reflectance = \"aluminium\"
";

const PHONE: &str = "
[[shape]]
type = \"plane\"
size = [64, 110]
material = \"sample\"
";

const PHONE_LATTICE: &str = "
[material.sample.base]
albedo = [0.004, 0.004, 0.005]
roughness = 0.05

[material.sample.diffraction]
type = \"lattice\"
period_um = [78, 78]
aperture_um = [18, 58]
coherence_um = 600
reflectance = \"schlick=0.04\"
";

const TV_LATTICE: &str = "
[material.sample.base]
albedo = [0.01, 0.01, 0.01]
roughness = 0.4

[material.sample.diffraction]
type = \"lattice\"
period_um = [60, 180]
aperture_um = [28, 120]
orientation_deg = 0
coherence_um = 900
reflectance = \"schlick=0.05\"
";

const SHEET: &str = "
[[shape]]
type = \"plane\"
size = [110, 110]
material = \"sample\"
";

const ROLLED: &str = "
[[shape]]
type = \"cylinder\"
radius = 32
length = 100
axis = [1, 0, 0]
start = [0, -1, 0]
arc_deg = [-150, 150]
material = \"sample\"
";

const SNAKE: &str = "
[[shape]]
type = \"mesh\"
file = \"snake.obj\"
material = \"sample\"
";

const SKIN: &str = "
[material.sample]
coverage = 0.5

[material.sample.base]
albedo = [0.09, 0.05, 0.025]
roughness = 0.35
specular = [0.05, 0.05, 0.05]

[material.sample.diffraction]
type = \"grating\"
relief = { depth_um = 0.2 }
maps = \"scales\"
repeat = [56, 10]
coherence_um = 5
reflectance = \"schlick=0.06\"
";

fn foil(name: &str, more: &str) -> String {
    format!(
        "
[material.sample]
coverage = 0.8

[material.sample.base]
albedo = [0.35, 0.35, 0.37]
roughness = 0.5

[material.sample.diffraction]
type = \"grating\"
relief = {{ depth_um = 0.15 }}
maps = \"{name}\"
coherence_um = 6
reflectance = \"aluminium\"
{more}"
    )
}

/// Writes a pattern as orientation.exr and period.exr in a folder of its own.
fn maps(folder: &OutputFolder, name: &str, pattern: Pattern) -> Result<()> {
    folder.create_dir(name)?;
    let at = |x: usize, y: usize| pattern((x as f64 + 0.5) / MAP as f64, 1.0 - (y as f64 + 0.5) / MAP as f64);
    for (k, channel) in ["orientation", "period"].into_iter().enumerate() {
        let path = folder.path(&format!("{name}/{channel}.exr"));
        write_exr(&path, MAP, MAP, &[channel, "mask"], &[], &|c, y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let found = at(x, y);
                let value =
                    || found.map_or(f32::NAN, |v| if k == 0 { v[0].rem_euclid(PI) as f32 } else { v[1] as f32 });
                *out = if c == 0 { value() } else { f32::from(u8::from(found.is_some())) };
                // An orientation just below π may round to it.
                if c == 0 && k == 0 && *out >= std::f32::consts::PI {
                    *out = 0.0;
                }
            }
        })?;
    }
    Ok(())
}

/// A number from 0 to 1 that belongs to a cell.
fn chance(x: i64, y: i64, what: usize) -> f64 {
    Stream::new((x as usize).wrapping_mul(0x1_0001).wrapping_add(y as usize), what).next()
}

/// The nearest of points by chance, one in each cell of a grid: its cell and place.
fn nearest(u: f64, v: f64, cells: f64) -> [i64; 2] {
    let (x, y) = (u * cells, v * cells);
    let mut best = (f64::INFINITY, [0; 2]);
    for j in -1..=1 {
        for i in -1..=1 {
            let (cx, cy) = (x.floor() as i64 + i, y.floor() as i64 + j);
            let wrap = |k: i64| k.rem_euclid(cells as i64);
            let place = [cx as f64 + chance(wrap(cx), wrap(cy), 1), cy as f64 + chance(wrap(cx), wrap(cy), 2)];
            let distance = (place[0] - x).powi(2) + (place[1] - y).powi(2);
            if distance < best.0 {
                best = (distance, [wrap(cx), wrap(cy)]);
            }
        }
    }
    best.1
}

/// Holographic paper: polygons of twelve orientations, with stars of four points between them.
fn star_paper(u: f64, v: f64) -> Option<[f64; 2]> {
    let [x, y] = nearest(u, v, 12.0);
    let angle = (chance(x, y, 3) * 12.0).floor() * PI / 12.0;
    let (p, q) = ((u * 4.0).fract() - 0.5, (v * 4.0).fract() - 0.5);
    // An astroid.
    if p.abs().sqrt() + q.abs().sqrt() < 0.55 {
        return Some([q.atan2(p), 1.2]);
    }
    Some([angle, 1.6])
}

/// A kinematic tile: rings of sectors whose orientation turns from one to the next, so that light runs around when it is tilted.
fn kinematic(u: f64, v: f64) -> Option<[f64; 2]> {
    let (x, y) = ((u * 3.0).fract() - 0.5, (v * 3.0).fract() - 0.5);
    let (radius, angle) = (x.hypot(y), y.atan2(x));
    if radius > 0.47 {
        return Some([PI / 4.0, 1.9]);
    }
    let ring = (radius / 0.47 * 4.0).floor();
    let sector = ((angle + PI) / TAU * (6.0 + 4.0 * ring)).floor();
    Some([sector * PI / (3.0 + 2.0 * ring) + ring * PI / 8.0, 1.2 + 0.12 * ring])
}

/// The letters of a name, each of a few orientations, on a ground of another one.
fn logo(u: f64, v: f64) -> Option<[f64; 2]> {
    // Five by seven pixels each.
    const LETTERS: [[u8; 7]; 5] = [
        [0b10001, 0b11001, 0b10101, 0b10011, 0b10001, 0b10001, 0b10001],
        [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
        [0b01111, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b01111],
        [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001],
        [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b11111],
    ];
    let (x, y) = ((u - 0.05) / 0.9 * 29.0, (0.62 - v) / 0.24 * 7.0);
    if (0.0..29.0).contains(&x) && (0.0..7.0).contains(&y) {
        let (letter, column) = ((x / 6.0) as usize, (x % 6.0) as usize);
        if letter < 5 && column < 5 && LETTERS[letter][y as usize] >> (4 - column) & 1 == 1 {
            return Some([PI / 2.0, 1.25 + 0.1 * letter as f64]);
        }
    }
    let ray = ((v - 0.5).atan2(u - 0.5) / TAU * 24.0).floor();
    Some([ray * PI / 12.0, 1.7])
}

/// An emblem: a shield of concentric outlines and a star in it, on plain foil.
fn emblem(u: f64, v: f64) -> Option<[f64; 2]> {
    let (x, y) = ((u - 0.5) * 2.2, (v - 0.52) * 2.2);
    let shield = if y > 0.0 { x.abs().max(y) } else { (x.abs() + 0.35 * y * y).hypot(0.75 * y) };
    let (radius, angle) = (x.hypot(y), y.atan2(x));
    let point = ((angle - PI / 2.0) / TAU * 5.0).rem_euclid(1.0);
    let star = 0.26 + 0.34 * (2.0 * point - 1.0).abs().powf(1.6);
    if radius < star {
        return Some([((angle - PI / 2.0) / TAU * 10.0).floor() * PI / 10.0 + PI / 20.0, 1.3]);
    }
    if shield < 0.85 {
        return Some([y.atan2(x), 1.45]);
    }
    if shield < 0.97 {
        return Some([PI / 2.0, 1.25]);
    }
    None
}

/// Dots by chance, whose orientation turns with the distance from the middle: a spiral of light.
fn spiral_foil(u: f64, v: f64) -> Option<[f64; 2]> {
    let [x, y] = nearest(u, v, 120.0);
    let (p, q) = (x as f64 / 120.0 - 0.5, y as f64 / 120.0 - 0.5);
    let spread = 0.35 * (chance(x, y, 5) + chance(x, y, 6) - 1.0);
    Some([q.atan2(p) + 7.0 * p.hypot(q) + spread, 1.3 + 0.5 * chance(x, y, 7)])
}

/// Fingers on a snake's scale: rows across it, bent, a µm apart; the skin between scales does not diffract.
fn scales(u: f64, v: f64) -> Option<[f64; 2]> {
    // Rhombs: two lattices of scales, one shifted by half.
    let (mut x, mut y) = (u - 0.5, v - 0.5);
    if x.abs() + y.abs() > 0.5 {
        x -= 0.5_f64.copysign(x);
        y -= 0.5_f64.copysign(y);
    }
    if x.abs() + y.abs() > 0.46 {
        return None;
    }
    Some([0.25 * (TAU * y).sin() + 0.15 * x, 1.1 + 0.12 * y])
}
