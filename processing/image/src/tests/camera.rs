//! Camera raw files: recognised by content in every build, decoded with the feature `raw`.

use super::*;

/// Value of a tag in a little-endian file.
enum Tag {
    Bytes(Vec<u8>),
    Text(&'static str),
    Shorts(Vec<u16>),
    Longs(Vec<u32>),
    Ratios(Vec<[u32; 2]>),
}

impl Tag {
    /// Type, count and bytes.
    fn parts(&self) -> (u16, usize, Vec<u8>) {
        match self {
            Self::Bytes(v) => (1, v.len(), v.clone()),
            Self::Text(v) => (2, v.len() + 1, [v.as_bytes(), &[0]].concat()),
            Self::Shorts(v) => (3, v.len(), v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Self::Longs(v) => (4, v.len(), v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Self::Ratios(v) => (5, v.len(), v.iter().flatten().flat_map(|x| x.to_le_bytes()).collect()),
        }
    }
}

/// TIFF of one directory with Exif tags, and one strip of data.
fn tiff(tags: Vec<(u16, Tag)>, exif: Vec<(u16, Tag)>, data: &[u8]) -> Vec<u8> {
    let mut file = b"II*\0\0\0\0\0".to_vec();
    let strip = file.len() as u32;
    file.extend(data);
    let mut directory = |mut tags: Vec<(u16, Tag)>| {
        tags.sort_by_key(|(tag, _)| *tag);
        let mut entries = (tags.len() as u16).to_le_bytes().to_vec();
        for (tag, value) in tags {
            let (kind, count, mut bytes) = value.parts();
            entries.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
            entries.extend((count as u32).to_le_bytes());
            if bytes.len() > 4 {
                file.resize(file.len().next_multiple_of(2), 0);
                entries.extend((file.len() as u32).to_le_bytes());
                file.extend(bytes);
            } else {
                bytes.resize(4, 0);
                entries.extend(bytes);
            }
        }
        file.resize(file.len().next_multiple_of(2), 0);
        let at = file.len() as u32;
        file.extend(entries);
        file.extend([0; 4]);
        at
    };
    let exif = directory(exif);
    let mut tags = tags;
    tags.extend([
        (273, Tag::Longs(vec![strip])),
        (279, Tag::Longs(vec![data.len() as u32])),
        (34_665, Tag::Longs(vec![exif])),
    ]);
    let first = directory(tags);
    file[4..8].copy_from_slice(&first.to_le_bytes());
    file
}

/// Tags of a mosaic of 16 bits.
fn mosaic(width: usize, height: usize, pattern: [u8; 4]) -> Vec<(u16, Tag)> {
    vec![
        (254, Tag::Longs(vec![0])),
        (256, Tag::Longs(vec![width as u32])),
        (257, Tag::Longs(vec![height as u32])),
        (258, Tag::Shorts(vec![16])),
        (259, Tag::Shorts(vec![1])),
        (262, Tag::Shorts(vec![32_803])),
        (271, Tag::Text("Nacre")),
        (272, Tag::Text("Test")),
        (277, Tag::Shorts(vec![1])),
        (278, Tag::Longs(vec![height as u32])),
        (33_421, Tag::Shorts(vec![2, 2])),
        (33_422, Tag::Bytes(pattern.to_vec())),
    ]
}

/// DNG of a mosaic with further tags.
fn dng(width: usize, height: usize, pattern: [u8; 4], more: Vec<(u16, Tag)>, values: &[u16]) -> Vec<u8> {
    let mut tags = mosaic(width, height, pattern);
    tags.push((50_706, Tag::Bytes(vec![1, 4, 0, 0])));
    tags.extend(more);
    let exif = vec![
        (33_434, Tag::Ratios(vec![[1, 125]])),
        (33_437, Tag::Ratios(vec![[56, 10]])),
        (34_855, Tag::Shorts(vec![200])),
    ];
    tiff(tags, exif, &values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>())
}

/// Small DNG with distinct values.
pub(super) fn small() -> Vec<u8> {
    let values: Vec<u16> = (0..12 * 8).map(|i| 600 + i * 37).collect();
    dng(12, 8, [0, 1, 1, 2], vec![(50_714, Tag::Shorts(vec![512])), (50_717, Tag::Shorts(vec![4095]))], &values)
}

/// A TIFF of a finished picture with a camera's tags is read as a TIFF.
#[test]
fn a_tiff_that_a_camera_wrote_stays_a_tiff() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("finished");
    let tags = vec![
        (256, Tag::Longs(vec![2])),
        (257, Tag::Longs(vec![1])),
        (258, Tag::Shorts(vec![16])),
        (259, Tag::Shorts(vec![1])),
        (262, Tag::Shorts(vec![1])),
        (271, Tag::Text("NIKON CORPORATION")),
        (277, Tag::Shorts(vec![1])),
    ];
    fs::write(&path, tiff(tags, vec![], &[1, 2, 3, 4])).unwrap();
    assert_eq!(read(&path).unwrap().samples, Samples::U16(vec![0x201, 0x403]));
    // Pixels that equal the marks of raw formats at the same position.
    for pixels in [b"IIII", b"CR\x02\0"] {
        let tags = [(256, 2_u32), (257, 2), (258, 8), (259, 1), (262, 1), (277, 1)];
        let tags = tags.map(|(tag, value)| (tag, Tag::Longs(vec![value]))).into_iter().collect();
        fs::write(&path, tiff(tags, vec![], pixels)).unwrap();
        assert_eq!(read(&path).unwrap().samples, Samples::U8(pixels.to_vec()));
    }
}

#[cfg(not(feature = "raw"))]
#[test]
fn without_the_feature_raw_files_are_refused_by_name_with_a_command() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.tif");
    let mosaic_of = |make: &'static str| {
        let mut tags = mosaic(2, 2, [0, 1, 1, 2]);
        tags.retain(|(tag, _)| *tag != 271);
        tags.push((271, Tag::Text(make)));
        tiff(tags, vec![], &[0; 8])
    };
    for (file, name) in [
        (small(), "DNG"),
        (mosaic_of("NIKON CORPORATION"), "Nikon NEF"),
        (mosaic_of("SONY"), "Sony ARW"),
        (mosaic_of("PENTAX"), "Pentax PEF"),
        (mosaic_of("Basler"), "TIFF mosaic"),
        (b"II*\0\x10\0\0\0CR\x02\0".to_vec(), "Canon CR2"),
        (b"\0\0\0\x18ftypcrx \0\0\0\x01".to_vec(), "Canon CR3"),
        (b"FUJIFILMCCD-RAW 0201".to_vec(), "Fujifilm RAF"),
        (b"IIRO\x08\0\0\0".to_vec(), "Olympus ORF"),
        (b"IIU\0\x08\0\0\0".to_vec(), "Panasonic RW2"),
    ] {
        fs::write(&path, file).unwrap();
        for said in [info(&path).unwrap_err().to_string(), read(&path).unwrap_err().to_string()] {
            assert!(
                said.contains(&format!("is a {name} file (camera raw), which this build of nacre does not read")),
                "{said}"
            );
            assert!(said.contains("dcraw -4 -h") && said.contains("--features raw"), "{said}");
        }
    }
}

