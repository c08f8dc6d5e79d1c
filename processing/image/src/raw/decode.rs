//! Camera raw files, decoded by the crate rawler.

use std::io::Read;
use std::sync::{Arc, OnceLock};

use nacre_base::guard::guard_thread;
use rawler::cfa::CFA;
use rawler::decoders::{Decoder, RawDecodeParams, WellKnownIFD};
use rawler::formats::tiff::{Entry, IFD, Rational};
use rawler::imgop::{Dim2, Point, Rect};
use rawler::rawsource::RawSource;
use rawler::tags::{DngTag, TiffCommonTag};
use rawler::{RawImage, RawImageData, RawlerError};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::fault::{Decoded, Fault};
use crate::raster::{Depth, Info, Raster, Samples};
use crate::source::Source;

use super::Taken;
use super::cells::{Area, Cell, Sensor, Value, cell, not_bayer};
use super::limits;
use super::recognise::{Kind, Layout};

/// Photometric interpretation of a DNG with all colours per pixel (LinearRaw).
const LINEAR: usize = 34_892;
const REMEDY: &str = "convert it to DNG (Adobe DNG Converter, `dnglab convert`) or, with `dcraw -4 -h -o 0 -r 1 1 1 1 -T FILE`, to a linear 16-bit TIFF of half the size";

/// Remedy for a file that is a DNG already.
const DEVELOP: &str = "convert it with `dcraw -4 -h -o 0 -r 1 1 1 1 -T FILE` to a linear 16-bit TIFF";

/// Raw file whose tags have been read.
struct Opened {
    kind: Kind,
    file: RawSource,
    decoder: Box<dyn Decoder>,
}

/// Description of the sensor values, before they are decoded.
struct Layer {
    /// Width and height of the sensor in pixels.
    size: [usize; 2],
    planes: usize,
    area: Area,
    /// Origin of the pattern of black levels.
    origin: Point,
    cell: Option<Cell>,
    float: bool,
}

pub(crate) fn info(source: Source, kind: Kind) -> Decoded<Info> {
    pooled(|| open(source, kind)?.layer(None)?.info())
}

pub(crate) fn read(source: Source, kind: Kind) -> Decoded<Raster> {
    pooled(|| picture(source, kind))
}

/// Runs a decoder on its own threads, where panics caused by damaged files are not printed. Its loops over rows are
/// parallel.
fn pooled<T: Send>(decoder: impl FnOnce() -> Decoded<T> + Send) -> Decoded<T> {
    static THREADS: OnceLock<Option<ThreadPool>> = OnceLock::new();
    let build =
        || ThreadPoolBuilder::new().thread_name(|i| format!("raw {i}")).start_handler(|_| guard_thread()).build().ok();
    match THREADS.get_or_init(build) {
        Some(threads) => threads.install(decoder),
        None => decoder(),
    }
}

fn picture(source: Source, kind: Kind) -> Decoded<Raster> {
    let opened = open(source, kind)?;
    opened.layer(None)?.info()?;
    let image = opened.image(false)?;
    let layer = opened.layer(Some(&image))?;
    let info = layer.info()?;
    let white = opened.white(&image).unwrap_or(f64::INFINITY);
    let levels = layer.black(&image)?;
    let samples = match &image.data {
        RawImageData::Integer(values) => Samples::U16(layer.values(values, levels, white)?),
        RawImageData::Float(values) => Samples::F32(layer.values(values, levels, white)?),
    };
    info.raster(samples)
}

/// Black and white level in file values; `None` without a stated white level. The values are decoded, because cameras
/// measure black beside the picture.
pub(crate) fn levels(source: Source, kind: Kind) -> Decoded<Option<[f64; 2]>> {
    pooled(|| {
        let opened = open(source, kind)?;
        opened.layer(None)?.info()?;
        let image = opened.image(false)?;
        let black = highest(&opened.layer(Some(&image))?.black(&image)?);
        Ok(opened.white(&image).filter(|white| *white > black).map(|white| [black, white]))
    })
}

