//! FITS and NumPy arrays, WebP, and formats that are refused by name.

use tempfile::TempDir;

use super::*;

/// FITS unit: a header of these cards and big-endian data, both in whole blocks.
pub(super) fn fits_unit(cards: &[&str], data: &[u8]) -> Vec<u8> {
    let mut unit = cards.iter().chain(&["END"]).map(|card| format!("{card:80}")).collect::<String>().into_bytes();
    unit.resize(unit.len().next_multiple_of(2880), b' ');
    unit.extend(data);
    unit.resize(unit.len().next_multiple_of(2880), 0);
    unit
}

pub(super) fn fits(bits: i32, axes: &[usize], more: &[&str], data: &[u8]) -> Vec<u8> {
    let mut cards = vec![format!("SIMPLE  = {:>20} / standard", "T"), format!("BITPIX  = {bits:>20}")];
    cards.push(format!("NAXIS   = {:>20}", axes.len()));
    cards.extend(axes.iter().enumerate().map(|(i, n)| format!("NAXIS{}  = {n:>20}", i + 1)));
    let cards: Vec<&str> = cards.iter().map(String::as_str).chain(more.iter().copied()).collect();
    fits_unit(&cards, data)
}

/// NPY file of version 1.
pub(super) fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let fortran = if fortran { "True" } else { "False" };
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
    header.push_str(&" ".repeat(63 - (10 + header.len()) % 64));
    header.push('\n');
    [&b"\x93NUMPY\x01\0"[..], &(header.len() as u16).to_le_bytes(), header.as_bytes(), data].concat()
}

/// File of these bytes, in a folder that exists as long as the returned guard.
fn file(bytes: &[u8]) -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("photograph");
    fs::write(&path, bytes).unwrap();
    (dir, path)
}

fn raster(bytes: &[u8]) -> Raster {
    let (_dir, path) = file(bytes);
    let raster = read(&path).unwrap();
    assert_eq!(info(&path).unwrap(), raster.info());
    raster
}

fn says(bytes: &[u8], words: &str) {
    let (_dir, path) = file(bytes);
    for said in [info(&path).unwrap_err().to_string(), read(&path).unwrap_err().to_string()] {
        assert!(said.contains(words) && said.contains(';'), "no '{words}' in: {said}");
    }
}

/// Rows of 3 x 2 values from the top; FITS stores them from the bottom.
const TOP: [i32; 6] = [11, 12, 13, 21, 22, 23];
const BOTTOM: [i32; 6] = [21, 22, 23, 11, 12, 13];

#[test]
fn fits_of_every_type_with_its_first_row_at_the_bottom() {
    let floats = || Samples::F32(TOP.map(|v| v as f32).to_vec());
    let bytes = BOTTOM.map(|v| v as u8);
    let two: Vec<u8> = BOTTOM.iter().flat_map(|v| (*v as i16).to_be_bytes()).collect();
    let unsigned: Vec<u8> = BOTTOM.iter().flat_map(|v| ((v + 40_000 - 32_768) as i16).to_be_bytes()).collect();
    let four: Vec<u8> = BOTTOM.iter().flat_map(|v| v.to_be_bytes()).collect();
    let single: Vec<u8> = BOTTOM.iter().flat_map(|v| (*v as f32).to_be_bytes()).collect();
    let double: Vec<u8> = BOTTOM.iter().flat_map(|v| f64::from(*v).to_be_bytes()).collect();
    let offset = "BZERO   =                32768 / unsigned";
    assert_eq!(raster(&fits(8, &[3, 2], &[], &bytes)).samples, Samples::U8(TOP.map(|v| v as u8).to_vec()));
    let words = Samples::U16(TOP.map(|v| (v + 40_000) as u16).to_vec());
    assert_eq!(raster(&fits(16, &[3, 2], &[offset], &unsigned)).samples, words);
    assert_eq!(raster(&fits(16, &[3, 2, 1, 1], &["BSCALE  = 1.0D0", offset], &unsigned)).samples, words);
    assert_eq!(raster(&fits(16, &[3, 2], &[], &two)).samples, floats());
    assert_eq!(raster(&fits(32, &[3, 2], &[], &four)).samples, floats());
    assert_eq!(raster(&fits(-32, &[3, 2], &[], &single)).samples, floats());
    assert_eq!(raster(&fits(-64, &[3, 2], &[], &double)).samples, floats());
    let scaled = Samples::F32(TOP.map(|v| -3.5 + 0.25 * v as f32).to_vec());
    let cards = ["BZERO   = -3.5", "BSCALE  = 2.5E-1 / per unit"];
    assert_eq!(raster(&fits(32, &[3, 2], &cards, &four)).samples, scaled);
    assert_eq!(raster(&fits(-32, &[3, 2], &cards, &single)).samples, scaled);
    let whole = raster(&fits(8, &[3, 2], &["ROWORDER= 'TOP-DOWN'           / order of rows"], &bytes));
    assert_eq!((whole.width, whole.height, whole.samples), (3, 2, Samples::U8(bytes.to_vec())));
}

