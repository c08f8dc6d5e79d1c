//! Directories of tags in TIFF files, the basis of most camera raw formats, as far as recognition and checks need them.

use std::io::{Read, Seek, SeekFrom};

use crate::source::Source;

/// Largest number of directories of a file, and of tags of each, that are read.
const DIRECTORIES: usize = 256;
const TAGS: u16 = 4096;
/// Largest number of tags of all directories.
const ALL_TAGS: usize = 16_384;
/// Largest number of directories that one tag may refer to.
const MOST_REFERENCES: u32 = 65_536;

pub(super) const WIDTH: u16 = 256;
pub(super) const HEIGHT: u16 = 257;
pub(super) const PHOTOMETRIC: u16 = 262;
pub(super) const MAKE: u16 = 271;
pub(super) const STRIP_OFFSETS: u16 = 273;
pub(super) const SAMPLES_PER_PIXEL: u16 = 277;
pub(super) const STRIP_COUNTS: u16 = 279;
pub(super) const TILE_WIDTH: u16 = 322;
pub(super) const TILE_HEIGHT: u16 = 323;
pub(super) const TILE_OFFSETS: u16 = 324;
pub(super) const TILE_COUNTS: u16 = 325;
const SUB_DIRECTORIES: u16 = 330;
/// Fujifilm's directory within its raw data.
const FUJIFILM: u16 = 0xf000;
const EXIF: u16 = 34_665;
const COLOR_PROFILE: u16 = 34_675;
const KODAK: u16 = 33_424;
const GPS: u16 = 34_853;
const MAKER_NOTE: u16 = 37_500;
pub(super) const DNG_VERSION: u16 = 50_706;

/// Photometric interpretation of a mosaic of colour filters (CFA).
pub(super) const MOSAIC: u32 = 32_803;

/// Tag: its number, its type, its number of values, and the offset of the first value in the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    pub(super) tag: u16,
    kind: u16,
    pub(super) count: u32,
    at: u64,
}

/// Tags of a file by directory: the chain of directories and those that they refer to.
pub(super) struct Tags<'a> {
    source: &'a mut Source,
    /// Offset of the TIFF header in the file; all other offsets are relative to it.
    base: u64,
    little: bool,
    pub(super) directories: Vec<Vec<Entry>>,
    /// Directories within maker notes.
    pub(super) makers: Vec<Vec<Entry>>,
    /// Whether the chain of directories is a loop, or exceeds the limit.
    pub(super) endless: bool,
}

impl Entry {
    /// Bytes of a value of this type; unknown types count as bytes.
    fn size(self) -> u64 {
        match self.kind {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 => 8,
            _ => 1,
        }
    }

    /// Bytes of all values.
    pub(super) fn bytes(self) -> u64 {
        u64::from(self.count) * self.size()
    }
}

impl<'a> Tags<'a> {
    /// Reads the tags of the TIFF header at the offset `base`. Of a truncated file, the tags before its end are read.
    pub(super) fn read(source: &'a mut Source, base: u64, makers: bool) -> Self {
        let mut tags = Self { source, base, little: true, directories: vec![], makers: vec![], endless: false };
        tags.little = tags.bytes_at(0) == Some(*b"II");
        let mut chain = vec![];
        let mut next = tags.word(4).unwrap_or(0);
        let mut below = vec![];
        while next != 0 {
            let many = tags.directories.iter().map(Vec::len).sum::<usize>() > ALL_TAGS;
            tags.endless |= many || chain.contains(&next) || chain.len() == DIRECTORIES;
            let Some((entries, following)) = tags.directory(next.into()).filter(|_| !tags.endless) else { break };
            chain.push(next);
            next = following;
            tags.references(&entries, &mut below);
            tags.directories.push(entries);
        }
        below.sort_unstable();
        below.dedup();
        tags.endless |= below.len() > DIRECTORIES;
        for at in below.into_iter().take(DIRECTORIES) {
            tags.endless |= tags.directories.iter().map(Vec::len).sum::<usize>() > ALL_TAGS;
            if tags.endless {
                break;
            }
            let directory = tags.directory(at);
            tags.directories.extend(directory.map(|(entries, _)| entries));
        }
        let notes: Vec<_> =
            tags.directories.iter().flatten().filter(|e| makers && e.tag == MAKER_NOTE).copied().collect();
        for note in notes.into_iter().take(DIRECTORIES) {
            tags.maker_note(note);
        }
        tags
    }

    /// Adds the offsets of directories to which these entries refer: values of four bytes, or the position of values of
    /// other types.
    fn references(&mut self, entries: &[Entry], below: &mut Vec<u64>) {
        const REFERENCES: [u16; 6] = [SUB_DIRECTORIES, EXIF, GPS, COLOR_PROFILE, KODAK, FUJIFILM];
        for entry in entries.iter().filter(|e| REFERENCES.contains(&e.tag)) {
            match entry.kind {
                4 | 13 => below
                    .extend((0..entry.count.min(MOST_REFERENCES)).map_while(|i| self.number(*entry, i)).map(u64::from)),
                7 => below.push(entry.at),
                _ => {}
            }
            // The decoder takes the first byte of values of unknown types.
            if !(1..=12).contains(&entry.kind) {
                below.extend(self.bytes_at::<1>(entry.at).map(|[at]| u64::from(at)));
            }
        }
    }

