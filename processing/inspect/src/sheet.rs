//! A sheet as an inspection reads it: a result folder of `nacre reconstruct`, or a design.

use crate::image::Image;
use nacre_base::statistics::quantile;
use nacre_base::{Error, Result, input};
use nacre_image::budget::Operation;
use nacre_image::{ExrMap, read_exr};
use nacre_maps::{Kind, Map, Maps};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// Brightness relative to its highest value below which a pixel is black.
const BLACK: f32 = 1e-5;

/// Share of the pixels whose orientations have no larger standard deviation than noise explains.
const LEAST_INFLATED: f64 = 0.1;

/// Maximum size of JSON files that are searched for devices and times.
const MOST_JSON_BYTES: u64 = 16 << 20;

/// Maximum size of a map file that is signed.
const MOST_MAP_BYTES: u64 = 8 << 30;

/// A file of the input and its hash.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Signature {
    /// File name.
    pub file: String,
    /// SHA-256 of its bytes, in hexadecimal digits.
    pub sha256: String,
}

/// Where a sheet comes from.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Origin {
    /// Name of its folder or file.
    pub name: String,
    /// Files that were read.
    pub files: Vec<Signature>,
    /// Devices with serial numbers; empty if no session states them.
    pub devices: Vec<String>,
    /// Time of the capture in Unix seconds; `None` if no session states it.
    pub captured_s: Option<u64>,
    /// Whether the maps have standard deviations; those of a design are exact.
    pub measured: bool,
}

/// Periods and their standard deviations in µm.
#[derive(Clone, Debug)]
pub struct Periods {
    /// Periods, NaN where unknown.
    pub value: Vec<f32>,
    /// Standard deviations.
    pub sigma: Vec<f32>,
}

/// Maps of a sheet.
#[derive(Clone, Debug)]
pub struct Sheet {
    /// Polarization and brightness. Without `stokes.exr` the brightness is 1, and the polarization 1 or 0.
    pub image: Image,
    /// Standard deviation of each component of the polarized part.
    pub sigma: Vec<f32>,
    /// Whether a pixel is overexposed in a photograph.
    pub overexposed: Vec<bool>,
    /// Image and standard deviations from the orientations alone, for [`Sheet::without_light`].
    pub orientations: (Image, Vec<f32>),
    /// Periods, where they were measured.
    pub periods: Option<Periods>,
    /// Whether brightness and degree of polarization are known.
    pub has_light: bool,
    /// Size of a pixel on the sheet in µm.
    pub pixel_um: Option<f64>,
    /// Where it comes from.
    pub origin: Origin,
}

impl Sheet {
    /// Reads a result folder, or a map file with orientations.
    ///
    /// # Errors
    /// `Input` for other files.
    pub fn read(path: &Path) -> Result<Self> {
        let maps = Maps::read(path)?;
        let Some(orientation) = maps.maps.get(&Kind::Orientation) else {
            return Err(Error::file(path, "has no orientations", "give results that hold orientation.exr"));
        };
        let size = [maps.width, maps.height];
        let pixel_um = maps.maps.values().find_map(|m| m.attributes.get("pixel_um")?.parse().ok());
        let orientations = from_orientations(size, orientation);
        let stokes = stokes(path, size)?;
        let (image, sigma, overexposed) = match &stokes {
            Some(stokes) => with_light(stokes, &orientation.sigma),
            None => (orientations.0.clone(), orientations.1.clone(), vec![false; maps.width * maps.height]),
        };
        // Periods from the brightness have no scale.
        let absolute = |m: &&Map| !m.attributes.get("method").is_some_and(|m| m.starts_with("heuristic"));
        let periods = maps.maps.get(&Kind::Period).filter(absolute).map(|m| (m.value.clone(), m.sigma.clone()));
        let beside = || orientation.more.get("period").map(|p| (p.clone(), vec![0.0; p.len()]));
        let periods = periods.or_else(beside).map(|(value, sigma)| Periods { value, sigma });
        let measured = orientation.sigma.iter().any(|s| *s > 0.0);
        let origin = origin(path, measured)?;
        let has_light = stokes.is_some();
        Ok(Self { image, sigma, overexposed, orientations, periods, has_light, pixel_um, origin })
    }

    /// The sheet without brightness and degree of polarization, for a comparison with a sheet that has none.
    #[must_use]
    pub fn without_light(mut self) -> Self {
        (self.image, self.sigma) = self.orientations.clone();
        self.overexposed.fill(false);
        self.has_light = false;
        self
    }
}

/// True if a path can be read as a sheet.
pub fn is_sheet(path: &Path) -> bool {
    path.join("orientation.exr").is_file() || path.is_file()
}

fn stokes(path: &Path, size: [usize; 2]) -> Result<Option<ExrMap>> {
    let file = path.join("stokes.exr");
    if !file.is_file() {
        return Ok(None);
    }
    Operation::Maps(1).check_file(&file)?;
    let map = read_exr(&file)?;
    let same = [map.width, map.height] == size && ["S0", "S1", "S2"].iter().all(|c| map.channels.contains_key(*c));
    if !same {
        return Err(Error::file(&file, "does not belong to the orientations", "give a complete result folder"));
    }
    Ok(Some(map))
}