#[test]
fn fits_of_three_planes_blanks_and_extensions() {
    // Red, green and blue planes of 1 x 2.
    let planes = raster(&fits(8, &[1, 2, 3], &[], &[1, 2, 3, 4, 5, 6]));
    assert_eq!((planes.channels, planes.samples), (3, Samples::U8(vec![2, 4, 6, 1, 3, 5])));
    let blank = raster(&fits(16, &[2, 1], &["BLANK   =               -32768"], &[0x80, 0, 0x7f, 0xff]));
    let Samples::F32(values) = blank.samples else { panic!() };
    assert!(values[0].is_nan() && values[1] == 32_767.0);
    let primary = fits(8, &[], &["EXTEND  =                    T"], &[]);
    let table = fits_unit(
        &[
            "XTENSION= 'BINTABLE'",
            "BITPIX  = 8",
            "NAXIS   = 2",
            "NAXIS1  = 5",
            "NAXIS2  = 3",
            "PCOUNT  = 2",
            "GCOUNT  = 1",
        ],
        &[9; 17],
    );
    let image = fits_unit(
        &[
            "XTENSION= 'IMAGE   '",
            "BITPIX  = 8",
            "NAXIS   = 2",
            "NAXIS1  = 2",
            "NAXIS2  = 1",
            "PCOUNT  = 0",
            "GCOUNT  = 1",
        ],
        &[7, 8],
    );
    assert_eq!(raster(&[&primary[..], &table, &image, &table].concat()).samples, Samples::U8(vec![7, 8]));
    says(&[&primary[..], &image, &table, &image].concat(), "is a FITS file of several images");
    assert_eq!(raster(&[fits(8, &[1, 1], &[], &[5]), image].concat()).samples, Samples::U8(vec![5]));
    says(&[primary, table].concat(), "is a FITS file without an image");
}

#[test]
fn fits_that_is_not_read_is_refused_by_name() {
    says(&fits(64, &[2, 1], &[], &[0; 16]), "BITPIX = 64");
    says(&fits(8, &[2, 1, 5], &[], &[0; 10]), "2 x 1 x 5 values");
    says(&fits(8, &[7], &[], &[0; 7]), "array of 7 values");
    says(&fits(8, &[2, 2], &["BAYERPAT= 'RGGB    '"], &[0; 4]), "BAYERPAT = RGGB");
    raster(&fits(8, &[2, 2], &["BAYERPAT= 'NONE    '"], &[0; 4]));
    let compressed = fits_unit(
        &["XTENSION= 'BINTABLE'", "BITPIX  = 8", "NAXIS   = 2", "NAXIS1  = 8", "NAXIS2  = 2", "ZIMAGE  = T"],
        &[0; 16],
    );
    says(&[fits(8, &[], &[], &[]), compressed].concat(), "compressed FITS image (fpack)");
    says(&fits(8, &[60_000, 60_000], &[], &[0]), "more than 128 Mpixel");
    says(&fits(8, &[6000, 6000], &[], &[0]), "is truncated or damaged: the pixels end at byte 36002880");
    says(&fits(8, &[2, 2], &["BZERO   = many"], &[0; 4]), "BZERO is 'many', not a number");
    let whole = fits(8, &[2, 2], &[], &[0; 4]);
    says(&whole[..2000], "its header has no END");
}