    /// Entries at an offset, and the offset of the next directory of the chain.
    fn directory(&mut self, at: u64) -> Option<(Vec<Entry>, u32)> {
        let count = self.half(at)?.min(TAGS);
        let entries = (0..count).map_while(|i| self.entry(at + 2 + 12 * u64::from(i))).collect();
        Some((entries, self.word(at + 2 + 12 * u64::from(count)).unwrap_or(0)))
    }

    fn entry(&mut self, at: u64) -> Option<Entry> {
        let mut entry = Entry { tag: self.half(at)?, kind: self.half(at + 2)?, count: self.word(at + 4)?, at: at + 8 };
        if entry.bytes() > 4 {
            entry.at = self.word(at + 8)?.into();
        }
        Some(entry)
    }

    /// Reads the directory within a maker note, and those below it.
    fn maker_note(&mut self, note: Entry) {
        let little = self.little;
        let name: [u8; 12] = self.bytes_at(note.at).unwrap_or_default();
        if name.starts_with(b"IIII") || name.starts_with(b"MMMM") {
            // Phase One has no such directory.
            return;
        }
        // The start of the directory depends on the maker; some state the byte order before it.
        let mut skip = match &name {
            _ if name.starts_with(b"Nikon\0\x02") => 18,
            _ if name.starts_with(b"PENTAX") => 10,
            _ if name.starts_with(b"OLYMPUS") || name.starts_with(b"FUJIFILM") || name.starts_with(b"SONY DSC ") => 12,
            _ if name.starts_with(b"OLYMP") || name.starts_with(b"EPSON") => 8,
            _ if name.starts_with(b"AOC\0") => 4,
            _ => 0,
        };
        let order_at = if skip == 18 { 10 } else { skip - if skip == 10 { 2 } else { 0 } };
        match self.bytes_at(note.at + order_at) {
            Some([b'I', b'I']) => self.little = true,
            Some([b'M', b'M']) => self.little = false,
            _ => {}
        }
        if order_at == skip && matches!(self.bytes_at(note.at + skip), Some([b'I', b'I'] | [b'M', b'M'])) {
            skip += 2;
        }
        if let Some((entries, _)) = self.directory(note.at + skip) {
            for entry in entries.iter().filter(|e| name.starts_with(b"OLYMPUS") && (0x2010..=0x5000).contains(&e.tag)) {
                // Depending on its type, the entry is the directory or holds its offset.
                let below = if entry.kind == 7 { Some(entry.at) } else { self.number(*entry, 0).map(u64::from) };
                let below = below.and_then(|at| self.directory(note.at.checked_add(at)?));
                self.makers.extend(below.map(|(entries, _)| entries));
            }
            self.makers.push(entries);
        }
        self.little = little;
    }

    /// Entry of a tag in a directory.
    pub(super) fn find(&self, directory: usize, tag: u16) -> Option<Entry> {
        self.directories.get(directory)?.iter().find(|e| e.tag == tag).copied()
    }

    /// First value of a tag in a directory.
    pub(super) fn first(&mut self, directory: usize, tag: u16) -> Option<u32> {
        let entry = self.find(directory, tag)?;
        self.number(entry, 0)
    }

    /// Value of a tag of unsigned integers, by index.
    pub(super) fn number(&mut self, entry: Entry, index: u32) -> Option<u32> {
        let at = entry.at + u64::from(index) * entry.size();
        match entry.kind {
            _ if index >= entry.count => None,
            1 | 7 => self.bytes_at::<1>(at).map(|[b]| b.into()),
            3 => self.half(at).map(u32::from),
            4 | 13 => self.word(at),
            _ => None,
        }
    }

    /// Text of a tag, at most 64 bytes.
    pub(super) fn text(&mut self, directory: usize, tag: u16) -> Option<String> {
        let entry = self.find(directory, tag).filter(|e| e.kind == 2)?;
        self.source.seek(SeekFrom::Start(self.base.checked_add(entry.at)?)).ok()?;
        let mut text = vec![];
        self.source.by_ref().take(u64::from(entry.count.min(64))).read_to_end(&mut text).ok()?;
        let text = String::from_utf8_lossy(&text);
        Some(text.split('\0').next().unwrap_or_default().trim().to_owned())
    }

    fn half(&mut self, at: u64) -> Option<u16> {
        let bytes = self.bytes_at(at)?;
        Some(if self.little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    fn word(&mut self, at: u64) -> Option<u32> {
        let bytes = self.bytes_at(at)?;
        Some(if self.little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// Bytes at an offset; `None` beyond the end of the file.
    pub(super) fn bytes_at<const N: usize>(&mut self, at: u64) -> Option<[u8; N]> {
        let mut bytes = [0; N];
        // A relative seek keeps the buffer if the position is within it.
        let there = i64::try_from(self.base.checked_add(at)?).ok()?;
        let here = i64::try_from(self.source.stream_position().ok()?).ok()?;
        self.source.seek_relative(there.checked_sub(here)?).ok()?;
        self.source.read_exact(&mut bytes).ok()?;
        Some(bytes)
    }
}