/// Exposure settings of files whose Exif tags only this decoder finds.
pub(crate) fn exposure(source: Source, kind: Kind) -> Option<Taken> {
    let opened = open(source, kind).ok()?;
    let exif = opened.decoder.raw_metadata(&opened.file, &RawDecodeParams::default()).ok()?.exif;
    let ratio = |value: Option<Rational>| value.map(|r| f64::from(r.n) / f64::from(r.d));
    // Sensitivities beyond 16 bits are in a second tag.
    let long = || exif.recommended_exposure_index.or(exif.iso_speed).map(f64::from);
    let iso = exif.iso_speed_ratings.filter(|iso| *iso != u16::MAX).map(f64::from).or_else(long);
    let positive = |value: Option<f64>| value.filter(|x| x.is_finite() && *x > 0.0);
    Some(Taken {
        seconds: positive(ratio(exif.exposure_time)),
        iso: positive(iso),
        aperture: positive(ratio(exif.fnumber)),
    })
}

fn open(mut source: Source, kind: Kind) -> Decoded<Opened> {
    if kind.layout == Layout::Other {
        return Err(Fault::unusable(format!("is a {} file (camera raw), which is not read", kind.name), REMEDY));
    }
    limits::check(&mut source, kind)?;
    let mut bytes = vec![];
    source.take(limits::MAX_FILE).read_to_end(&mut bytes)?;
    let file = RawSource::new_from_shared_vec(Arc::new(bytes));
    let decoder = rawler::get_decoder(&file).map_err(|error| fault(kind, error))?;
    Ok(Opened { kind, file, decoder })
}

impl Opened {
    /// Decoded values; with `dry`, all but the values (of most formats).
    fn image(&self, dry: bool) -> Decoded<RawImage> {
        let decode = || self.decoder.raw_image(&self.file, &RawDecodeParams::default(), dry);
        decode().map_err(|error| fault(self.kind, error))
    }

    /// Description from the decoded image, or without decoding.
    fn layer(&self, image: Option<&RawImage>) -> Decoded<Layer> {
        if self.kind.layout == Layout::Dng {
            return self.negative();
        }
        let dry = if image.is_none() { Some(self.image(true)?) } else { None };
        let Some(image) = image.or(dry.as_ref()) else { return Err(Fault::damaged("no picture")) };
        if image.fuji_rotation_width.is_some() {
            return Err(not_bayer("filters in diagonal rows (Super CCD)"));
        }
        if image.cpp != 1 {
            let problem =
                format!("is a {} file of reduced size (sRAW, sNEF), whose colours the camera computed", self.kind.name);
            return Err(Fault::unusable(problem, "record full-size raw files"));
        }
        let size = [image.width, image.height];
        let area = area(image.crop_area.or(image.active_area), size)?;
        let float = matches!(image.data, RawImageData::Float(_));
        let cell = mosaic(&image.camera.cfa, area)?;
        Ok(Layer { size, planes: 1, area, origin: Point::zero(), cell: Some(cell), float })
    }

    /// Description of a DNG, which the decoder gives only together with the values.
    fn negative(&self) -> Decoded<Layer> {
        let tags = self.decoder.ifd(WellKnownIFD::Raw).map_err(|error| fault(self.kind, error))?;
        let Some(tags) = tags else { return Err(Fault::damaged("no picture")) };
        let numbers = |entry: Option<&Entry>| -> Vec<usize> {
            entry.map_or(vec![], |e| (0..e.count().min(64)).map(|i| e.force_usize(i as usize)).collect())
        };
        let common = |tag: TiffCommonTag| numbers(tags.get_entry(tag));
        let negative = |tag: DngTag| numbers(tags.get_entry(tag));
        let one = |tag: TiffCommonTag| common(tag).first().copied();
        let (Some(width), Some(height)) = (one(TiffCommonTag::ImageWidth), one(TiffCommonTag::ImageLength)) else {
            return Err(Fault::damaged("no width and height"));
        };
        let planes = one(TiffCommonTag::SamplesPerPixel).unwrap_or(1);
        let active = match negative(DngTag::ActiveArea)[..] {
            [top, left, bottom, right] if bottom > top && right > left => {
                Rect::new(Point::new(left, top), Dim2::new(right - left, bottom - top))
            }
            _ => Rect::new(Point::zero(), Dim2::new(width, height)),
        };
        let crop = match (&negative(DngTag::DefaultCropOrigin)[..], &negative(DngTag::DefaultCropSize)[..]) {
            (&[x, y], &[w, h]) => {
                Rect::new(Point::new(active.p.x.saturating_add(x), active.p.y.saturating_add(y)), Dim2::new(w, h))
            }
            _ => active,
        };
        let size = [width, height];
        let area = area(Some(crop), size)?;
        unlike_the_sensor(&tags)?;
        let cell = match (one(TiffCommonTag::PhotometricInt), planes) {
            (Some(1), 1) | (Some(LINEAR), 1 | 3) => None,
            (Some(32_803), 1) => {
                let pattern = common(TiffCommonTag::CFAPattern);
                if common(TiffCommonTag::CFARepeatPatternDim) != [2, 2] || pattern.len() != 4 {
                    return Err(not_bayer(&format!("{} filters", pattern.len())));
                }
                let color = |y: usize, x: usize| {
                    let [y, x] = [(area.top + y + active.p.y) % 2, (area.left + x + active.p.x) % 2];
                    pattern[2 * y + x]
                };
                Some(cell(color)?)
            }
            (kind, _) => {
                let problem =
                    format!("is a DNG with {planes} values per pixel of kind {}, which is not read", kind.unwrap_or(0));
                return Err(Fault::unusable(problem, DEVELOP));
            }
        };
        let float = one(TiffCommonTag::SampleFormat) == Some(3);
        Ok(Layer { size, planes, area, origin: active.p, cell, float })
    }

