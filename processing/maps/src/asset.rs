//! Maps in memory and in files.

use nacre_base::{Error, Result};
use nacre_image::budget::Operation;
use nacre_image::{Attribute, ExrMap, MAX_PIXELS, OutputFolder, read_exr, write_exr};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Maximum number of pixels of a map to edit.
pub(super) const MOST_PIXELS: usize = MAX_PIXELS;

/// Quantity of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Direction of the grating vector, [0, π) rad, anticlockwise from the right.
    Orientation,
    /// Period in µm.
    Period,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 2] = [Self::Orientation, Self::Period];

    /// Name of the EXR channel.
    pub fn name(self) -> &'static str {
        match self {
            Self::Orientation => "orientation",
            Self::Period => "period",
        }
    }

    /// Name of the file.
    pub fn file(self) -> String {
        format!("{}.exr", self.name())
    }
}

/// One map: planes of `width · height` values, top row first.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Orientations (rad) or periods (µm), NaN where masked.
    pub value: Vec<f32>,
    /// Standard deviations of `value`, in the same unit; NaN where unknown.
    pub sigma: Vec<f32>,
    /// 1 where there is a value, otherwise 0.
    pub mask: Vec<f32>,
    /// Other channels.
    pub more: BTreeMap<String, Vec<f32>>,
    /// Attributes of the EXR header.
    pub attributes: BTreeMap<String, String>,
}

/// Maps of one sample, of equal size.
#[derive(Clone, Debug, PartialEq)]
pub struct Maps {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The maps by quantity; at least one.
    pub maps: BTreeMap<Kind, Map>,
}

impl Maps {
    /// Reads a folder of maps, or a single map file.
    ///
    /// # Errors
    /// `Input` for other files, and for maps of different sizes.
    pub fn read(input: &Path) -> Result<Self> {
        let remedy = "give a folder with orientation.exr or period.exr, or one of these files";
        let files: Vec<PathBuf> = if input.is_dir() {
            Kind::ALL.into_iter().map(|kind| input.join(kind.file())).filter(|path| path.is_file()).collect()
        } else {
            vec![input.to_path_buf()]
        };
        let mut all: Option<Self> = None;
        for path in &files {
            Operation::Maps(files.len()).check_file(path)?;
            let map = read_exr(path)?;
            let (width, height) = (map.width, map.height);
            let found = Kind::ALL.into_iter().find(|kind| map.channels.contains_key(kind.name()));
            let Some(kind) = found else {
                let names: Vec<&str> = map.channels.keys().map(String::as_str).collect();
                return Err(Error::file(path, format!("has the channels {}", names.join(", ")), remedy));
            };
            let map = Map::of(map, kind, path)?;
            match &mut all {
                None => all = Some(Self { width, height, maps: [(kind, map)].into() }),
                Some(others) if [others.width, others.height] != [width, height] => {
                    let problem = format!("is {width} × {height}, the other {} × {}", others.width, others.height);
                    return Err(Error::file(path, problem, "give maps of one size"));
                }
                Some(others) => {
                    if others.maps.insert(kind, map).is_some() {
                        return Err(Error::file(path, format!("is another map of {}s", kind.name()), remedy));
                    }
                }
            }
        }
        all.ok_or_else(|| Error::file(input, "holds no map", remedy))
    }

    /// Writes each map into a folder.
    ///
    /// # Errors
    /// `Output` if writing fails.
    pub fn write(&self, folder: &OutputFolder) -> Result<()> {
        for (kind, map) in &self.maps {
            let planes = map.planes(*kind);
            let names: Vec<&str> = planes.iter().map(|p| p.0).collect();
            let attributes: Vec<(&str, Attribute)> =
                map.attributes.iter().map(|(name, text)| (name.as_str(), attribute(text))).collect();
            write_exr(&folder.path(&kind.file()), self.width, self.height, &names, &attributes, &|c, y, row| {
                row.copy_from_slice(&planes[c].1[y * self.width..(y + 1) * self.width]);
            })?;
        }
        Ok(())
    }
}

/// Restores an attribute's type: text that a number would print identically becomes a number.
fn attribute(text: &str) -> Attribute {
    match text.parse::<f64>() {
        Ok(number) if number.to_string() == text => Attribute::Number(number),
        _ => Attribute::Text(text.to_owned()),
    }
}

impl Map {
    fn of(exr: ExrMap, kind: Kind, path: &Path) -> Result<Self> {
        let mut exr = exr;
        let count = exr.width * exr.height;
        let value = exr.take(kind.name(), path)?;
        let sigma = exr.channels.remove("sigma").unwrap_or_else(|| vec![f32::NAN; count]);
        let given = exr.channels.remove("mask");
        let mask: Vec<f32> = (0..count)
            .map(|i| f32::from(u8::from(value[i].is_finite() && given.as_ref().is_none_or(|m| m[i] > 0.5))))
            .collect();
        for (i, v) in value.iter().enumerate().filter(|(i, _)| mask[*i] > 0.0) {
            let wrong = match kind {
                Kind::Orientation => !(-1e-6..std::f32::consts::PI + 1e-6).contains(v),
                Kind::Period => !(*v > 0.0 && *v < 1e6),
            };
            if wrong {
                let problem = format!("has {} {v} in column {}, row {}", kind.name(), i % exr.width, i / exr.width);
                let remedy = "orientations are 0 to π, periods above 0 µm; mask (NaN) what is unknown";
                return Err(Error::file(path, problem, remedy));
            }
        }
        Ok(Self { value, sigma, mask, more: exr.channels, attributes: exr.attributes })
    }

    /// All channels by name.
    pub(super) fn planes(&self, kind: Kind) -> Vec<(&str, &Vec<f32>)> {
        let own = [(kind.name(), &self.value), ("sigma", &self.sigma), ("mask", &self.mask)];
        own.into_iter().chain(self.more.iter().map(|(n, p)| (n.as_str(), p))).collect()
    }

    /// Number of unmasked pixels.
    pub fn known(&self) -> usize {
        self.mask.iter().filter(|m| **m > 0.0).count()
    }

    /// Masks a pixel.
    pub(super) fn hide(&mut self, i: usize) {
        (self.value[i], self.mask[i]) = (f32::NAN, 0.0);
    }
}
