//! Maps and frames as a Zarr v3 group, labelled for xarray.
//!
//! Only the part of Zarr v3 that these need is written here: groups, and arrays in regular chunks with the codecs
//! `bytes` and `gzip`. The crate `zarrs` would add 44 crates to the build.

use super::{Exported, maps, written};
use flate2::{Compression, write::GzEncoder};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_capture::session::RESULTS;
use nacre_frames::{FILE_NAME, FrameSet, LoadedFrames};
use nacre_image::{Depth, ExrHeader, Info, OutputFolder, Samples, read, read_exr_channel, read_exr_header};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Longest side of a chunk in pixels: about 1 MB of a map.
const CHUNK: usize = 512;

/// Level of deflate, as that of exported EXR files.
const LEVEL: u32 = 4;

/// An array: name in the store, dimensions with their lengths, Zarr data type, and attributes.
struct Array<'a> {
    name: String,
    dims: Vec<(&'a str, usize)>,
    data_type: &'static str,
    attributes: Map<String, Value>,
}

/// Writes all maps of a folder or file, each as a group, and the frames of a session as the group `frames`.
pub fn write(input: &Path, channels: &[String], folder: &OutputFolder, progress: &dyn Progress) -> Result<Exported> {
    let mut store = Store { folder, exported: Exported::default() };
    store.group("", Map::from_iter([("software".into(), concat!("nacre ", env!("CARGO_PKG_VERSION")).into())]))?;
    let mut maps: Vec<(String, PathBuf)> = maps::listed(input)?.into_iter().map(|path| (String::new(), path)).collect();
    let results = input.join(RESULTS);
    if results.is_dir() {
        maps.extend(maps::listed(&results)?.into_iter().map(|path| (format!("{RESULTS}/"), path)));
    }
    let headers = maps.iter().map(|(_, path)| read_exr_header(path)).collect::<Result<Vec<_>>>()?;
    maps::check_channels(channels, &headers)?;
    if maps.iter().any(|(prefix, _)| !prefix.is_empty()) {
        store.group(RESULTS, Map::new())?;
    }
    progress.stage("exporting maps", maps.len() as u64);
    for ((prefix, path), header) in maps.iter().zip(&headers) {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        store.map(path, header, &format!("{prefix}{stem}"), channels, progress)?;
        progress.step();
    }
    if channels.is_empty() && input.join(FILE_NAME).exists() {
        store.frames(&nacre_frames::load(input)?, progress)?;
    }
    if store.exported.files.len() < 2 {
        let remedy = "give a folder with results, or a session";
        return Err(Error::file(input, "contains neither maps (EXR) nor frames", remedy));
    }
    Ok(store.exported)
}

/// Group on disk.
struct Store<'a> {
    folder: &'a OutputFolder,
    exported: Exported,
}

