//! Statements of files about their values.

use super::*;
use crate::{Curve, Details, details};

/// PNG of one grey pixel with chunks before its pixels.
fn stating(dir: &Path, chunks: &[(&[u8; 4], &[u8])]) -> Details {
    let header = png_header(1, 1, 8, 0);
    let pixels = [0x78, 1, 1, 2, 0, 0xfd, 0xff, 0, 7, 0, 9, 0, 8];
    let mut all: Vec<(&[u8; 4], &[u8])> = vec![(b"IHDR", &header)];
    all.extend(chunks);
    all.extend([(b"IDAT", &pixels[..]), (b"IEND", &[][..])]);
    let path = dir.join("x.png");
    fs::write(&path, raw_png(&all)).unwrap();
    details(&path).unwrap()
}

#[test]
fn png_chunks_say_how_values_encode_light() {
    let dir = tempfile::tempdir().unwrap();
    let curve = |chunks: &[(&[u8; 4], &[u8])]| stating(dir.path(), chunks).encoding.map(|e| e.curve);
    let gamma = |exponent: u32| curve(&[(b"gAMA", &exponent.to_be_bytes())]);
    assert_eq!(curve(&[]), None);
    assert_eq!(gamma(100_000), Some(Curve::Linear));
    assert_eq!(gamma(55_556), Some(Curve::Gamma(1.0 / 0.55556)));
    assert_eq!(gamma(0), Some(Curve::Other));
    assert_eq!(curve(&[(b"sRGB", &[0])]), Some(Curve::Srgb));
    // The stronger statement applies, in either order.
    let (weak, strong) = (100_000_u32.to_be_bytes(), [0]);
    assert_eq!(curve(&[(b"gAMA", &weak), (b"sRGB", &strong)]), Some(Curve::Srgb));
    assert_eq!(curve(&[(b"cICP", &[1, 8, 0, 1]), (b"sRGB", &strong)]), Some(Curve::Linear));
    assert_eq!(curve(&[(b"cICP", &[9, 16, 0, 1])]), Some(Curve::Other), "PQ");
    let animated = stating(dir.path(), &[(b"acTL", &[0, 0, 0, 9, 0, 0, 0, 0])]);
    assert!(animated.notes[0].contains("9 frames"), "{:?}", animated.notes);
}

/// Orientation 8 as a block of Exif tags.
const TAGS: &[u8] = b"II\x2a\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x08\0\0\0\0\0\0\0";

/// ICC profile with a given curve; real profiles have many more tags.
fn profile(curve: &[u8]) -> Vec<u8> {
    let mut p = vec![0; 128];
    let size = (128 + 4 + 12 + curve.len()) as u32;
    p[..4].copy_from_slice(&size.to_be_bytes());
    p[8..12].copy_from_slice(&[2, 0x40, 0, 0]);
    p[12..24].copy_from_slice(b"mntrGRAYXYZ ");
    p[36..40].copy_from_slice(b"acsp");
    p.extend(1_u32.to_be_bytes());
    p.extend(b"kTRC");
    p.extend(144_u32.to_be_bytes());
    p.extend((curve.len() as u32).to_be_bytes());
    p.extend(curve);
    p
}

#[test]
fn icc_profiles_say_how_values_encode_light() {
    let curve_of = |curve: &[u8]| Curve::of_profile(&profile(curve));
    let table = |values: &[u16]| {
        let mut tag = b"curv\0\0\0\0".to_vec();
        tag.extend((values.len() as u32).to_be_bytes());
        values.iter().for_each(|v| tag.extend(v.to_be_bytes()));
        tag
    };
    let sampled = |light: &dyn Fn(f64) -> f64| {
        table(&(0..1024).map(|i| (light(f64::from(i) / 1023.0) * 65_535.0).round() as u16).collect::<Vec<_>>())
    };
    assert_eq!(curve_of(&table(&[])), Some(Curve::Linear));
    let near = |curve: Option<Curve>, wanted: f64| matches!(curve, Some(Curve::Gamma(g)) if (g - wanted).abs() < 0.01);
    assert!(near(curve_of(&table(&[563])), 563.0 / 256.0));
    assert_eq!(curve_of(&sampled(&|v| Curve::Srgb.light(v).unwrap())), Some(Curve::Srgb));
    assert!(near(curve_of(&sampled(&|v| v.powf(1.8))), 1.8));
    assert_eq!(curve_of(&sampled(&|v| if v < 0.5 { 0.0 } else { 2.0 * v - 1.0 })), Some(Curve::Other));
    assert_eq!(Curve::of_profile(b"no profile"), None);
}

