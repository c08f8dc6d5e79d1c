//! Radiance HDR files (`.hdr`, `.pic`): RGBE and XYZE in all eight orientations, divided by exposure and colour
//! correction.
//!
//! Source: the Radiance manual, "Radiance File Formats".

use std::io::{BufRead, Read};

use super::fault::{Decoded, Fault};
use super::light::{Light, Samples3, converted};
use super::primaries::Primaries;
use super::raster::{Depth, Info, Raster, Samples, zeroed};
use super::source::Source;

/// Longest header, in bytes.
const MAX_HEADER: usize = 1 << 20;

/// Widths of scanlines that may be compressed by component.
const COMPRESSED: std::ops::RangeInclusive<usize> = 8..=32_767;

/// Header of a picture.
#[derive(Debug)]
struct Header {
    xyz: bool,
    /// Product of all exposures and colour corrections, per component.
    exposure: [f64; 3],
    primaries: Option<Primaries>,
    order: Order,
    info: Info,
}

/// Storage order of pixels, from the resolution string.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Order {
    /// Scanlines are columns.
    columns: bool,
    /// The first scanline, or the first pixel of one, is at the top.
    down: bool,
    /// The first scanline, or the first pixel of one, is at the left.
    right: bool,
    scanlines: usize,
    length: usize,
}

impl Order {
    /// Parses a line such as `-Y 512 +X 768`.
    fn parse(line: &str) -> Option<Self> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [first, scanlines, second, length] = words.as_slice() else { return None };
        let (columns, [x, y]) = match (*first, *second) {
            ("+X" | "-X", "+Y" | "-Y") => (true, [first, second]),
            ("+Y" | "-Y", "+X" | "-X") => (false, [second, first]),
            _ => return None,
        };
        let (down, right) = (*y == "-Y", *x == "+X");
        Some(Self { columns, down, right, scanlines: scanlines.parse().ok()?, length: length.parse().ok()? })
    }

    /// Width and height of the picture.
    fn size(self) -> [usize; 2] {
        if self.columns { [self.scanlines, self.length] } else { [self.length, self.scanlines] }
    }

    /// Row-major index, from the top left, of a pixel of a scanline.
    fn index(self, scanline: usize, pixel: usize) -> usize {
        let [width, height] = self.size();
        let [x, y] = if self.columns { [scanline, pixel] } else { [pixel, scanline] };
        let x = if self.right { x } else { width - 1 - x };
        let y = if self.down { y } else { height - 1 - y };
        y * width + x
    }
}

fn line(source: &mut Source, left: &mut usize) -> Decoded<String> {
    let mut bytes = vec![];
    source.by_ref().take(*left as u64).read_until(b'\n', &mut bytes)?;
    *left -= bytes.len();
    if bytes.pop() != Some(b'\n') {
        let limit = if *left == 0 { "the header is too long" } else { "the file ends within its header" };
        return Err(Fault::damaged(limit));
    }
    Ok(String::from_utf8_lossy(&bytes).trim_end_matches('\r').to_owned())
}

/// Reads the header, and places the source at the first scanline.
fn header(source: &mut Source) -> Decoded<Header> {
    let mut left = MAX_HEADER;
    line(source, &mut left)?;
    let (mut xyz, mut exposure, mut primaries) = (false, [1.0; 3], None);
    loop {
        let line = line(source, &mut left)?;
        if line.is_empty() {
            break;
        }
        // Lines that begin with a space are history: they belong to the source pictures.
        let Some((key, value)) = line.split_once('=').filter(|_| !line.starts_with(char::is_whitespace)) else {
            continue;
        };
        match (key.trim_end(), value.trim()) {
            ("FORMAT", "32-bit_rle_rgbe") => xyz = false,
            ("FORMAT", "32-bit_rle_xyze") => xyz = true,
            ("FORMAT", other) => {
                let problem = format!("has the format {other:?}; 32-bit_rle_rgbe and 32-bit_rle_xyze are read");
                return Err(Fault::unusable(problem, "convert it to one of these"));
            }
            ("EXPOSURE", value) => {
                let [factor] = numbers("EXPOSURE", value)?;
                exposure = exposure.map(|e| e * factor);
            }
            ("COLORCORR", value) => {
                let factors: [f64; 3] = numbers("COLORCORR", value)?;
                exposure = std::array::from_fn(|c| exposure[c] * factors[c]);
            }
            ("PRIMARIES", value) => primaries = Some(Primaries::from_numbers(numbers("PRIMARIES", value)?)),
            _ => {}
        }
    }
    if exposure.iter().any(|e| !(e.is_finite() && *e > 0.0)) {
        let problem = format!("has exposures and colour corrections with the product {exposure:?}");
        return Err(Fault::unusable(problem, "correct EXPOSURE and COLORCORR in its header"));
    }
    let resolution = line(source, &mut left)?;
    let order = Order::parse(&resolution)
        .ok_or_else(|| Fault::damaged(format!("{resolution:?} is no resolution such as \"-Y 512 +X 768\"")))?;
    let info = Info::checked(order.size().map(|n| n as u64), 3, Depth::F32, 3, 4)?;
    Ok(Header { xyz, exposure, primaries, order, info })
}

