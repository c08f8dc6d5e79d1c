//! Layers of OpenEXR files: windows, sizes and blocks.

use std::io::{Read, Seek};
use std::ops::Range;

use exr::block::UncompressedBlock;
use exr::block::chunk::Chunk;
use exr::block::lines::LineRef;
use exr::block::reader::{ChunksReader, Reader};
use exr::error::Error as ExrError;
use exr::meta::MetaData;
use exr::meta::attribute::{ChannelList, SampleType};
use exr::meta::header::Header;
use exr::prelude::f16;
use rayon::prelude::*;

use super::EXPORT;
use crate::fault::{Decoded, Fault};
use crate::raster::check_size;
use crate::source::Source;
use nacre_base::guard::guarded;

/// Bytes of blocks that are decompressed together; at least one block per thread.
const BATCH_BYTES: usize = 16 << 20;

/// Number of the last compression known to the exr crate (HTJ2K 32).
const LAST_COMPRESSION: u8 = 11;

/// Number of bytes that are searched for the attributes of the first headers.
const HEADER_BYTES: u64 = 1 << 16;

/// Position of a layer's pixels (its data window) within the picture (the display window).
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    /// Width and height of the picture.
    pub size: [usize; 2],
    /// Width and height of the stored pixels.
    pub data: [usize; 2],
    /// Column and row of the picture at which the stored pixels begin.
    offset: [i64; 2],
}

impl Window {
    /// Windows of a header. Windows that do not overlap or are too large are refused.
    pub(super) fn of(header: &Header) -> Decoded<Self> {
        let bytes = header.channels.list.len() as u64 * 4;
        let data = check_size([header.layer_size.0 as u64, header.layer_size.1 as u64], bytes)?;
        let display = header.shared_attributes.display_window;
        let size = check_size([display.size.0 as u64, display.size.1 as u64], bytes)?;
        let position = header.own_attributes.layer_position;
        let offset = [
            i64::from(position.0) - i64::from(display.position.0),
            i64::from(position.1) - i64::from(display.position.1),
        ];
        let overlaps = |k: usize| offset[k] < size[k] as i64 && offset[k] + data[k] as i64 > 0;
        if !overlaps(0) || !overlaps(1) {
            let problem = "has a data window outside of its display window";
            return Err(Fault::unusable(problem, "correct its display window"));
        }
        Ok(Self { size, data, offset })
    }

    /// Whether the stored pixels fill the picture.
    pub(super) fn is_full(&self) -> bool {
        let covers = |k: usize| self.offset[k] <= 0 && self.offset[k] + self.data[k] as i64 >= self.size[k] as i64;
        covers(0) && covers(1)
    }

    /// Visible range of a piece of a stored row, and the index of its first pixel in the picture.
    pub(super) fn place(&self, [x, y]: [usize; 2], len: usize) -> Option<(usize, Range<usize>)> {
        let [column, row] = [x as i64 + self.offset[0], y as i64 + self.offset[1]];
        let [width, height] = self.size.map(|n| n as i64);
        let [begin, end] = [column.clamp(0, width), (column + len as i64).clamp(0, width)];
        let seen = (0..height).contains(&row) && begin < end;
        seen.then(|| ((row * width + begin) as usize, (begin - column) as usize..(end - column) as usize))
    }

    /// Row of the picture in which a stored row is visible.
    pub(super) fn row(&self, y: usize) -> Option<usize> {
        usize::try_from(y as i64 + self.offset[1]).ok().filter(|row| *row < self.size[1])
    }

    /// Note about windows that differ.
    pub(super) fn note(&self) -> Option<String> {
        let [width, height] = self.size;
        if self.offset == [0; 2] && self.data == self.size {
            return None;
        }
        let mut words = format!(
            "data window of {} x {} pixels placed at column {}, row {} of the display window of {width} x {height} pixels",
            self.data[0], self.data[1], self.offset[0], self.offset[1]
        );
        if !self.is_full() {
            words.push_str("; outside of it the picture is black");
        }
        Some(words)
    }
}

/// Reads the headers of a file. Compressions newer than the exr crate are distinguished from damage.
pub(super) fn headers(source: &mut Source) -> Decoded<MetaData> {
    MetaData::read_from_buffered(&mut *source, false).map_err(|error| {
        let newer = unknown_compression(source).map(|code| {
            let problem = format!("has the compression number {code}, which is not read");
            Fault::unusable(problem, "export it with another compression, such as ZIP")
        });
        newer.unwrap_or_else(|| fault(error))
    })
}

/// Number of a compression in a file's headers that the exr crate does not know.
fn unknown_compression(source: &mut Source) -> Option<u8> {
    const ATTRIBUTE: &[u8] = b"compression\0compression\0\x01\0\0\0";
    let mut bytes = vec![];
    source.rewind().ok()?;
    source.by_ref().take(HEADER_BYTES).read_to_end(&mut bytes).ok()?;
    let codes = bytes.windows(ATTRIBUTE.len() + 1).filter_map(|w| w.strip_prefix(ATTRIBUTE)).map(|rest| rest[0]);
    codes.into_iter().find(|code| *code > LAST_COMPRESSION)
}

/// Width and height of the picture of the first flat layer, from the header alone.
pub(super) fn size(mut source: Source) -> Decoded<[usize; 2]> {
    let meta = headers(&mut source)?;
    Ok(Window::of(&meta.headers[first_flat(&meta.headers)?])?.size)
}

fn first_flat(headers: &[Header]) -> Decoded<usize> {
    let flat = headers.iter().position(|header| !header.deep);
    flat.ok_or_else(|| Fault::unusable("has only deep layers, which are not read", EXPORT))
}

