//! Pictures of OpenEXR files, also with subsampled channels (luminance and chroma).
//!
//! The exr crate refuses subsampled channels but can decompress their blocks; this module reads the rest of such files.

use std::io::{Read, Seek, SeekFrom};

use exr::compression::Compression;
use exr::math::Vec2;
use exr::meta::attribute::{ChannelDescription, ChannelList, IntegerBounds, SampleType};
use exr::meta::header::Header;

use super::EXPORT;
use super::choice::{Channels, Choice, choose};
use super::layer::{Layer, Window, check_table, fault, floats, headers, is_subsampled};
use crate::fault::{Decoded, Fault};
use crate::primaries::Primaries;
use crate::raster::zeroed;
use crate::source::Source;

/// Largest subsampling factor.
const MOST_SAMPLING: usize = 8;

/// Third byte of a B44 block from which all its samples are equal.
const FLAT_B44: u8 = 13 << 2;

/// Opened file before its pixels are read.
pub(super) enum Opened {
    Plain(Box<Layer>),
    Subsampled(Box<Subsampled>),
}

/// Opens a file and chooses its picture; returns its width and height too.
pub(super) fn open(
    mut source: Source,
    wanted: Option<&str>,
    remedy: &'static str,
) -> Decoded<(Opened, Choice, [usize; 2])> {
    let meta = headers(&mut source)?;
    let choice = choose(&meta.headers, wanted, remedy)?;
    if !meta.headers.iter().any(is_subsampled) {
        source.rewind()?;
        let layer = Layer::open(source, choice.header)?;
        let size = layer.window.size;
        return Ok((Opened::Plain(Box::new(layer)), choice, size));
    }
    let Ok([header]) = <[Header; 1]>::try_from(meta.headers.into_vec()) else {
        return Err(Fault::unusable("has subsampled channels in one of several parts, which is not read", EXPORT));
    };
    let file = Subsampled::new(source, header)?;
    let size = file.window.size;
    Ok((Opened::Subsampled(Box::new(file)), choice, size))
}

impl Opened {
    pub(super) fn header(&self) -> &Header {
        match self {
            Self::Plain(layer) => layer.header(),
            Self::Subsampled(file) => &file.header,
        }
    }

    pub(super) fn window(&self) -> Window {
        match self {
            Self::Plain(layer) => layer.window,
            Self::Subsampled(file) => file.window,
        }
    }

    /// Samples of the picture, interleaved; luminance and chroma are converted to R, G and B.
    pub(super) fn picture(self, choice: &Choice) -> Decoded<Vec<f32>> {
        let [width, height] = self.window().size;
        let wanted = match choice.channels {
            Channels::Grey(channel) => vec![channel],
            Channels::Rgb(channels) | Channels::Chroma(channels) => channels.to_vec(),
        };
        let primaries = self.header().shared_attributes.chromaticities.map_or(Primaries::REC709, Primaries::from_exr);
        let mut samples = zeroed::<f32>(width * height * wanted.len())?;
        let put = |channel: usize, start: usize, line: &[f32]| {
            if let Some(to) = wanted.iter().position(|&w| w == channel) {
                let targets = samples[start * wanted.len() + to..].iter_mut().step_by(wanted.len());
                targets.zip(line).for_each(|(target, value)| *target = *value);
            }
        };
        match self {
            Self::Plain(layer) => layer.decode(put)?,
            Self::Subsampled(file) => file.decode(&wanted, put)?,
        }
        if let Channels::Chroma(_) = choice.channels {
            let line = || Fault::unusable("has primaries that lie on a line", "correct its chromaticities");
            let [red, green, blue] = primaries.luminance().ok_or_else(line)?;
            for [y, ry, by] in samples.as_chunks_mut::<3>().0 {
                let luminance = f64::from(*y);
                let r = (f64::from(*ry) + 1.0) * luminance;
                let b = (f64::from(*by) + 1.0) * luminance;
                let g = (luminance - red * r - blue * b) / green;
                [*y, *ry, *by] = [r, g, b].map(|v| v as f32);
            }
        }
        Ok(samples)
    }
}

/// Single-part scanline file with subsampled channels.
pub(super) struct Subsampled {
    source: Source,
    header: Header,
    window: Window,
    /// Offsets of the blocks in the file.
    offsets: Vec<u64>,
}

impl Subsampled {
    /// Checks the header, which has been read, and reads the table of offsets.
    fn new(mut source: Source, header: Header) -> Decoded<Self> {
        let window = Window::of(&header)?;
        check_header(&header, &window)?;
        check_table(header.chunk_count as u64, source.get_ref().metadata()?.len())?;
        let mut offsets = Vec::with_capacity(header.chunk_count);
        for _ in 0..header.chunk_count {
            let mut bytes = [0; 8];
            source.read_exact(&mut bytes)?;
            offsets.push(u64::from_le_bytes(bytes));
        }
        Ok(Self { source, header, window, offsets })
    }