    /// Lowest saturation level of all channels.
    fn white(&self, image: &RawImage) -> Option<f64> {
        let stated = || {
            let tags = self.decoder.ifd(WellKnownIFD::Raw).ok()??;
            tags.get_entry(TiffCommonTag::WhiteLevel).map(|_| ())
        };
        // For integers, the decoder's default applies.
        if matches!(image.data, RawImageData::Float(_)) && stated().is_none() {
            return Some(1.0);
        }
        image.whitelevel.0.iter().min().map(|white| f64::from(*white))
    }
}

impl Layer {
    /// Size and type of the picture: half the width and height of a mosaic's area.
    fn info(&self) -> Decoded<Info> {
        let Area { width, height, .. } = self.area;
        let depth = if self.float { Depth::F32 } else { Depth::U16 };
        let samples = self.size[0].saturating_mul(self.size[1]).saturating_mul(self.planes);
        if samples as u64 > limits::MAX_SAMPLES {
            return Err(Fault::too_large(format!("is {} x {} pixels", self.size[0], self.size[1])));
        }
        let (size, channels) =
            if self.cell.is_some() { ([width / 2, height / 2], 3) } else { ([width, height], self.planes) };
        Info::checked(size.map(|side| side as u64), channels, depth, channels as u64, depth.bytes() as u64)
    }

    /// Black levels by position in the cell, or by plane.
    fn black(&self, image: &RawImage) -> Decoded<Vec<f64>> {
        let black = &image.blacklevel;
        let levels: Vec<f64> = black.levels.iter().map(|r| f64::from(r.n) / f64::from(r.d.max(1))).collect();
        if levels.is_empty() || levels.iter().all(|level| *level == levels[0]) {
            return Ok(vec![levels.first().copied().unwrap_or(0.0); 4]);
        }
        let whole = levels.len() == black.width * black.height * black.cpp;
        if self.cell.is_none() {
            return match levels.len() {
                n if n == self.planes && whole => Ok(levels),
                _ => Err(Fault::unusable("has black levels that differ from pixel to pixel", REMEDY)),
            };
        }
        if !whole || black.cpp != 1 || !(1..=2).contains(&black.width) || !(1..=2).contains(&black.height) {
            let problem = format!("has black levels in a pattern of {} x {}", black.width, black.height);
            return Err(Fault::unusable(problem, REMEDY));
        }
        let at = |y: usize, x: usize| {
            let [y, x] = [self.area.top + y + self.origin.y, self.area.left + x + self.origin.x];
            levels[(y % black.height) * black.width + x % black.width]
        };
        Ok(vec![at(0, 0), at(0, 1), at(1, 0), at(1, 1)])
    }