#[cfg(feature = "raw")]
mod decoded {
    use tempfile::TempDir;

    use super::*;

    fn file(bytes: &[u8]) -> (TempDir, PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("photograph.bin");
        fs::write(&path, bytes).unwrap();
        (dir, path)
    }

    fn picture(bytes: &[u8]) -> (usize, usize, Vec<u16>) {
        let (_dir, path) = file(bytes);
        let raster = read(&path).unwrap();
        assert_eq!(info(&path).unwrap(), raster.info());
        assert_eq!(raster.channels, 3);
        let Samples::U16(values) = raster.samples else { panic!("{:?}", raster.samples) };
        (raster.width, raster.height, values)
    }

    fn says(bytes: &[u8], words: &str) {
        let (_dir, path) = file(bytes);
        for said in [info(&path).unwrap_err().to_string(), read(&path).unwrap_err().to_string()] {
            assert!(said.contains(words) && said.contains(';'), "no '{words}' in: {said}");
        }
    }

    #[test]
    fn each_cell_of_a_dng_is_a_pixel_in_every_order_of_filters() {
        let values: Vec<u16> = (0..6 * 4).map(|i| 100 + i * i).collect();
        for (pattern, places) in [
            ([0, 1, 1, 2], [0, 1, 6, 7]),
            ([1, 0, 2, 1], [1, 0, 7, 6]),
            ([1, 2, 0, 1], [6, 0, 7, 1]),
            ([2, 1, 1, 0], [7, 1, 6, 0]),
        ] {
            let (width, height, picture) = picture(&dng(6, 4, pattern, vec![], &values));
            assert_eq!((width, height), (3, 2));
            for (index, pixel) in picture.chunks(3).enumerate() {
                let corner = index / 3 * 12 + index % 3 * 2;
                let [red, first, second, blue] = places.map(|place| f64::from(values[corner + place]));
                assert_eq!([pixel[0], pixel[2]].map(f64::from), [red, blue], "{pattern:?}");
                assert!((f64::from(pixel[1]) - (first + second) / 2.0).abs() <= 0.5, "{pattern:?}");
            }
        }
    }

