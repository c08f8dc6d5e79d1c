//! OpenEXR in: the first flat layer, any compression, half, float or integer samples as `f32`.

use std::collections::BTreeMap;
use std::path::Path;

use exr::block::UncompressedBlock;
use exr::block::chunk::Chunk;
use exr::block::lines::LineRef;
use exr::block::reader::{ChunksReader, Reader};
use exr::error::Error as ExrError;
use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, ChannelList, SampleType, Text};
use exr::meta::header::Header;
use exr::prelude::f16;
use rayon::prelude::*;

use super::fault::{Decoded, Fault};
use super::raster::{Depth, Info, Raster, Samples, check_size, zeroed};
use super::source::{Source, decode, open};
use nacre_base::guard::guarded;
use nacre_base::{Error, Result};

/// Bytes of blocks that are decompressed at a time; one block for each thread at least.
const BATCH_BYTES: usize = 16 << 20;

/// An EXR file as named planes.
#[derive(Debug, Clone, PartialEq)]
pub struct ExrMap {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// One plane of `width · height` values per channel, row 0 on top.
    pub channels: BTreeMap<String, Vec<f32>>,
    /// Text and number attributes other than those that every EXR has, as text.
    pub attributes: BTreeMap<String, String>,
}

impl ExrMap {
    /// Takes a channel out of the map that was read from `path`.
    ///
    /// # Errors
    /// `Input` when there is none of that name.
    pub fn take(&mut self, name: &str, path: &Path) -> Result<Vec<f32>> {
        self.channels
            .remove(name)
            .ok_or_else(|| Error::file(path, format!("has no channel {name}"), "give a map that has one"))
    }
}

/// Reads all channels and attributes of the first flat layer of an EXR file.
///
/// # Errors
/// `Error::Input` when the file cannot be read, is not an EXR, is damaged, or is beyond the size limits.
pub fn read_exr(path: &Path) -> Result<ExrMap> {
    decode(path, || read_map(open(path)?))
}

fn read_map(source: Source) -> Decoded<ExrMap> {
    let layer = Layer::open(source)?;
    let [width, height] = layer.size;
    let count = layer.header().channels.list.len();
    let mut planes = (0..count).map(|_| zeroed::<f32>(width * height)).collect::<Decoded<Vec<_>>>()?;
    let names: Vec<String> = layer.header().channels.list.iter().map(|c| utf8(&c.name)).collect();
    let attributes = attributes(layer.header());
    layer.decode(|channel, start, line| {
        let plane = &mut planes[channel][start..start + line.len()];
        plane.copy_from_slice(line);
    })?;
    Ok(ExrMap { width, height, channels: names.into_iter().zip(planes).collect(), attributes })
}

fn attributes(header: &Header) -> BTreeMap<String, String> {
    let all = header.own_attributes.other.iter().chain(&header.shared_attributes.other);
    let known = all.filter_map(|(name, value)| Some((utf8(name), plain(value)?)));
    let standard = [("comments", &header.own_attributes.comments), ("software", &header.own_attributes.software_name)];
    let standard = standard.into_iter().filter_map(|(name, text)| Some((name.to_string(), utf8(text.as_ref()?))));
    known.chain(standard).collect()
}

fn plain(value: &AttributeValue) -> Option<String> {
    match value {
        AttributeValue::F64(x) => Some(x.to_string()),
        AttributeValue::F32(x) => Some(x.to_string()),
        AttributeValue::I32(x) => Some(x.to_string()),
        AttributeValue::Text(x) => Some(utf8(x)),
        _ => None,
    }
}

fn utf8(text: &Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}

pub(super) fn layer_size(source: Source) -> Decoded<[usize; 2]> {
    Ok(Layer::open(source)?.size)
}

pub(super) fn info(source: Source) -> Decoded<Info> {
    let layer = Layer::open(source)?;
    let [width, height] = layer.size;
    Ok(Info { width, height, channels: layer.picture_channels()?.len(), depth: Depth::F32 })
}

pub(super) fn read(source: Source) -> Decoded<Raster> {
    let layer = Layer::open(source)?;
    let [width, height] = layer.size;
    let wanted = layer.picture_channels()?;
    let info = Info { width, height, channels: wanted.len(), depth: Depth::F32 };
    let mut samples = zeroed::<f32>(info.len())?;
    layer.decode(|channel, start, line| {
        if let Some(to) = wanted.iter().position(|&w| w == channel) {
            let targets = samples[start * wanted.len() + to..].iter_mut().step_by(wanted.len());
            targets.zip(line).for_each(|(target, value)| *target = *value);
        }
    })?;
    info.raster(Samples::F32(samples))
}

/// A layer whose size has been checked and whose pixels have not been touched.
struct Layer {
    reader: Reader<Source>,
    index: usize,
    size: [usize; 2],
}