#[test]
fn white_of_arrays() {
    let white = |bytes: &[u8]| levels(&file(bytes).1).unwrap();
    let (_dir, path) = file(&fits(16, &[1, 1], &[], &[0, 1]));
    assert_eq!(levels(&path).unwrap(), Some([0.0, 32_767.0]));
    let (_dir, path) = file(&fits(16, &[1, 1], &["BZERO   = 32768", "SATURATE= 60123."], &[0, 1]));
    assert_eq!(levels(&path).unwrap(), Some([0.0, 60_123.0]));
    let (_dir, path) = file(&fits(-32, &[1, 1], &[], &[0; 4]));
    assert_eq!(levels(&path).unwrap(), None);
    let (_dir, path) = file(&npy("<i2", false, "(1, 1)", &[0; 2]));
    assert_eq!(levels(&path).unwrap(), Some([0.0, 32_767.0]));
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(levels(&jpeg_file(dir.path(), true)).unwrap(), None);
    assert!(std::panic::catch_unwind(|| white(b"nothing")).is_err());
}

#[test]
fn npy_of_every_type_order_and_byte_order() {
    fn both<const N: usize>(code: &str, values: [[u8; N]; 6], expected: Samples) {
        let backward: Vec<u8> = values.iter().flat_map(|v| v.iter().rev().copied()).collect();
        let forward = values.concat();
        assert_eq!(raster(&npy(&format!("<{code}"), false, "(2, 3)", &forward)).samples, expected, "<{code}");
        assert_eq!(raster(&npy(&format!(">{code}"), false, "(2, 3, 1)", &backward)).samples, expected, ">{code}");
        let columns = [0, 3, 1, 4, 2, 5].map(|i: usize| values[i]).concat();
        assert_eq!(raster(&npy(&format!("<{code}"), true, "(2, 3)", &columns)).samples, expected, "{code} by columns");
    }
    let floats = || Samples::F32(TOP.map(|v| v as f32).to_vec());
    assert_eq!(
        raster(&npy("|u1", false, "(2, 3)", &TOP.map(|v| v as u8))).samples,
        Samples::U8(TOP.map(|v| v as u8).to_vec())
    );
    let high = TOP.map(|v| (v * 3000) as u16);
    both("u2", high.map(u16::to_le_bytes), Samples::U16(high.to_vec()));
    both("u4", TOP.map(|v| (v as u32).to_le_bytes()), floats());
    both("u8", TOP.map(|v| (v as u64).to_le_bytes()), floats());
    let negative = || Samples::F32(TOP.map(|v| -v as f32).to_vec());
    both("i1", TOP.map(|v| (-v as i8).to_le_bytes()), negative());
    both("i2", TOP.map(|v| (-v as i16).to_le_bytes()), negative());
    both("i4", TOP.map(|v| (-v).to_le_bytes()), negative());
    both("i8", TOP.map(|v| i64::from(-v).to_le_bytes()), negative());
    both("f2", TOP.map(|v| half::f16::from_f32(v as f32).to_le_bytes()), floats());
    both("f4", TOP.map(|v| (v as f32).to_le_bytes()), floats());
    both("f8", TOP.map(|v| f64::from(v).to_le_bytes()), floats());
}