impl Store<'_> {
    fn group(&mut self, name: &str, attributes: Map<String, Value>) -> Result<()> {
        self.metadata(name, &json!({"zarr_format": 3, "node_type": "group", "attributes": attributes}))
    }

    fn metadata(&mut self, name: &str, metadata: &Value) -> Result<()> {
        if !name.is_empty() {
            self.folder.create_dir(name)?;
        }
        let file = if name.is_empty() { "zarr.json".into() } else { format!("{name}/zarr.json") };
        self.folder.write_json(&file, metadata)?;
        written(&mut self.exported, self.folder, file)
    }

    /// Writes the channels of a map, with the positions of its pixels.
    fn map(
        &mut self,
        path: &Path,
        header: &ExrHeader,
        group: &str,
        wanted: &[String],
        progress: &dyn Progress,
    ) -> Result<()> {
        let channels: Vec<&String> =
            header.channels.iter().filter(|c| wanted.is_empty() || wanted.contains(c)).collect();
        if channels.is_empty() {
            return Ok(());
        }
        self.group(group, attributes(header))?;
        let (width, height) = (header.width, header.height);
        let pitch_um = header.attributes.get("pixel_um").and_then(|text| text.parse().ok());
        self.positions(group, [width, height], pitch_um)?;
        for channel in channels {
            progress.check()?;
            let missing =
                || Error::file(path, format!("has no channel {channel}"), "it was changed meanwhile; try again");
            let (values, _) = read_exr_channel(path, channel)?.ok_or_else(missing)?;
            let array = Array {
                name: format!("{group}/{}", channel.replace(['/', '\\'], "_")),
                dims: vec![("y", height), ("x", width)],
                data_type: "float32",
                attributes: described(channel, maps::unit(header, channel)),
            };
            self.array(&array, &[CHUNK.min(height), CHUNK.min(width)])?;
            self.tiles(&array, &[], &values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>())?;
        }
        Ok(())
    }

    /// Coordinates of pixel centres: x to the right from the left edge, y upwards from the lower edge, as angles of
    /// orientation are measured.
    fn positions(&mut self, group: &str, [width, height]: [usize; 2], pitch_um: Option<f64>) -> Result<()> {
        let (pitch, unit) = pitch_um.map_or((1.0, "px"), |pitch| (pitch, "um"));
        let columns: Vec<f64> = (0..width).map(|x| (x as f64 + 0.5) * pitch).collect();
        let rows: Vec<f64> = (0..height).map(|y| (height as f64 - 0.5 - y as f64) * pitch).collect();
        self.line(group, "x", "x", unit, "position to the right of the left edge", &columns)?;
        self.line(group, "y", "y", unit, "position above the lower edge", &rows)
    }

    /// Array of one dimension.
    fn line(&mut self, group: &str, name: &str, dim: &str, unit: &str, long: &str, values: &[f64]) -> Result<()> {
        let array = Array {
            name: format!("{group}/{name}"),
            dims: vec![(dim, values.len())],
            data_type: "float64",
            attributes: described(long, unit),
        };
        self.array(&array, &[values.len()])?;
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.chunk(&array.name, "c/0", &bytes)
    }

    /// Writes the photographs as one array, with analyser angles, exposures and gains beside them.
    fn frames(&mut self, loaded: &LoadedFrames, progress: &dyn Progress) -> Result<()> {
        let set = &loaded.set;
        let Info { width, height, channels, depth } = loaded.info;
        self.group("frames", json!(set).as_object().cloned().unwrap_or_default())?;
        self.positions("frames", [width, height], set.geometry.as_ref().and_then(|g| g.pixel_um))?;
        let mut attributes = described("values as in the files", "");
        attributes.insert("coordinates".into(), self.conditions(set)?.into());
        let mut array = Array {
            name: "frames/values".into(),
            dims: vec![("frame", set.frames.len()), ("y", height), ("x", width)],
            data_type: match depth {
                Depth::U8 => "uint8",
                Depth::U16 => "uint16",
                Depth::F32 => "float32",
            },
            attributes,
        };
        let mut chunk = vec![1, CHUNK.min(height), CHUNK.min(width)];
        if channels > 1 {
            array.dims.push(("colour", channels));
            chunk.push(channels);
        }
        self.array(&array, &chunk)?;
        progress.stage("exporting frames", set.frames.len() as u64);
        for (k, frame) in set.frames.iter().enumerate() {
            progress.check()?;
            let bytes = match read(&loaded.file(&frame.file))?.samples {
                Samples::U8(samples) => samples,
                Samples::U16(samples) => samples.iter().flat_map(|v| v.to_le_bytes()).collect(),
                Samples::F32(samples) => samples.iter().flat_map(|v| v.to_le_bytes()).collect(),
            };
            self.tiles(&array, &[k], &bytes)?;
            progress.step();
        }
        Ok(())
    }

    /// Writes analyser angles, exposures and gains, if frames state them; returns their names.
    fn conditions(&mut self, set: &FrameSet) -> Result<String> {
        let stated = [
            ("analyser_deg", "deg", "analyser angle", set.frames.iter().map(|f| f.analyser_deg).collect::<Vec<_>>()),
            ("exposure_s", "s", "exposure time", set.frames.iter().map(|f| f.exposure_s).collect()),
            ("gain", "1", "gain", set.frames.iter().map(|f| f.gain).collect()),
        ];
        let mut coordinates = vec![];
        for (name, unit, long, values) in stated {
            if values.iter().any(Option::is_some) {
                let values: Vec<f64> = values.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect();
                self.line("frames", name, "frame", unit, long, &values)?;
                coordinates.push(name);
            }
        }
        Ok(coordinates.join(" "))
    }

    /// Writes the metadata of an array in chunks of this shape.
    fn array(&mut self, array: &Array, chunk: &[usize]) -> Result<()> {
        let fill = if array.data_type.starts_with("float") { json!("NaN") } else { json!(0) };
        let metadata = json!({
            "zarr_format": 3,
            "node_type": "array",
            "shape": array.dims.iter().map(|d| d.1).collect::<Vec<_>>(),
            "dimension_names": array.dims.iter().map(|d| d.0).collect::<Vec<_>>(),
            "data_type": array.data_type,
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
            "fill_value": fill,
            "codecs": [
                {"name": "bytes", "configuration": {"endian": "little"}},
                {"name": "gzip", "configuration": {"level": LEVEL}},
            ],
            "attributes": array.attributes,
        });
        self.metadata(&array.name, &metadata)
    }

    /// Writes an image as chunks, of which those at the right and lower edge are padded with zeros. `before` are the
    /// indices of the dimensions before y.
    fn tiles(&mut self, array: &Array, before: &[usize], bytes: &[u8]) -> Result<()> {
        let lengths: Vec<usize> = array.dims[before.len()..].iter().map(|d| d.1).collect();
        let (height, width) = (lengths[0], lengths[1]);
        let pixel = bytes.len() / (width * height).max(1);
        let (rows, columns) = (CHUNK.min(height), CHUNK.min(width));
        let places: Vec<(usize, usize)> =
            (0..height.div_ceil(rows)).flat_map(|i| (0..width.div_ceil(columns)).map(move |j| (i, j))).collect();
        let packed: Vec<Vec<u8>> = places
            .par_iter()
            .map(|&(i, j)| {
                let mut tile = vec![0; rows * columns * pixel];
                let length = columns.min(width - j * columns) * pixel;
                for (row, target) in (i * rows..height.min((i + 1) * rows)).zip(tile.chunks_exact_mut(columns * pixel))
                {
                    let from = (row * width + j * columns) * pixel;
                    target[..length].copy_from_slice(&bytes[from..from + length]);
                }
                gzip(&tile)
            })
            .collect::<io::Result<_>>()
            .map_err(|e| Error::output(Path::new(&array.name), e))?;
        let index = |k: &usize| format!("/{k}");
        for ((i, j), packed) in places.into_iter().zip(packed) {
            let colour = if lengths.len() > 2 { "/0" } else { "" };
            let key = format!("c{}/{i}/{j}{colour}", before.iter().map(index).collect::<String>());
            self.packed(&array.name, &key, &packed)?;
        }
        Ok(())
    }

    fn chunk(&mut self, array: &str, key: &str, bytes: &[u8]) -> Result<()> {
        let packed = gzip(bytes).map_err(|e| Error::output(Path::new(array), e))?;
        self.packed(array, key, &packed)
    }

    fn packed(&mut self, array: &str, key: &str, packed: &[u8]) -> Result<()> {
        let file = format!("{array}/{key}");
        if let Some(parent) = Path::new(&file).parent() {
            self.folder.create_dir(&parent.to_string_lossy())?;
        }
        self.folder.write(&file, packed)?;
        written(&mut self.exported, self.folder, file)
    }
}

fn gzip(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(vec![], Compression::new(LEVEL));
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// Attributes of a map, numbers as such.
fn attributes(header: &ExrHeader) -> Map<String, Value> {
    let value = |text: &String| text.parse().ok().filter(|v: &f64| v.is_finite()).map_or(json!(text), |v| json!(v));
    header.attributes.iter().map(|(name, text)| (name.clone(), value(text))).collect()
}

/// Name and unit as in the conventions for climate and forecast metadata (CF).
fn described(long: &str, unit: &str) -> Map<String, Value> {
    let mut attributes = Map::from_iter([("long_name".into(), long.into())]);
    if !unit.is_empty() {
        attributes.insert("units".into(), unit.replace('µ', "u").into());
    }
    attributes
}