/// Parses exactly N numbers.
fn numbers<const N: usize>(key: &str, text: &str) -> Decoded<[f64; N]> {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    let wrong = || {
        let problem = format!("has the header line {key}={text}, which is not {N} numbers");
        Fault::unusable(problem, "correct this line of its header")
    };
    numbers.and_then(|all| all.try_into().ok()).ok_or_else(wrong)
}

pub(super) fn info(mut source: Source) -> Decoded<Info> {
    header(&mut source).map(|header| header.info)
}

/// Reads the picture in the primaries of the file; X, Y and Z are converted to Rec. 709.
pub(super) fn read(mut source: Source) -> Decoded<Raster> {
    let header = header(&mut source)?;
    let mut samples = pixels(&mut source, &header)?;
    if header.xyz {
        let matrix = Primaries::XYZ.to_rec709().ok().flatten().unwrap_or_default();
        samples.as_chunks_mut::<3>().0.iter_mut().for_each(|pixel| *pixel = converted(&matrix, *pixel));
    }
    header.info.raster(Samples::F32(samples))
}

/// Reads the picture as a light source, with notes on its header.
pub(super) fn read_light(mut source: Source) -> Decoded<Light> {
    let header = header(&mut source)?;
    let samples = pixels(&mut source, &header)?;
    let mut notes = vec![];
    if header.exposure != [1.0; 3] {
        let [r, g, b] = header.exposure;
        let words = if r == g && g == b { format!("{r}") } else { format!("{r}, {g}, {b}") };
        notes.push(format!("radiance divided by the exposure and colour correction of its header ({words})"));
    }
    let primaries = if header.xyz { Some(Primaries::XYZ) } else { header.primaries };
    Light::new(header.order.size(), Samples3::Rgb(samples), primaries, notes)
}

fn pixels(source: &mut Source, header: &Header) -> Decoded<Vec<f32>> {
    let Header { order, exposure, .. } = *header;
    let mut samples = zeroed::<f32>(header.info.len())?;
    let mut scanline = vec![[0_u8; 4]; order.length];
    // Mantissas are divided by 256, exponents have an offset of 128.
    let scale: Vec<[f64; 3]> =
        (0..=255).map(|e| exposure.map(|by| if e == 0 { 0.0 } else { 2.0_f64.powi(e - 136) / by })).collect();
    for k in 0..order.scanlines {
        read_scanline(source, &mut scanline)?;
        for (pixel, [r, g, b, e]) in scanline.iter().enumerate() {
            let at = 3 * order.index(k, pixel);
            let scale = &scale[usize::from(*e)];
            let mantissas = [*r, *g, *b];
            let values = std::array::from_fn::<f32, 3, _>(|c| (f64::from(mantissas[c]) * scale[c]) as f32);
            samples[at..at + 3].copy_from_slice(&values);
        }
    }
    Ok(samples)
}

fn bytes<const N: usize>(source: &mut Source) -> Decoded<[u8; N]> {
    let mut bytes = [0; N];
    source.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// Reads a scanline: runs by component, or pixels, of which (1, 1, 1, n) repeats the previous one.
fn read_scanline(source: &mut Source, pixels: &mut [[u8; 4]]) -> Decoded<()> {
    let first = bytes::<4>(source)?;
    let length = usize::from(u16::from_be_bytes([first[2], first[3]]));
    if COMPRESSED.contains(&pixels.len()) && first[..2] == [2, 2] && first[2] < 128 {
        if length != pixels.len() {
            return Err(Fault::damaged(format!(
                "a scanline of {length} pixels where the header says {}",
                pixels.len()
            )));
        }
        return (0..4).try_for_each(|component| read_component(source, pixels, component));
    }
    let (mut at, mut next, mut shift) = (0, Some(first), 0);
    while at < pixels.len() {
        let pixel = match next.take() {
            Some(first) => first,
            None => bytes(source)?,
        };
        if pixel[..3] == [1, 1, 1] {
            let run = usize::from(pixel[3]) << shift;
            let before = at.checked_sub(1).map(|k| pixels[k]).filter(|_| run <= pixels.len() - at);
            let before = before.ok_or_else(|| Fault::damaged("a run of pixels leaves its scanline"))?;
            pixels[at..at + run].fill(before);
            at += run;
            shift = (shift + 8).min(24);
        } else {
            pixels[at] = pixel;
            at += 1;
            shift = 0;
        }
    }
    Ok(())
}

fn read_component(source: &mut Source, pixels: &mut [[u8; 4]], component: usize) -> Decoded<()> {
    let mut at = 0;
    while at < pixels.len() {
        let [code] = bytes(source)?;
        let (count, run) = if code > 128 { (usize::from(code) - 128, true) } else { (usize::from(code), false) };
        if count == 0 || count > pixels.len() - at {
            return Err(Fault::damaged("a run of pixels leaves its scanline"));
        }
        let repeated = if run { Some(bytes::<1>(source)?[0]) } else { None };
        for pixel in &mut pixels[at..at + count] {
            pixel[component] = match repeated {
                Some(value) => value,
                None => bytes::<1>(source)?[0],
            };
        }
        at += count;
    }
    Ok(())
}