#[test]
fn npy_in_colour_and_of_later_versions() {
    let color: Vec<u8> = (1..=12).collect();
    let plain = raster(&npy("|u1", false, "(2, 2, 3)", &color));
    assert_eq!((plain.width, plain.height, plain.channels, &plain.samples), (2, 2, 3, &Samples::U8(color.clone())));
    // The first axis is the fastest: value (y, x, c) is at y + 2 x + 4 c.
    let columns: Vec<u8> = [0, 6, 3, 9, 1, 7, 4, 10, 2, 8, 5, 11].map(|i: usize| color[i]).to_vec();
    assert_eq!(raster(&npy("|u1", true, "(2, 2, 3)", &columns)), plain);
    let old = npy("|u1", false, "(2L, 2L, 3L)", &color);
    assert_eq!(raster(&old), plain);
    let first = npy("|u1", false, "(2, 2, 3)", &color);
    let longer = [&b"\x93NUMPY\x03\0"[..], &first[8..10], &[0, 0], &first[10..]].concat();
    assert_eq!(raster(&longer), plain);
}

#[test]
fn npy_that_is_not_read_is_refused_by_name() {
    says(&npy("<c8", false, "(1, 1)", &[0; 8]), "of type '<c8'");
    says(&npy("|O", false, "(1, 1)", &[0; 8]), "of type '|O'");
    says(&npy("|b1", false, "(1, 1)", &[0]), "of type '|b1'");
    says(&npy("<f2", false, "(3, 4, 5)", &[0; 120]), "shape (3, 4, 5)");
    says(&npy("<f2", false, "(3,)", &[0; 6]), "shape (3,)");
    says(&npy("<f2", false, "(30000, 30000)", &[0; 6]), "more than 128 Mpixel");
    says(&npy("<f2", false, "(3000, 3000)", &[0; 6]), "is truncated or damaged: the numbers end at byte");
    says(&[npy("|u1", false, "(1, 1)", &[0]), npy("|u1", false, "(1, 1)", &[0])].concat(), "more than one array");
    let records = npy("|u1", false, "(1, 1)", &[0]);
    let records = String::from_utf8_lossy(&records[10..]).replace("'|u1'", "[('x', '<u2')]");
    let records = [&b"\x93NUMPY\x01\0"[..], &(records.len() as u16 - 1).to_le_bytes(), records.as_bytes()].concat();
    says(&records, "array of records");
}

#[test]
fn webp_lossless_with_and_without_alpha() {
    use image_webp::{ColorType, WebPEncoder};
    let dir = tempfile::tempdir().unwrap();
    for (color, stored) in [(ColorType::Rgb8, 3), (ColorType::Rgba8, 4)] {
        let path = dir.path().join("x");
        let data = bytes(stored);
        WebPEncoder::new(fs::File::create(&path).unwrap()).encode(&data, W as u32, H as u32, color).unwrap();
        check(&path, 3, Depth::U8, Samples::U8(kept(&data, stored, 3)));
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() - 9]).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("truncated or damaged"));
    }
}

#[test]
fn other_formats_are_refused_by_name_and_lose_no_depth() {
    let boxed = |brand: &str| [b"\0\0\0\x18ftyp", brand.as_bytes(), b"\0\0\0\0"].concat();
    for (head, name) in [
        (boxed("heic"), "HEIC"),
        (boxed("mif1"), "HEIC"),
        (boxed("avif"), "AVIF"),
        (b"\0\0\0\x0cjP  \r\n\x87\n".to_vec(), "JPEG 2000"),
        (b"\xff\x4f\xff\x51\0\0".to_vec(), "JPEG 2000"),
        (b"\0\0\0\x0cJXL \r\n\x87\n".to_vec(), "JPEG XL"),
        (b"\xff\x0a\xfa\x7f".to_vec(), "JPEG XL"),
        (b"8BPS\0\x01".to_vec(), "Photoshop"),
        ([&[0; 128][..], b"DICM"].concat(), "DICOM"),
    ] {
        says(&head, &format!("is a {name} file, which is not read; convert it to a 16-bit PNG or TIFF"));
    }
    says(b"P5\n640 480\n65535\n", "is a PNM or PAM file");
    says(b"PK\x03\x04 npz", "is a ZIP (or NPZ) file");
}