    /// Active area at odd coordinates, to which pattern, black levels and crop are relative.
    #[test]
    fn borders_are_cut_and_black_levels_made_equal() {
        let values: Vec<u16> = (0..9 * 8).map(|i| 1000 + i).collect();
        let more = vec![
            (50_713, Tag::Shorts(vec![2, 2])),
            (50_714, Tag::Ratios(vec![[60, 1], [64, 1], [128, 2], [50, 1]])),
            (50_717, Tag::Longs(vec![3000])),
            (50_719, Tag::Longs(vec![1, 0])),
            (50_720, Tag::Longs(vec![5, 4])),
            (50_829, Tag::Longs(vec![1, 2, 8, 9])),
        ];
        let bytes = dng(9, 8, [0, 1, 1, 2], more, &values);
        // The crop begins at row 1, column 3 of the sensor: green, red / blue, green.
        let (width, height, picture) = picture(&bytes);
        assert_eq!((width, height), (2, 2));
        let at = |y: usize, x: usize| values[y * 9 + x];
        let green = (f64::from(at(1, 3)) + f64::from(at(2, 4))) / 2.0;
        assert_eq!([picture[0], picture[2]], [at(1, 4) + 4, at(2, 3) + 14]);
        assert!((f64::from(picture[1]) - green).abs() <= 0.5);
        let (_dir, path) = file(&bytes);
        assert_eq!(levels(&path).unwrap(), Some([64.0, 3000.0]));
        let taken = exposure(&path).unwrap();
        assert_eq!((taken.seconds, taken.iso), (Some(1.0 / 125.0), Some(200.0)));
    }

    #[test]
    fn linear_and_grey_dng_keep_their_size() {
        let (_dir, path) = file(&{
            let values: Vec<u16> = (0..2 * 2 * 3).map(|i| i * 1000).collect();
            let more =
                vec![(262, Tag::Shorts(vec![34_892])), (277, Tag::Shorts(vec![3])), (258, Tag::Shorts(vec![16; 3]))];
            let mut tags = mosaic(2, 2, [0, 1, 1, 2]);
            tags.retain(|(tag, _)| ![262, 277, 258, 33_421, 33_422].contains(tag));
            tags.push((50_706, Tag::Bytes(vec![1, 4, 0, 0])));
            tags.extend(more);
            tiff(tags, vec![], &values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>())
        });
        let raster = read(&path).unwrap();
        assert_eq!(info(&path).unwrap(), raster.info());
        assert_eq!((raster.width, raster.height, raster.channels), (2, 2, 3));
        assert_eq!(raster.samples, Samples::U16((0..12).map(|i| i * 1000).collect()));
    }