    /// Values of the picture, with all black levels raised to the highest.
    fn values<T: Value>(&self, values: &[T], black: Vec<f64>, white: f64) -> Decoded<Vec<T>> {
        let [width, height] = self.size;
        if values.len() != width * height * self.planes {
            return Err(Fault::damaged(format!("{} values for {width} x {height} pixels", values.len())));
        }
        let common = highest(&black);
        let mut shifts = [0.0; 4];
        for (shift, level) in shifts.iter_mut().zip(black) {
            *shift = common - level;
        }
        let sensor = Sensor { values, width, planes: self.planes, shifts, white };
        match self.cell {
            Some(cell) => sensor.halved(self.area, cell),
            None => sensor.cropped(self.area),
        }
    }
}

fn highest(levels: &[f64]) -> f64 {
    levels.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

/// Refuses a DNG whose values become linear light, or get a common black level, only by processing steps that are not
/// supported.
fn unlike_the_sensor(tags: &IFD) -> Decoded<()> {
    const MAP_TABLE: u32 = 7;
    const MAP_POLYNOMIAL: u32 = 8;
    for list in [DngTag::OpcodeList1, DngTag::OpcodeList2] {
        let bytes = tags.get_entry(list).map_or(&[][..], |entry| entry.get_data());
        let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]));
        // Each step has number, version, flags, and length of its parameters.
        let mut at = 4;
        while let (Some(step), Some(length)) = (word(at), word(at + 12)) {
            if matches!(step, MAP_TABLE | MAP_POLYNOMIAL) {
                return Err(Fault::unusable("is a DNG with a tone curve (OpcodeList), as lossy ones have", DEVELOP));
            }
            at += 16 + length as usize;
        }
    }
    for delta in [DngTag::BlackLevelDeltaH, DngTag::BlackLevelDeltaV] {
        let entry = tags.get_entry(delta);
        if entry.is_some_and(|e| (0..e.count()).any(|i| e.force_f32(i as usize) != 0.0)) {
            return Err(Fault::unusable("is a DNG with black levels by row or column", DEVELOP));
        }
    }
    Ok(())
}

/// Area of the sensor (default all), which must be within it.
fn area(rect: Option<Rect>, size: [usize; 2]) -> Decoded<Area> {
    let [width, height] = size;
    let rect = rect.unwrap_or_else(|| Rect::new(Point::zero(), Dim2::new(width, height)));
    let fits = |from: usize, length: usize, all| from.checked_add(length).is_some_and(|end| end <= all);
    if rect.d.w == 0 || rect.d.h == 0 || !fits(rect.p.x, rect.d.w, width) || !fits(rect.p.y, rect.d.h, height) {
        return Err(Fault::damaged(format!("the picture is not within the {width} x {height} pixels of the sensor")));
    }
    Ok(Area { left: rect.p.x, top: rect.p.y, width: rect.d.w, height: rect.d.h })
}

/// Cell of a camera's mosaic at the origin of an area.
fn mosaic(filters: &CFA, area: Area) -> Decoded<Cell> {
    match (filters.width, filters.height) {
        (2, 2) => cell(|y, x| filters.color_at(area.top + y, area.left + x)),
        (6, 6) => Err(not_bayer("6 x 6 filters (X-Trans)")),
        (width, height) => Err(not_bayer(&format!("{width} x {height} filters"))),
    }
}

/// Message of a decoder's error; unknown cameras and variants are distinguished from damage.
fn fault(kind: Kind, error: RawlerError) -> Fault {
    match error {
        RawlerError::Unsupported { make, model, mode, .. } => {
            let said = [make, model, mode].map(|word| word.trim().to_owned());
            let camera = said.iter().filter(|word| !word.is_empty()).map(String::as_str).collect::<Vec<_>>().join(" ");
            let camera = if camera.is_empty() { camera } else { format!(" ({camera})") };
            Fault::unusable(format!("is a {} file of a camera that is not known{camera}", kind.name), REMEDY)
        }
        RawlerError::DecoderFailed(words) => {
            let lower = words.to_lowercase();
            if ["unsupported", "not supported", "don't know how"].iter().any(|w| lower.contains(w)) {
                return Fault::unusable(format!("is a {} file that is not read ({words})", kind.name), REMEDY);
            }
            Fault::damaged(format!("{} ({words})", kind.name))
        }
    }
}
