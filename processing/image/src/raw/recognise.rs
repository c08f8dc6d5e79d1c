//! Recognition of camera raw files by their content. Many of them are TIFF files; a TIFF of a finished picture, written
//! by a camera or its program, does not count.

use std::io::{Seek, SeekFrom};

use crate::fault::Decoded;
use crate::source::Source;

use super::tags::{DNG_VERSION, MAKE, MOSAIC, PHOTOMETRIC, Tags};

/// Format of camera raw files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Kind {
    /// Name, such as "Canon CR2".
    pub(super) name: &'static str,
    /// Layout of its directories of tags.
    pub(super) layout: Layout,
}

/// Name of the format of Panasonic and some Leica cameras.
pub(super) const PANASONIC: &str = "Panasonic RW2";

/// Formats of medium-format backs, whose decoder trusts their tables.
const PHASE_ONE: &str = "Phase One IIQ";
const LEAF: &str = "Leaf MOS";

/// Layout of the directories of tags of a raw file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    /// TIFF of the DNG standard.
    Dng,
    /// TIFF header, possibly with another number than 42.
    Tiff,
    /// Boxes as in MP4.
    Boxes,
    /// Fujifilm's header, with the offsets of a JPEG and a TIFF.
    Fujifilm,
    /// Any other layout, which is not read.
    Other,
}

/// Raw format of a file by its first bytes.
pub(crate) fn by_magic(head: &[u8]) -> Option<Kind> {
    let kind = |name, layout| Some(Kind { name, layout });
    match head {
        [b'I', b'I', 42, 0, 16, 0, 0, 0, b'C', b'R', 2, ..] => kind("Canon CR2", Layout::Tiff),
        [b'I', b'I', b'R', b'O' | b'S', ..] => kind("Olympus ORF", Layout::Tiff),
        [b'M', b'M', b'O', b'R', ..] => kind("Olympus ORF", Layout::Tiff),
        [b'I', b'I', 0x55, 0, ..] => kind(PANASONIC, Layout::Tiff),
        [b'I', b'I', 26, 0, 0, 0, b'H', b'E', b'A', b'P', ..] => kind("Canon CRW", Layout::Other),
        [_, _, _, _, b'f', b't', b'y', b'p', b'c', b'r', b'x', b' ', ..] => kind("Canon CR3", Layout::Boxes),
        [0, b'M', b'R', b'M', ..] => kind("Minolta MRW", Layout::Other),
        [b'F', b'O', b'V', b'b', ..] => kind("Sigma X3F", Layout::Other),
        [b'A', b'R', b'R', b'I', ..] => kind("ARRIRAW", Layout::Other),
        _ if head.starts_with(b"FUJIFILMCCD-RAW") => kind("Fujifilm RAF", Layout::Fujifilm),
        _ => None,
    }
}

/// Raw format of a TIFF file by its tags: a DNG version, or a mosaic of colour filters.
pub(crate) fn by_tags(source: &mut Source) -> Decoded<Option<Kind>> {
    let mut tags = Tags::read(source, 0, false);
    let all = 0..tags.directories.len();
    let make = tags.text(0, MAKE).unwrap_or_default();
    let kind = if all.clone().any(|d| tags.find(d, DNG_VERSION).is_some()) {
        Some(Kind { name: "DNG", layout: Layout::Dng })
    } else if all.into_iter().any(|d| tags.first(d, PHOTOMETRIC) == Some(MOSAIC)) || back(&mut tags, &make) {
        let name = by_make(&make);
        let layout = if [LEAF, PHASE_ONE].contains(&name) { Layout::Other } else { Layout::Tiff };
        Some(Kind { name, layout })
    } else {
        None
    };
    source.seek(SeekFrom::Start(0))?;
    Ok(kind)
}

/// Whether a TIFF comes from a camera back and has its mosaic outside of its directories.
fn back(tags: &mut Tags<'_>, make: &str) -> bool {
    matches!(tags.bytes_at(8), Some([b'I', b'I', b'I', b'I'] | [b'M', b'M', b'M', b'M']))
        && [LEAF, PHASE_ONE].contains(&by_make(make))
}

/// Name of a maker's format with mosaics in TIFF files.
fn by_make(make: &str) -> &'static str {
    let make = make.to_lowercase();
    const NAMES: &[(&str, &str)] = &[
        ("nikon", "Nikon NEF"),
        ("sony", "Sony ARW"),
        ("pentax", "Pentax PEF"),
        ("ricoh", "Pentax PEF"),
        ("samsung", "Samsung SRW"),
        ("hasselblad", "Hasselblad 3FR"),
        ("kodak", "Kodak DCR"),
        ("epson", "Epson ERF"),
        ("mamiya", "Mamiya MEF"),
        ("leaf", LEAF),
        ("phase one", PHASE_ONE),
        ("canon", "Canon TIF"),
    ];
    NAMES.iter().find(|(maker, _)| make.contains(maker)).map_or("TIFF mosaic", |(_, name)| name)
}