impl Layer {
    fn open(source: Source) -> Decoded<Self> {
        let file_bytes = source.get_ref().metadata()?.len();
        let reader = Reader::read_from_buffered(source, false).map_err(fault)?;
        let mut chunks = 0_u64;
        for header in reader.headers() {
            size(header)?;
            chunks = chunks.saturating_add(header.chunk_count as u64);
        }
        // The table of chunk offsets holds 8 bytes per chunk.
        if chunks.saturating_mul(8) > file_bytes {
            return Err(Fault::damaged("the file is too short for its own table of contents"));
        }
        let flat = reader.headers().iter().position(|header| !header.deep);
        let index = flat.ok_or_else(|| Fault::unsupported("has only deep layers"))?;
        let size = size(&reader.headers()[index])?;
        Ok(Self { reader, index, size })
    }

    fn header(&self) -> &Header {
        &self.reader.headers()[self.index]
    }

    /// Which stored channels make the picture: R, G and B, or the only one, or Y; alpha is left out.
    fn picture_channels(&self) -> Decoded<Vec<usize>> {
        let names: Vec<String> = self.header().channels.list.iter().map(|c| utf8(&c.name)).collect();
        let find = |name: &str| names.iter().position(|n| n == name);
        let opaque = names.iter().filter(|n| *n != "A").count();
        match (opaque, [find("R"), find("G"), find("B")], find("Y")) {
            (3, [Some(r), Some(g), Some(b)], _) => Ok(vec![r, g, b]),
            (1, _, Some(y)) => Ok(vec![y]),
            _ if names.len() == 1 => Ok(vec![0]),
            _ => Err(Fault::unsupported(format!(
                "has the channels {}; a picture has R, G and B, or one channel",
                names.join(", ")
            ))),
        }
    }

    /// Calls `put(channel, index of the first pixel, values)` for every piece of row of every channel.
    fn decode(self, mut put: impl FnMut(usize, usize, &[f32])) -> Decoded<()> {
        let (index, [width, height]) = (self.index, self.size);
        let mut found = vec![0_usize; height];
        let mut values = Vec::with_capacity(width);
        let full = |layer: usize, level: exr::math::Vec2<usize>| layer == index && level.0 == 0 && level.1 == 0;
        let mut insert = |block: UncompressedBlock, channels: &ChannelList| {
            for line in block.lines(channels) {
                let at = line.location;
                let inside = at.position.0 + at.sample_count <= width && at.position.1 < height;
                if !inside || !full(at.layer, at.level) {
                    return Err(Fault::damaged("a block lies outside the picture"));
                }
                to_floats(&line, channels.list[at.channel].sample_type, &mut values);
                found[at.position.1] += usize::from(at.channel == 0) * values.len();
                put(at.channel, at.position.1 * width + at.position.0, &values);
            }
            Ok(())
        };
        let mut chunks =
            self.reader.filter_chunks(false, |_, _, block| full(block.layer, block.level)).map_err(fault)?;
        let meta = chunks.meta_data().clone();
        let header = &meta.headers[index];
        let batch = (BATCH_BYTES / header.max_block_byte_size().max(1)).max(rayon::current_num_threads());
        loop {
            let compressed =
                chunks.by_ref().take(batch).collect::<std::result::Result<Vec<Chunk>, _>>().map_err(fault)?;
            if compressed.is_empty() {
                break;
            }
            let blocks = compressed.into_par_iter().map(|chunk| decompress(chunk, &meta));
            for block in blocks.collect::<std::result::Result<Vec<_>, _>>().map_err(fault)? {
                insert(block, &header.channels)?;
            }
        }
        // Chunks may name the same block twice, and then another is missing.
        if found.iter().any(|&pixels| pixels != width) {
            return Err(Fault::damaged("some rows are missing"));
        }
        Ok(())
    }
}

/// Decompresses a block. The crate's own parallel reader does so in detached tasks, whose panics would end the process.
fn decompress(chunk: Chunk, meta: &MetaData) -> std::result::Result<UncompressedBlock, ExrError> {
    guarded(|| UncompressedBlock::decompress_chunk(chunk, meta, false))
        .unwrap_or_else(|panic| Err(ExrError::Invalid(panic.into())))
}

fn to_floats(line: &LineRef<'_>, kind: SampleType, values: &mut Vec<f32>) {
    values.clear();
    let words = line.value.as_chunks::<4>().0;
    match kind {
        SampleType::F32 => values.extend(words.iter().map(|b| f32::from_ne_bytes(*b))),
        SampleType::U32 => values.extend(words.iter().map(|b| u32::from_ne_bytes(*b) as f32)),
        SampleType::F16 => {
            values.extend(line.value.as_chunks::<2>().0.iter().map(|b| f16::from_ne_bytes(*b).to_f32()));
        }
    }
}

/// Checked size of a layer. Subsampled channels are refused.
fn size(header: &Header) -> Decoded<[usize; 2]> {
    let channels = &header.channels.list;
    if channels.iter().any(|c| c.sampling.0 != 1 || c.sampling.1 != 1) {
        return Err(Fault::unsupported("has subsampled channels"));
    }
    let size = [header.layer_size.0 as u64, header.layer_size.1 as u64];
    check_size(size, channels.len() as u64 * 4)
}

fn fault(error: ExrError) -> Fault {
    use ExrError as E;
    match error {
        E::Io(error) => error.into(),
        E::NotSupported(words) => Fault::unsupported(format!("cannot be decoded: {words}")),
        other => Fault::damaged(other),
    }
}
