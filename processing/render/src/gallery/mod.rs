//! Example scenes, with maps from formulas.

mod patterns;
mod shapes;

use nacre_base::{Error, Result};
use nacre_brdf::height::HeightField;
use nacre_brdf::output::write_height;
use nacre_image::{OutputFolder, write_exr};
use nacre_maps::Maps;
use patterns::{emblem, kinematic, logo, scales, spiral_foil, star_paper};
use shapes::{room, snake};
use std::f64::consts::PI;
use std::path::Path;

/// Side of the maps in pixels.
const MAP: usize = 1024;

/// Orientation (rad) and period (µm) at a position (u, v); `None` where nothing diffracts.
type Pattern = fn(f64, f64) -> Option<[f64; 2]>;

/// Names and maps.
const PATTERNS: [(&str, Pattern); 6] = [
    ("star-paper", star_paper),
    ("kinematic-tile", kinematic),
    ("logo", logo),
    ("emblem", emblem),
    ("spiral-foil", spiral_foil),
    ("scales", scales),
];

/// Names of the example scenes, each with small lights and, as `NAME-room`, in an environment.
pub const GALLERY: [&str; 10] =
    ["cd", "phone", "tv", "star-paper", "kinematic-tile", "logo", "emblem", "spiral-foil", "rolled", "snake"];

/// Writes all example scenes into a folder; returns their names.
///
/// # Errors
/// `Output` if the system refuses.
pub fn gallery(folder: &OutputFolder) -> Result<Vec<String>> {
    let names = GALLERY.into_iter().flat_map(|name| [name.to_owned(), format!("{name}-room")]);
    names.map(|name| gallery_scene(folder, &name).map(|()| name)).collect()
}

/// Writes the snake with a measured skin, under lamps and in a room; returns their names.
///
/// # Errors
/// `Output` if the system refuses.
pub fn gallery_skin(folder: &OutputFolder, skin: &HeightField) -> Result<[&'static str; 2]> {
    write_height(&folder.path("skin.exr"), None, skin)?;
    folder.write("snake.obj", snake().as_bytes())?;
    room(folder)?;
    let diffraction = "type = \"heightfield\"\nfile = \"skin.exr\"\ncoherence_um = 5\nreflectance = \"schlick=0.06\"\n";
    for (name, camera, light) in [("snake-measured", CAMERA, LAMP), ("snake-measured-room", LEANING, ROOM)] {
        let scene = format!("{camera}{SNAKE}{SNAKES_BASE}{diffraction}{light}");
        folder.write(&format!("{name}.toml"), scene.as_bytes())?;
    }
    Ok(["snake-measured", "snake-measured-room"])
}

/// Writes an example scene and its files into a folder.
///
/// # Errors
/// `Input` for unknown names; `Output` if the system refuses.
pub fn gallery_scene(folder: &OutputFolder, name: &str) -> Result<()> {
    let (sample, camera, in_room) = match name.strip_suffix("-room") {
        Some(sample) => (sample, LEANING, true),
        None => (name, CAMERA, false),
    };
    let (shape, material, lamp) = match sample {
        "cd" => (DISC, CD.to_owned(), LAMP),
        "phone" => (PHONE, PHONE_LATTICE.to_owned(), SMALL_LAMP),
        "tv" => (PHONE, TV_LATTICE.to_owned(), SMALL_LAMP),
        "rolled" => (ROLLED, foil("star-paper", "repeat = [3, 1]\n"), LAMP),
        "snake" => (SNAKE, format!("{SNAKES_BASE}{SKIN}"), LAMP),
        sample if sample != "scales" && PATTERNS.iter().any(|p| p.0 == sample) => (SHEET, foil(sample, ""), LAMP),
        _ => {
            let remedy = format!("give {}, or one of them with -room", GALLERY.join(", "));
            return Err(Error::input("gallery", format!("has no scene {name:?}"), remedy));
        }
    };
    let foil = match sample {
        "rolled" => "star-paper",
        "snake" => "scales",
        sample => sample,
    };
    for (name, pattern) in PATTERNS.iter().filter(|p| p.0 == foil) {
        maps(folder, name, *pattern)?;
    }
    if sample == "snake" {
        folder.write("snake.obj", snake().as_bytes())?;
    }
    if in_room {
        room(folder)?;
    }
    let light = if in_room { ROOM } else { lamp };
    folder.write(&format!("{name}.toml"), format!("{camera}{shape}{material}{light}").as_bytes())
}

/// A scene of a sheet with the maps, or the lookup table, of its folder; `None` if the folder has neither.
///
/// # Errors
/// `Input` for invalid maps.
pub fn scene_of_maps(folder: &Path) -> Result<Option<String>> {
    let there = |name: &str| folder.join(name).is_file();
    let (mut size, material) = match (there("orientation.exr"), there("period.exr"), there("lut.exr")) {
        (false, false, false) => return Ok(None),
        (false, false, true) => ([1.0; 2], TABLE.to_owned()),
        (orientation, period, _) => {
            let maps = Maps::read(folder)?;
            let constant = match (orientation, period) {
                (true, false) => "period_um = 1.5\n",
                (false, _) => "orientation_deg = 0\n",
                (true, true) => "",
            };
            ([maps.width, maps.height].map(|n| n.max(1) as f64), foil(".", constant))
        }
    };
    let longest = size[0].max(size[1]);
    size = size.map(|n| 110.0 * n / longest);
    let shape = format!("\n[[shape]]\ntype = \"plane\"\nsize = {size:?}\nmaterial = \"sample\"\n");
    Ok(Some(format!("{CAMERA}{shape}{material}{LAMP}")))
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

const TABLE: &str = "
[material.sample.diffraction]
type = \"table\"
file = \"lut.exr\"
albedo = 0.7
";

const SNAKE: &str = "
[[shape]]
type = \"mesh\"
file = \"snake.obj\"
material = \"sample\"
";

const SNAKES_BASE: &str = "
[material.sample]
coverage = 0.5

[material.sample.base]
albedo = [0.09, 0.05, 0.025]
roughness = 0.35
specular = [0.05, 0.05, 0.05]

[material.sample.diffraction]
";

const SKIN: &str = "type = \"grating\"
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

/// Writes a pattern as orientation.exr and period.exr in a subfolder.
fn maps(folder: &OutputFolder, name: &str, pattern: Pattern) -> Result<()> {
    if folder.path(name).exists() {
        return Ok(());
    }
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
                // An orientation just below π may round up to it.
                if c == 0 && k == 0 && *out >= std::f32::consts::PI {
                    *out = 0.0;
                }
            }
        })?;
    }
    Ok(())
}