/// The polarized part comes from the Stokes parameters, which are linear in the light: pixels at edges mix it, and two
/// sheets are compared alike whatever model gave their orientations.
fn with_light(stokes: &ExrMap, angle_sigma: &[f32]) -> (Image, Vec<f32>, Vec<bool>) {
    let [s0, s1, s2] = ["S0", "S1", "S2"].map(|name| &stokes.channels[name]);
    let top = s0.iter().copied().filter(|v| v.is_finite()).fold(0.0_f32, f32::max);
    let overexposed: Vec<bool> = (0..s0.len()).map(|i| !(s0[i] + s1[i] + s2[i]).is_finite()).collect();
    let value = |i: usize| {
        if overexposed[i] { [0.0, 0.0, top] } else { [s1[i], s2[i], s0[i].max(BLACK * top)] }
    };
    let values: Vec<[f32; 3]> = (0..s0.len()).map(value).collect();
    // Shot noise; errors of models only ever enlarge the standard deviations of orientations.
    let spread = |i: usize| 2.0 * angle_sigma[i] * s1[i].hypot(s2[i]) / s0[i].sqrt();
    let mut all: Vec<f32> = (0..s0.len()).map(spread).filter(|s| s.is_finite()).collect();
    let shot = quantile(&mut all, LEAST_INFLATED).unwrap_or(0.0);
    let sigma = values.iter().map(|v| shot * v[2].sqrt()).collect();
    (Image { width: stokes.width, height: stokes.height, values }, sigma, overexposed)
}

/// The orientations with a degree of polarization of 1 where there is one, otherwise 0, and their standard deviations.
fn from_orientations([width, height]: [usize; 2], map: &Map) -> (Image, Vec<f32>) {
    let known = |i: usize| map.mask[i] > 0.0 && map.value[i].is_finite();
    let value = |i: usize| {
        let (sin, cos) = (2.0 * map.value[i]).sin_cos();
        if known(i) { [cos, sin, 1.0] } else { [0.0, 0.0, 1.0] }
    };
    let sigma = |i: usize| if known(i) && map.sigma[i].is_finite() { 2.0 * map.sigma[i] } else { 0.0 };
    let count = width * height;
    (Image { width, height, values: (0..count).map(value).collect() }, (0..count).map(sigma).collect())
}

fn origin(path: &Path, measured: bool) -> Result<Origin> {
    let name = path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
    let mut files = vec![];
    let all: Vec<PathBuf> = if path.is_dir() {
        ["orientation.exr", "period.exr", "stokes.exr", "report.json"].map(|n| path.join(n)).into()
    } else {
        vec![path.to_owned()]
    };
    for file in all.into_iter().filter(|f| f.is_file()) {
        files.push(signature(&file)?);
    }
    let session = session_of(path);
    let devices = session.as_ref().and_then(|s| s["devices"].as_array());
    let devices = devices.into_iter().flatten().filter_map(|d| d.as_str().map(str::to_owned)).collect();
    let captured_s = session.and_then(|s| s["created"].as_u64());
    Ok(Origin { name, files, devices, captured_s, measured })
}

/// Name and hash of a file.
///
/// # Errors
/// `Input` if it cannot be read.
pub fn signature(path: &Path) -> Result<Signature> {
    let bytes = input::read(path, MOST_MAP_BYTES).map_err(|e| Error::file(path, e, "give a readable file"))?;
    let sha256 = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
    Ok(Signature { file: path.file_name().unwrap_or_default().to_string_lossy().into_owned(), sha256 })
}

/// The session of a result: its `session.json` lies in the result folder, beside it, or in a folder `session` beside
/// it.
fn session_of(path: &Path) -> Option<Value> {
    let parent = path.parent();
    let places = [Some(path.to_owned()), parent.map(Path::to_owned), parent.map(|p| p.join("session"))];
    places.into_iter().flatten().find_map(|place| {
        let bytes = input::read(&place.join("session.json"), MOST_JSON_BYTES).ok()?;
        serde_json::from_slice(&bytes).ok()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_image::write_exr;

    /// Writes a result folder of 8 × 8 pixels whose orientations are those of the Stokes parameters, changed by a
    /// model.
    fn folder(place: &Path, name: &str, model: fn(f32) -> f32) -> PathBuf {
        let folder = place.join(name);
        std::fs::create_dir_all(&folder).unwrap();
        let angle = |x: usize, y: usize| 0.3 * x as f32 + 0.02 * y as f32;
        let write = |file: &str, channels: &[&str], of: &(dyn Fn(usize, f32) -> f32 + Sync)| {
            let fill = |channel: usize, y: usize, row: &mut [f32]| {
                row.iter_mut().enumerate().for_each(|(x, v)| *v = of(channel, angle(x, y)));
            };
            write_exr(&folder.join(file), 8, 8, channels, &[], &fill).unwrap();
        };
        let stokes = |channel: usize, angle: f32| [2.0, 1.2 * (2.0 * angle).cos(), 1.2 * (2.0 * angle).sin()][channel];
        write("stokes.exr", &["S0", "S1", "S2"], &stokes);
        let orientation = move |channel: usize, angle: f32| [model(angle), 0.001, 1.0][channel];
        write("orientation.exr", &["orientation", "sigma", "mask"], &orientation);
        folder
    }

    /// `--model auto` may choose another model for each sheet, whose orientations are not alike.
    #[test]
    fn a_sheet_does_not_depend_on_the_model_of_its_orientations() {
        let place = tempfile::tempdir().unwrap();
        let read = |name: &str, model: fn(f32) -> f32| Sheet::read(&folder(place.path(), name, model)).unwrap();
        let (plain, film) = (read("plain", |a| a), read("film", |a| a + 0.1 * (2.0 * a).sin()));
        assert!(plain.has_light && plain.image == film.image && plain.sigma == film.sigma);
        // A comparison with a design has orientations alone, and there the model counts.
        assert!(plain.without_light().image != film.without_light().image);
    }
}