/// PNG with every chunk that is read, and a TIFF of two pages in 12 bits.
pub(super) fn samples(dir: &Path) -> [PathBuf; 2] {
    let mut profile_chunk = b"name\0\0".to_vec();
    let mut packer = flate2::write::ZlibEncoder::new(&mut profile_chunk, flate2::Compression::fast());
    std::io::Write::write_all(&mut packer, &profile(b"curv\0\0\0\0\0\0\0\x01\x02\x33")).unwrap();
    packer.finish().unwrap();
    let gamma = 45_455_u32.to_be_bytes();
    let chunks: [(&[u8; 4], &[u8]); 6] = [
        (b"cICP", &[1, 13, 0, 1]),
        (b"iCCP", &profile_chunk),
        (b"sRGB", &[0]),
        (b"gAMA", &gamma),
        (b"eXIf", TAGS),
        (b"acTL", &[0, 0, 0, 2, 0, 0, 0, 0]),
    ];
    stating(dir, &chunks);
    let png = dir.join("stating.png");
    fs::rename(dir.join("x.png"), &png).unwrap();
    let strip = [0x12, 0x3f, 0xff, 0, 0x04, 0x56];
    [png, pages(dir, &[(2, 2, 12, &[(274, 3)], &strip), (2, 2, 12, &[], &strip)])]
}

/// Page: width, height, bits per sample, tags besides those of a grey picture, and its strip.
type Page<'a> = (u32, u32, u16, &'a [(u16, u32)], &'a [u8]);

/// Little-endian TIFF without compression.
fn pages(dir: &Path, all: &[Page<'_>]) -> PathBuf {
    let mut file = b"II\x2a\0\0\0\0\0".to_vec();
    let mut link = 4;
    for (width, height, bits, extra, strip) in all {
        let data = file.len() as u32;
        file.extend(*strip);
        file.resize(file.len().next_multiple_of(2), 0);
        let mut tags = vec![
            (256, *width),
            (257, *height),
            (258, u32::from(*bits)),
            (259, 1),
            (262, 1),
            (273, data),
            (277, 1),
            (278, *height),
            (279, strip.len() as u32),
        ];
        tags.extend(*extra);
        tags.sort_unstable();
        let at = file.len() as u32;
        file[link..link + 4].copy_from_slice(&at.to_le_bytes());
        file.extend((tags.len() as u16).to_le_bytes());
        for (tag, value) in tags {
            file.extend(tag.to_le_bytes());
            // One value of type LONG.
            file.extend([4, 0, 1, 0, 0, 0]);
            file.extend(value.to_le_bytes());
        }
        link = file.len();
        file.extend([0; 4]);
    }
    let path = dir.join("pages.tif");
    fs::write(&path, file).unwrap();
    path
}

#[test]
fn tiff_reads_the_page_in_full_resolution_and_counts_the_rest() {
    let dir = tempfile::tempdir().unwrap();
    let reduced = [(254, 1)];
    let path = pages(dir.path(), &[(1, 1, 8, &reduced, &[9]), (2, 1, 8, &[], &[3, 4])]);
    assert_eq!(read(&path).unwrap().samples, Samples::U8(vec![3, 4]));
    assert!(details(&path).unwrap().notes.is_empty());
    // The older tag, and a mask.
    let path = pages(dir.path(), &[(1, 1, 8, &[(255, 2)], &[9]), (1, 1, 8, &[(254, 4)], &[8]), (1, 1, 8, &[], &[5])]);
    assert_eq!(read(&path).unwrap().samples, Samples::U8(vec![5]));
    let path = pages(dir.path(), &[(1, 1, 8, &[], &[1]), (1, 1, 8, &[], &[2]), (1, 1, 8, &[], &[3])]);
    assert_eq!(read(&path).unwrap().samples, Samples::U8(vec![1]));
    assert!(details(&path).unwrap().notes[0].contains("3 pages"));
}

#[test]
fn tiff_of_odd_depths() {
    let dir = tempfile::tempdir().unwrap();
    let check = |bits: u16, values: &[u16], white: f64, strip: &[u8]| {
        let path = pages(dir.path(), &[(2, (values.len() / 2) as u32, bits, &[], strip)]);
        match read(&path).unwrap().samples {
            Samples::U16(read) => assert_eq!(read, values),
            Samples::U8(read) => assert!(read.iter().copied().map(u16::from).eq(values.iter().copied())),
            Samples::F32(_) => panic!("floats"),
        }
        assert_eq!(details(&path).unwrap().white, Some(white));
    };
    check(12, &[0x123, 0xfff, 0, 0x456], 4095.0, &[0x12, 0x3f, 0xff, 0, 0x04, 0x56]);
    check(10, &[0x3ff, 1], 1023.0, &[0xff, 0xc0, 0x10]);
    check(14, &[0x3fff, 2], 16_383.0, &[0xff, 0xfc, 0, 0x20]);
    check(4, &[15, 2], 15.0, &[0xf2]);
    check(1, &[1, 0], 1.0, &[0b1000_0000]);
    // Black and white exchanged.
    let path = pages(dir.path(), &[(2, 1, 12, &[], &[0x12, 0x3f, 0xff])]);
    let bytes = fs::read(&path).unwrap();
    let at = bytes.windows(4).position(|w| w == [6, 1, 4, 0]).unwrap();
    let inverted = [&bytes[..at + 8], &[0], &bytes[at + 9..]].concat();
    fs::write(&path, inverted).unwrap();
    assert_eq!(read(&path).unwrap().samples, Samples::U16(vec![0xedc, 0]));
    let path = pages(dir.path(), &[(4, 1, 12, &[], &[0x12])]);
    assert!(read(&path).unwrap_err().to_string().contains("1 bytes of 6"));
}

#[test]
fn tiff_compression_that_is_not_read_is_named_by_its_header() {
    let dir = tempfile::tempdir().unwrap();
    for (method, name) in
        [(50_000, "Zstandard"), (50_001, "WebP"), (34_712, "JPEG 2000"), (34_887, "LERC"), (7777, "7777")]
    {
        let path = pages(dir.path(), &[(1, 1, 8, &[], &[1])]);
        let mut bytes = fs::read(&path).unwrap();
        let at = bytes.windows(4).position(|w| w == [3, 1, 4, 0]).unwrap();
        bytes[at + 8..at + 12].copy_from_slice(&u32::to_le_bytes(method));
        fs::write(&path, bytes).unwrap();
        let error = info(&path).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("Deflate"), "{error}");
    }
}