    #[test]
    fn other_mosaics_and_unknown_cameras_are_refused_by_name() {
        let mut quad = mosaic(8, 8, [0, 1, 1, 2]);
        quad.retain(|(tag, _)| ![33_421, 33_422].contains(tag));
        quad.push((33_421, Tag::Shorts(vec![4, 4])));
        quad.push((33_422, Tag::Bytes([0, 0, 1, 1, 0, 0, 1, 1, 1, 1, 2, 2, 1, 1, 2, 2].to_vec())));
        quad.push((50_706, Tag::Bytes(vec![1, 4, 0, 0])));
        says(&tiff(quad, vec![], &[0; 128]), "a mosaic of 16 filters per cell");
        let values = [0; 16];
        says(&dng(4, 4, [3, 4, 5, 1], vec![], &values), "mosaic of");
        says(
            &tiff(mosaic(4, 4, [0, 1, 1, 2]), vec![], &[0; 32]),
            "is a TIFF mosaic file of a camera that is not known (Nacre Test)",
        );
        says(b"FOVb\0\0\x02\0", "is a Sigma X3F file (camera raw), which is not read");
    }

    /// Nested boxes, one without a length, and one with a count beyond any memory.
    #[test]
    fn boxes_are_checked_before_anything_is_decoded() {
        let boxed =
            |name: &str, body: &[u8]| [&(body.len() as u32 + 8).to_be_bytes()[..], name.as_bytes(), body].concat();
        let head = boxed("ftyp", b"crx \0\0\0\x01");
        let nested = |inner: &[u8]| [&head[..], &boxed("moov", &boxed("trak", inner))].concat();
        says(&nested(b"\0\0\0\0CCTP\0\0\0\0"), "its box CCTP of 0 bytes is not within the one around it");
        says(&nested(b"\0\0\x01\0free\0\0\0\0"), "its box free of 256 bytes is not within the one around it");
        let count = [&[0; 8][..], &[0xff; 4]].concat();
        says(&nested(&boxed("stsz", &count)), "a box claims 4294967295 values");
        let sides = [&[0; 8][..], &60_000_u32.to_be_bytes(), &60_000_u32.to_be_bytes(), &[0; 8]].concat();
        says(&nested(&boxed("CMP1", &sides)), "more than the 256 Mpixel of a camera raw file");
    }

    #[test]
    fn sizes_are_checked_before_anything_is_decoded() {
        let whole = small();
        let patched = |tag: u16, value: u32| {
            let mut file = whole.clone();
            let entry = [&tag.to_le_bytes()[..], &4_u16.to_le_bytes(), &1_u32.to_le_bytes()].concat();
            let at = file.windows(8).rposition(|w| w == entry).unwrap();
            file[at + 8..at + 12].copy_from_slice(&value.to_le_bytes());
            file
        };
        says(&patched(256, 4_000_000_000), "more than the 256 Mpixel of a camera raw file");
        // An Exif tag that claims 32 GiB, and an endless chain of directories.
        let mut huge = whole.clone();
        let ratio = [&33_434_u16.to_le_bytes()[..], &5_u16.to_le_bytes(), &1_u32.to_le_bytes()].concat();
        let at = huge.windows(8).position(|w| w == ratio).unwrap();
        huge[at + 4..at + 8].fill(0xff);
        says(&huge, "is truncated or damaged: tag 33434 claims 34359738360 bytes");
        let mut endless = whole.clone();
        let end = endless.len() - 4;
        endless.copy_within(4..8, end);
        says(&endless, "its directories of tags are a loop");
        says(&patched(279, 4_000_000_000), "is truncated or damaged: the pixels end at byte 4000000008");
    }
}