    /// Calls `put(channel, index of the first pixel in the picture, values)` for every row of the wanted channels.
    fn decode(mut self, wanted: &[usize], mut put: impl FnMut(usize, usize, &[f32])) -> Decoded<()> {
        let [width, height] = self.window.data;
        let channels = self.header.channels.list.to_vec();
        let mut planes = vec![vec![]; channels.len()];
        for &k in wanted {
            let [columns, rows] = resolution(&channels[k], [width, height]);
            planes[k] = zeroed::<f32>(columns * rows)?;
        }
        let mut found = vec![false; height];
        for offset in std::mem::take(&mut self.offsets) {
            self.block(offset, &channels, &mut planes, &mut found)?;
        }
        if found.contains(&false) {
            return Err(Fault::damaged("some rows are missing"));
        }
        let mut line = vec![0.0; width];
        for &k in wanted {
            for y in 0..height {
                interpolate(&planes[k], &channels[k], [width, height], y, &mut line);
                if let Some((start, seen)) = self.window.place([0, y], width) {
                    put(k, start, &line[seen]);
                }
            }
        }
        Ok(())
    }

    /// Reads a block: its first row, the length of its data, and its data.
    fn block(
        &mut self,
        offset: u64,
        channels: &[ChannelDescription],
        planes: &mut [Vec<f32>],
        found: &mut [bool],
    ) -> Decoded<()> {
        self.source.seek(SeekFrom::Start(offset))?;
        let mut words = [[0; 4]; 2];
        self.source.read_exact(words.as_flattened_mut())?;
        let [top, length] = words.map(i32::from_le_bytes);
        let [width, height] = self.window.data;
        let position = self.header.own_attributes.layer_position;
        let lines = self.header.compression.scan_lines_per_block();
        let first = i64::from(top) - i64::from(position.1);
        if first < 0 || first >= height as i64 || !(first as usize).is_multiple_of(lines) {
            return Err(Fault::damaged("a block lies outside the picture"));
        }
        let first = first as usize;
        let rows = lines.min(height - first);
        let expected: usize = (first..first + rows).map(|y| row_bytes(channels, width, y)).sum();
        if length < 0 || length as usize > expected {
            return Err(Fault::damaged(format!("a block of {length} bytes for {expected}")));
        }
        let mut bytes = vec![0; length as usize];
        self.source.read_exact(&mut bytes)?;
        let bounds = IntegerBounds::new(Vec2(position.0, top), Vec2(width, rows));
        let bytes = self.decompressed(bytes, expected, bounds)?;
        let mut at = 0;
        let mut values = vec![];
        found[first..first + rows].fill(true);
        for y in first..first + rows {
            for (channel, plane) in channels.iter().zip(&mut *planes).filter(|(c, _)| y.is_multiple_of(c.sampling.1)) {
                let columns = width / channel.sampling.0;
                let end = at + columns * channel.sample_type.bytes_per_sample();
                if !plane.is_empty() {
                    values.clear();
                    floats(&bytes[at..end], channel.sample_type, &mut values);
                    let start = y / channel.sampling.1 * columns;
                    plane[start..start + columns].copy_from_slice(&values);
                }
                at = end;
            }
        }
        Ok(())
    }

    /// Samples of a block, row by row and channel by channel.
    fn decompressed(&self, bytes: Vec<u8>, expected: usize, bounds: IntegerBounds) -> Decoded<Vec<u8>> {
        // Blocks that compression would enlarge are stored uncompressed.
        let compressed = bytes.len() != expected;
        if compressed && matches!(self.header.compression, Compression::B44 | Compression::B44A) {
            return self.decompressed_b44(&bytes, bounds);
        }
        if !expected.is_multiple_of(bounds.size.area()) {
            return Err(Fault::unusable("has subsampled channels of an unusual kind", EXPORT));
        }
        let mut header = self.header.clone();
        // The exr crate takes the size of a block to be pixels times bytes per pixel.
        header.channels.bytes_per_pixel = expected / bounds.size.area();
        let bytes = section(&header, bytes, bounds)?;
        if bytes.len() == expected { Ok(bytes) } else { Err(Fault::damaged("a block has another size")) }
    }