/// Whether channels of a flat layer are subsampled.
pub(super) fn is_subsampled(header: &Header) -> bool {
    !header.deep && header.channels.list.iter().any(|c| c.sampling.0 != 1 || c.sampling.1 != 1)
}

/// Layer with checked size, before its pixels are read.
pub(super) struct Layer {
    reader: Reader<Source>,
    index: usize,
    pub window: Window,
}

impl Layer {
    /// Opens the first flat layer.
    pub(super) fn first(mut source: Source) -> Decoded<Self> {
        let meta = headers(&mut source)?;
        let index = first_flat(&meta.headers)?;
        if is_subsampled(&meta.headers[index]) {
            return Err(Fault::unusable(
                "has subsampled channels, which a map may not have",
                "export it without subsampling",
            ));
        }
        source.rewind()?;
        Self::open(source, index)
    }

    /// Opens a flat layer by its index.
    pub(super) fn open(source: Source, index: usize) -> Decoded<Self> {
        let file_bytes = source.get_ref().metadata()?.len();
        let reader = Reader::read_from_buffered(source, false).map_err(fault)?;
        let mut chunks = 0_u64;
        for header in reader.headers() {
            check_size(
                [header.layer_size.0 as u64, header.layer_size.1 as u64],
                header.channels.list.len() as u64 * 4,
            )?;
            chunks = chunks.saturating_add(header.chunk_count as u64);
        }
        check_table(chunks, file_bytes)?;
        let window = Window::of(&reader.headers()[index])?;
        Ok(Self { reader, index, window })
    }

    pub(super) fn header(&self) -> &Header {
        &self.reader.headers()[self.index]
    }

    /// Calls `put(channel, index of the first pixel in the picture, values)` for every visible piece of a row of every
    /// channel.
    pub(super) fn decode(self, put: impl FnMut(usize, usize, &[f32])) -> Decoded<()> {
        self.decode_rows(&|_| true, &|_| true, put)
    }

    /// [`Self::decode`] of the rows of the picture and the channels that are wanted. Blocks without them are not read.
    pub(super) fn decode_rows(
        self,
        wanted: &(dyn Fn(usize) -> bool + Sync),
        channel: &(dyn Fn(usize) -> bool + Sync),
        mut put: impl FnMut(usize, usize, &[f32]),
    ) -> Decoded<()> {
        let (index, window) = (self.index, self.window);
        let [width, height] = window.data;
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
                found[at.position.1] += usize::from(at.channel == 0) * at.sample_count;
                if !channel(at.channel) || !window.row(at.position.1).is_some_and(wanted) {
                    continue;
                }
                to_floats(&line, channels.list[at.channel].sample_type, &mut values);
                if let Some((start, seen)) = window.place([at.position.0, at.position.1], values.len()) {
                    put(at.channel, start, &values[seen]);
                }
            }
            Ok(())
        };
        let needed = |mut rows: Range<usize>| rows.any(|row| window.row(row).is_none_or(wanted));
        let chosen = self.reader.filter_chunks(false, |_, _, block| {
            let top = block.pixel_position.1;
            full(block.layer, block.level) && needed(top..top + block.pixel_size.1)
        });
        let mut chunks = chosen.map_err(fault)?;
        let meta = chunks.meta_data().clone();
        let header = &meta.headers[index];
        let batch = (BATCH_BYTES / header.max_block_byte_size().max(1)).max(rayon::current_num_threads());
        loop {
            let compressed = chunks.by_ref().take(batch).collect::<Result<Vec<Chunk>, _>>().map_err(fault)?;
            if compressed.is_empty() {
                break;
            }
            let blocks = compressed.into_par_iter().map(|chunk| decompress(chunk, &meta));
            for block in blocks.collect::<Result<Vec<_>, _>>().map_err(fault)? {
                insert(block, &header.channels)?;
            }
        }
        // Two chunks may name the same block, so that another one is missing.
        if (0..height).any(|row| found[row] != width && window.row(row).is_none_or(wanted)) {
            return Err(Fault::damaged("some rows are missing"));
        }
        Ok(())
    }
}

/// Refuses a table of chunk offsets (8 bytes per chunk) that exceeds the file.
pub(super) fn check_table(chunks: u64, file_bytes: u64) -> Decoded<()> {
    if chunks.saturating_mul(8) > file_bytes {
        return Err(Fault::damaged("the file is too short for its own table of contents"));
    }
    Ok(())
}

/// Decompresses a block. The crate's parallel reader uses detached tasks, whose panics would end the process.
fn decompress(chunk: Chunk, meta: &MetaData) -> Result<UncompressedBlock, ExrError> {
    guarded(|| UncompressedBlock::decompress_chunk(chunk, meta, false))
        .unwrap_or_else(|panic| Err(ExrError::Invalid(panic.into())))
}

fn to_floats(line: &LineRef<'_>, kind: SampleType, values: &mut Vec<f32>) {
    values.clear();
    floats(line.value, kind, values);
}

/// Appends samples in native byte order to values.
pub(super) fn floats(bytes: &[u8], kind: SampleType, values: &mut Vec<f32>) {
    let words = bytes.as_chunks::<4>().0;
    match kind {
        SampleType::F32 => values.extend(words.iter().map(|b| f32::from_ne_bytes(*b))),
        SampleType::U32 => values.extend(words.iter().map(|b| u32::from_ne_bytes(*b) as f32)),
        SampleType::F16 => values.extend(bytes.as_chunks::<2>().0.iter().map(|b| f16::from_ne_bytes(*b).to_f32())),
    }
}

pub(super) fn fault(error: ExrError) -> Fault {
    use ExrError as E;
    match error {
        E::Io(error) => error.into(),
        E::NotSupported(words) => Fault::unusable(format!("cannot be decoded: {words}"), EXPORT),
        other => Fault::damaged(other),
    }
}