#[test]
fn jpeg_without_tables_or_end_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = jpeg_file(dir.path(), true);
    let (whole, wanted) = (fs::read(&path).unwrap(), read(&path).unwrap());
    // Without the end marker, the last two bytes.
    fs::write(&path, &whole[..whole.len() - 2]).unwrap();
    assert_eq!(read(&path).unwrap(), wanted);
    assert!(details(&path).unwrap().notes[0].contains("end marker"));
    // Without tables; the encoder writes those of the standard.
    let mut bare = whole[..2].to_vec();
    let mut at = 2;
    while whole[at + 1] != 0xda {
        let end = at + 2 + usize::from(u16::from_be_bytes([whole[at + 2], whole[at + 3]]));
        if whole[at + 1] != 0xc4 {
            bare.extend(&whole[at..end]);
        }
        at = end;
    }
    bare.extend(&whole[at..]);
    assert!(bare.len() < whole.len() - 100);
    fs::write(&path, &bare).unwrap();
    assert_eq!(read(&path).unwrap(), wanted);
    assert!(details(&path).unwrap().notes[0].contains("Huffman"));
    // Truncated data, with most or little of it present.
    for cut in [whole.len() - 4, whole.len() - 30, at + 40] {
        fs::write(&path, &whole[..cut]).unwrap();
        let error = read(&path).map(drop).unwrap_err().to_string();
        assert!(error.contains("no end of image marker"), "{error}");
    }
}

#[test]
fn orientations_are_read_where_formats_keep_them() {
    let dir = tempfile::tempdir().unwrap();
    let path = pages(dir.path(), &[(1, 1, 8, &[(274, 6)], &[1])]);
    assert_eq!(details(&path).unwrap().orientation, 6);
    assert_eq!(stating(dir.path(), &[(b"eXIf", TAGS)]).orientation, 8);
    assert_eq!(stating(dir.path(), &[(b"eXIf", b"nothing")]).orientation, 1);
    let path = jpeg_file(dir.path(), true);
    let whole = fs::read(&path).unwrap();
    let segment = [&b"\xff\xe1"[..], &(TAGS.len() as u16 + 8).to_be_bytes(), b"Exif\0\0", TAGS].concat();
    fs::write(&path, [&whole[..2], &segment, &whole[2..]].concat()).unwrap();
    assert_eq!(details(&path).unwrap().orientation, 8);
}