    /// Decompresses B44, which stores one channel after the other in blocks of 4 x 4 samples; each channel is treated
    /// as a picture.
    fn decompressed_b44(&self, bytes: &[u8], bounds: IntegerBounds) -> Decoded<Vec<u8>> {
        let [width, height] = [bounds.size.0, bounds.size.1];
        let early = || Fault::damaged("a block ends too early");
        let mut rest = bytes;
        let mut planes = vec![];
        for channel in &self.header.channels.list {
            let [columns, rows] = resolution(channel, [width, height]);
            let raw = columns * rows * channel.sample_type.bytes_per_sample();
            if channel.sample_type != SampleType::F16 {
                let (plane, after) = rest.split_at_checked(raw).ok_or_else(early)?;
                planes.push(self.single(channel, plane.to_vec(), [columns, rows])?);
                rest = after;
                continue;
            }
            let mut length = 0;
            for _ in 0..columns.div_ceil(4) * rows.div_ceil(4) {
                let code = *rest.get(length + 2).ok_or_else(early)?;
                length += if code >= FLAT_B44 { 3 } else { 14 };
            }
            let (data, after) = rest.split_at_checked(length).ok_or_else(early)?;
            let mut data = data.to_vec();
            if data.len() == raw {
                // Data as long as the samples would count as uncompressed.
                data.push(0);
            }
            planes.push(self.single(channel, data, [columns, rows])?);
            rest = after;
        }
        let mut lines = vec![];
        for y in 0..height {
            for (channel, plane) in
                self.header.channels.list.iter().zip(&planes).filter(|(c, _)| y.is_multiple_of(c.sampling.1))
            {
                let length = width / channel.sampling.0 * channel.sample_type.bytes_per_sample();
                let start = y / channel.sampling.1 * length;
                lines.extend(plane.get(start..start + length).ok_or_else(early)?);
            }
        }
        Ok(lines)
    }

    /// Decompresses one channel of a block.
    fn single(&self, channel: &ChannelDescription, data: Vec<u8>, [columns, rows]: [usize; 2]) -> Decoded<Vec<u8>> {
        if columns * rows == 0 {
            return Ok(vec![]);
        }
        let mut header = self.header.clone();
        let channel = ChannelDescription { sampling: Vec2(1, 1), ..channel.clone() };
        header.channels = ChannelList::new(std::iter::once(channel).collect());
        section(&header, data, IntegerBounds::new(Vec2(0, 0), Vec2(columns, rows)))
    }
}

fn section(header: &Header, bytes: Vec<u8>, bounds: IntegerBounds) -> Decoded<Vec<u8>> {
    header.compression.decompress_image_section_from_le(header, bytes, bounds, false).map_err(fault)
}

/// Bytes per row of all channels.
fn row_bytes(channels: &[ChannelDescription], width: usize, y: usize) -> usize {
    let stored = channels.iter().filter(|c| y.is_multiple_of(c.sampling.1));
    stored.map(|c| width / c.sampling.0 * c.sample_type.bytes_per_sample()).sum()
}

/// Columns and rows of samples of a channel.
fn resolution(channel: &ChannelDescription, [width, height]: [usize; 2]) -> [usize; 2] {
    [width / channel.sampling.0, height / channel.sampling.1]
}

fn check_header(header: &Header, window: &Window) -> Decoded<()> {
    let unread =
        |words: &str| Err(Fault::unusable(format!("has subsampled channels {words}, which are not read"), EXPORT));
    if header.blocks != exr::meta::BlockDescription::ScanLines {
        return unread("in tiles");
    }
    match header.compression {
        Compression::Uncompressed | Compression::RLE | Compression::ZIP1 | Compression::ZIP16 | Compression::PIZ => {}
        Compression::B44 | Compression::B44A => {}
        other => return unread(&format!("with {other}")),
    }
    let position = header.own_attributes.layer_position;
    for channel in &header.channels.list {
        let [x, y] = [channel.sampling.0, channel.sampling.1];
        if x == 0 || y == 0 || x > MOST_SAMPLING || y > MOST_SAMPLING {
            return Err(Fault::damaged(format!("a channel has one sample in {x} x {y} pixels")));
        }
        let divides = |size: usize, position: i32, by: usize| size.is_multiple_of(by) && position % by as i32 == 0;
        if !divides(window.data[0], position.0, x) || !divides(window.data[1], position.1, y) {
            return Err(Fault::damaged("a sampling does not divide the data window"));
        }
    }
    Ok(())
}

/// Row of a channel, interpolated linearly between samples, which lie on the first pixel of their cell.
fn interpolate(plane: &[f32], channel: &ChannelDescription, size: [usize; 2], y: usize, line: &mut [f32]) {
    let [columns, rows] = resolution(channel, size);
    let [across, down] = [channel.sampling.0, channel.sampling.1];
    let row = |k: usize| &plane[k * columns..(k + 1) * columns];
    let (upper, lower) = (row(y / down), row((y / down + 1).min(rows - 1)));
    let v = (y % down) as f32 / down as f32;
    for (x, out) in line.iter_mut().enumerate() {
        let (left, right) = (x / across, (x / across + 1).min(columns - 1));
        let u = (x % across) as f32 / across as f32;
        // A weight of 0 would turn infinities into NaN.
        let mix = |a: f32, b: f32, t: f32| if t == 0.0 { a } else { a + t * (b - a) };
        *out = mix(mix(upper[left], upper[right], u), mix(lower[left], lower[right], u), v);
    }
}
